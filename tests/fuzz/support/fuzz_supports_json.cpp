// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <telefab/fab/verify/print_files.hpp>

// What is read can be cut at any layer, and every ring is finite.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const auto supports = fab::WrittenSupports::from_json({reinterpret_cast<const char*>(data), size});
  if (!supports) {
    if (supports.error().what.empty()) std::abort();
    return 0;
  }
  for (const std::uint32_t layer : {0U, 1U, 7U, 4'000'000'000U})
    for (const Contour& ring : supports->section(LayerIndex{layer}, 0.15))
      for (const Point2& p : ring.vertices())
        if (!std::isfinite(p.x_mm) || !std::isfinite(p.y_mm)) std::abort();
  return 0;
}
