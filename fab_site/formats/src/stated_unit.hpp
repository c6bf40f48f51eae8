// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/base/result.hpp>

namespace telefab::fab {

/// Millimetres of one unit: what the file states, or else what the user says.
/// Fails with InvalidInput where neither does, both do and differ, or the value is not in (0, 1000].
[[nodiscard]] inline Result<double> agreed_unit(std::optional<double> stated_mm, std::optional<double> unit_read_mm) {
  if (!stated_mm && !unit_read_mm)
    return fail(ErrorCode::InvalidInput, "the file does not say its unit of length; say --units mm, um, cm or inch");
  const double unit_mm = stated_mm ? *stated_mm : *unit_read_mm;
  if (!(unit_mm > 0) || !(unit_mm <= 1000))
    return fail(ErrorCode::InvalidInput, "a unit of " + std::to_string(unit_mm) + " mm; it must lie in (0, 1000]");
  if (stated_mm && unit_read_mm && !(*stated_mm == *unit_read_mm))
    return fail(ErrorCode::InvalidInput, "the file says its unit is " + std::to_string(*stated_mm) +
                                             " mm, --units says " + std::to_string(*unit_read_mm) +
                                             "; leave --units out");
  return unit_mm;
}

}  // namespace telefab::fab
