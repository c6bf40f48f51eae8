// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <telefab/test/block_stack.hpp>
#include <vector>

namespace telefab::fab::test {

using telefab::test::small_machine;

/// A part without any symmetry: an L that leans to one corner, cut shorter from layer to layer.
class MemoryMasks final : public MaskSource {
 public:
  MemoryMasks(const MachineProfile& machine, std::uint32_t layers) {
    for (std::uint32_t i = 0; i < layers; ++i) {
      const std::vector<Contour> rings{
          Contour::from_vertices({{2, 3}, {20.03 - i, 3}, {20.03 - i, 5.55}, {6, 5.55}, {6, 14}, {2, 14}}).value()};
      masks.push_back(rasterise(rings, mask_frame(machine)));
    }
  }
  Result<Mask> mask(LayerIndex layer) override {
    if (fail_at && *fail_at == layer.count()) return fail(ErrorCode::NotTrusted, "digest of layer 2");
    return masks.at(layer.count());
  }
  std::vector<Mask> masks;
  std::optional<std::uint32_t> fail_at;
};

/// Two bottom layers of 8 s, the others 2 s.
inline PrintPlan plan_of(const MachineProfile& machine, const MemoryMasks& source) {
  PrintPlan plan;
  plan.job = "thumbnail of ../L";
  plan.machine = machine.name;
  plan.mask_size = machine.mask_size();
  plan.z_travel_mm = machine.platform.z_travel_mm;
  for (std::uint32_t i = 0; i < source.masks.size(); ++i)
    plan.layers.push_back(
        {LayerIndex{i}, (i + 1) * machine.layers.thickness_mm, std::chrono::milliseconds{i < 2 ? 8000 : 2000},
         digest_of(std::as_bytes(std::span{source.masks[i].rows})), motion_of(machine.motion, i < 2, 100)});
  return plan;
}

}  // namespace telefab::fab::test
