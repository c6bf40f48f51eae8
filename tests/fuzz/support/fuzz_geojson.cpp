// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <telefab/fab/support/covering.hpp>
#include <telefab/fab/support/pictures.hpp>

// Whatever the text, a refusal says why; what is read can be covered, and every anchor lies inside.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const auto region = fab::region_from_geojson({reinterpret_cast<const char*>(data), size});
  if (!region) {
    if (region.error().what.empty()) std::abort();
    return 0;
  }
  if (!std::isfinite(region->area_mm2()) || region->area_mm2() < -1e-6) std::abort();
  fab::CoveringOptions options;
  // Few anchors, so that the time stays short whatever the size.
  options.anchor_distance = Millimetres{std::min(1000.0, 0.02 + std::sqrt(std::abs(region->area_mm2())) / 4)};
  options.sweeps = 2;
  options.removals = 1;
  const Bounds2 box = region->bounds();
  if (std::max(box.max.x_mm - box.min.x_mm, box.max.y_mm - box.min.y_mm) > 40 * options.anchor_distance.count())
    return 0;
  const auto covering = fab::cover_region(*region, options, {});
  if (!covering) return 0;
  if (!region->empty() && covering->anchors.empty()) std::abort();
  return 0;
}
