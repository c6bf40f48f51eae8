// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

namespace telefab::scan {

/// What people take for a scan by mistake, told by its first bytes: what it is, and what to do instead. Nothing for
/// whatever may be a scan. By the formats' public specifications.
struct ForeignFile {
  std::string_view name;
  std::string_view instead;
};
[[nodiscard]] std::optional<ForeignFile> foreign_file(std::span<const std::byte> bytes);

}  // namespace telefab::scan
