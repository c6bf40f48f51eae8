// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdlib>
#include <telefab/fab/formats/contour_import.hpp>

// Any bytes as a file of contours: an error that is not a fault of ours, or a stack that keeps its header's promises,
// outer rings and holes told apart.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  MachineProfile machine;
  machine.name = std::string{"fuzzed"};
  machine.platform = {40, 30, 50};
  machine.projection.pixel_pitch_mm = 0.1;
  machine.layers.thickness_mm = 0.1;
  for (const bool centre : {false, true}) {
    fab::ImportOptions options;
    options.centre = centre;
    if (centre) options.unit_mm = 1;
    const auto import =
        fab::import_contours({reinterpret_cast<const std::byte*>(data), size}, machine, options, {}, {});
    if (!import) {
      if (import.error().code == ErrorCode::Internal || import.error().what.empty()) std::abort();
      continue;
    }
    for (const Layer& layer : import->stack.layers()) {
      double area_mm2 = 0;
      for (const Contour& ring : layer.contours) area_mm2 += ring.signed_area_mm2();
      if (!validate_layer(import->stack.header(), layer) || area_mm2 < -1e-6) std::abort();
    }
  }
  return 0;
}
