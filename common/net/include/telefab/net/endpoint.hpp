// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab::net {

/// Where a site listens. Port 0 lets the system choose.
struct Endpoint {
  std::string host;
  std::uint16_t port = 0;
  friend bool operator==(const Endpoint&, const Endpoint&) = default;
};

/// "HOST:PORT" or "[IPV6]:PORT". InvalidInput says what is wrong.
[[nodiscard]] Result<Endpoint> endpoint_from_text(std::string_view text);
[[nodiscard]] std::string to_text(const Endpoint& endpoint);
/// localhost, 127.0.0.0/8 or ::1. Only there may a connection go without TLS.
[[nodiscard]] bool is_loopback(const Endpoint& endpoint);

}  // namespace telefab::net
