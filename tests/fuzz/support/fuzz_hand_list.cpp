// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <telefab/fab/support/support_plan.hpp>

// A list that is taken holds finite places only and passes the planner's own check.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab::fab;
  const auto list = hand_list_from_json({reinterpret_cast<const char*>(data), size});
  if (!list) {
    if (list.error().what.empty()) std::abort();
    return 0;
  }
  SupportOptions options;
  options.hand = *list;
  if (!options.validate()) std::abort();
  for (const auto& extra : list->extra)
    if (!std::isfinite(extra.place.x_mm) || !std::isfinite(extra.place.y_mm) || !std::isfinite(extra.z_mm))
      std::abort();
  return 0;
}
