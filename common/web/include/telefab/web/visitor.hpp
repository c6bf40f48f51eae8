// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <string_view>

namespace telefab {

/// What somebody may do at a page; each includes those before it.
enum class Access : std::uint8_t {
  Anybody,    ///< what shows nothing of a part: the page's own files, version, health, signing in
  Readers,    ///< jobs, masks, contours, pictures, records
  Operators,  ///< whatever changes state
};

[[nodiscard]] constexpr std::string_view name_of(Access may) {
  return may == Access::Operators ? "operator" : may == Access::Readers ? "read-only" : "nothing";
}

/// Who asks at a page.
struct Visitor {
  std::string name;  ///< as the audit log has it; empty: nobody who said so
  Access may = Access::Anybody;
  friend bool operator==(const Visitor&, const Visitor&) = default;
};

}  // namespace telefab
