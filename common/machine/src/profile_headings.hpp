// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <string_view>
#include <vector>

namespace telefab {

/// What may stand above the sections of a file.
struct HeadingRow {
  std::string_view key;
  std::array<bool, 3> of;  ///< by ProfileKind
  std::string_view range;
  std::string_view meaning;
};
/// All of them, in the order of the reference.
[[nodiscard]] std::vector<HeadingRow> profile_headings();

}  // namespace telefab
