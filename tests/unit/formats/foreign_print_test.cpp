// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/fab/formats/foreign_print.hpp>
#include <telefab/fab/formats/mask_export.hpp>

#include "masks_in_memory.hpp"
#include "scratch_files.hpp"

namespace telefab::fab {
namespace {

using test::MemoryMasks;
using testing::HasSubstr;

class ForeignPrints : public telefab::test::ScratchFiles {
 protected:
  FileBytes written(MaskFormat format) {
    const auto report = export_masks(format, test::plan_of(machine, masks), masks, machine, folder / "x", {}, {});
    EXPECT_TRUE(report) << report.error().what;
    return std::make_shared<const std::vector<std::byte>>(bytes("x"));
  }
  MachineProfile machine = test::small_machine();
  MemoryMasks masks{machine, 6};
};

TEST_F(ForeignPrints, OfMasksComeWithTheirPixelsAndTheOutlinesOfThem) {
  for (const MaskFormat format : {MaskFormat::Sl1, MaskFormat::NanoDlp, MaskFormat::Goo}) {
    const auto print = read_foreign_print(written(format), machine, "part", {}, {});
    ASSERT_TRUE(print) << print.error().what;
    ASSERT_TRUE(print->ready);
    EXPECT_EQ(print->stack.header().layer_count, 6U);
    ASSERT_EQ(print->ready->layers.size(), 6U);
    for (std::uint32_t i = 0; i < 6; ++i) {
      EXPECT_EQ(print->ready->masks->mask(LayerIndex{i})->rows, masks.mask(LayerIndex{i})->rows) << print->format;
      EXPECT_GT(print->ready->layers[i].exposure.count(), 0);
      EXPECT_TRUE(print->ready->layers[i].motion.validate());
    }
    EXPECT_THAT(print->ready->origin, HasSubstr(std::string{print->format}));
  }
}

TEST_F(ForeignPrints, TakeFromTheMachineWhatTheirFileDoesNotSay) {
  machine.motion.lift_mm = 7.25;
  machine.motion.lift_speed_mm_per_s = 1.375;
  const auto print = read_foreign_print(written(MaskFormat::Sl1), machine, "part", {}, {});
  ASSERT_TRUE(print) << print.error().what;
  if (print->sliced->lacks(SlicedValue::Lift)) {
    EXPECT_EQ(print->ready->layers[3].motion.lift_speed_mm_per_s, 1.375);
    EXPECT_THAT(print->ready->origin, HasSubstr("does not say"));
  } else {
    EXPECT_NEAR(print->ready->layers[3].motion.lift_mm, 7.25, 1e-6);
  }
}

TEST_F(ForeignPrints, AreRefusedForMachinesOfOtherPixels) {
  const auto goo = written(MaskFormat::Goo);
  MachineProfile wide = machine;
  wide.platform.width_mm *= 1.5;
  EXPECT_THAT(read_foreign_print(goo, wide, "part", {}, {}).error().what, HasSubstr("Slice it for this machine"));
  MachineProfile coarse = machine;
  coarse.projection.pixel_pitch_mm *= 1.05;
  coarse.platform.width_mm *= 1.05, coarse.platform.depth_mm *= 1.05;
  EXPECT_THAT(read_foreign_print(goo, coarse, "part", {}, {}).error().what, HasSubstr("Slice it for this machine"));
}

TEST_F(ForeignPrints, AreRefusedForLayersThatTheMachineDoesNotMake) {
  const auto goo = written(MaskFormat::Goo);
  machine.platform.least_layer_mm = 2 * machine.layers.thickness_mm;
  machine.platform.most_layer_mm = 1;
  EXPECT_THAT(read_foreign_print(goo, machine, "part", {}, {}).error().what, HasSubstr("makes layers of"));
}

TEST_F(ForeignPrints, OfContoursComeWithoutMasks) {
  const std::string cli =
      "$$HEADERSTART\n$$ASCII\n$$UNITS/1\n$$HEADEREND\n$$GEOMETRYSTART\n"
      "$$LAYER/0\n$$LAYER/" +
      std::to_string(machine.layers.thickness_mm) + "\n$$POLYLINE/1,1,5,1,1,3,1,3,3,1,3,1,1\n$$GEOMETRYEND\n";
  const auto text = std::as_bytes(std::span{cli});
  const auto print = read_foreign_print(std::make_shared<const std::vector<std::byte>>(text.begin(), text.end()),
                                        machine, "part.cli", {}, {});
  ASSERT_TRUE(print) << print.error().what;
  EXPECT_FALSE(print->ready);
  EXPECT_EQ(print->format, "CLI");
  EXPECT_EQ(print->stack.layers()[0].contours.size(), 1U);
}

TEST_F(ForeignPrints, AreToldFromWhatIsNone) {
  const std::string text = "solid cube\nfacet normal 0 0 1\n";
  const auto bytes = std::as_bytes(std::span{text});
  EXPECT_FALSE(is_foreign_print(bytes));
  EXPECT_TRUE(is_foreign_print(*written(MaskFormat::Sl1)));
  const auto kept = std::make_shared<const std::vector<std::byte>>(bytes.begin(), bytes.end());
  EXPECT_THAT(read_foreign_print(kept, machine, "cube.stl", {}, {}).error().what, HasSubstr("SL1, NanoDLP and GOO"));
}

}  // namespace
}  // namespace telefab::fab
