// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <string>

namespace telefab::scan {

/// What a registered cloud says of its making, as a comment of its PLY header. `rms`: point to plane, unit of the
/// cloud.
[[nodiscard]] std::string registration_note(std::size_t views, double rms);
/// The rms of a file with such a comment, unit of its points; empty where there is none, or no PLY header.
[[nodiscard]] std::optional<double> registration_rms_of(std::span<const std::byte> file);

}  // namespace telefab::scan
