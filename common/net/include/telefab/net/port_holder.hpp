// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>

namespace telefab::net {

/// Why a port that is in use cannot be listened on, and what to do: names the program that holds it, where /proc tells
/// (one's own programs, or everybody's for root).
[[nodiscard]] std::string why_port_is_taken(std::uint16_t port);

}  // namespace telefab::net
