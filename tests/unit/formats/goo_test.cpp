// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/formats/sliced_file.hpp>
#include <telefab/fab/mask/orientation.hpp>

#include "goo_layout.hpp"
#include "goo_runs.hpp"
#include "masks_in_memory.hpp"
#include "other_goo_reader.hpp"
#include "scratch_files.hpp"

namespace telefab::fab {
namespace {

using telefab::test::OtherGooReader;
using test::MemoryMasks;
using test::plan_of;
using testing::HasSubstr;

/// Chunks between the mark and a checksum that holds.
std::vector<std::byte> sealed(std::initializer_list<int> chunks) {
  std::vector<std::byte> data{std::byte{0x55}};
  int sum = 0;
  for (const int c : chunks) data.push_back(static_cast<std::byte>(c)), sum += c;
  data.push_back(static_cast<std::byte>(~sum));
  return data;
}

std::string refusal(const std::vector<std::byte>& data, std::size_t count) {
  const auto pixels = goo::unpack(data, count);
  return pixels ? "read" : pixels.error().what;
}

TEST(GooRuns, AreReadAsTheVectorsOfTheDocumentSay) {
  using Greys = std::vector<std::uint8_t>;
  const auto all = [](std::initializer_list<int> chunks, std::size_t count) {
    return goo::unpack(sealed(chunks), count).value();
  };
  EXPECT_EQ(all({0x05}, 5), Greys(5, 0));
  const Greys black = all({0x3F, 0x55, 0x56, 0x57}, 0x555657F);
  EXPECT_TRUE(std::all_of(black.begin(), black.end(), [](auto v) { return v == 0; }));
  const Greys grey = all({0x75, 0xAA, 0xBB, 0xCC, 0x15}, 0xBBCC155);
  EXPECT_TRUE(std::all_of(grey.begin(), grey.end(), [](auto v) { return v == 0xAA; }));
  EXPECT_EQ(all({0x81, 0x92, 0xFF}, 256)[255], 3) << "+1 once, then +2 for 255 pixels";
  EXPECT_EQ(all({0x41, 100, 0xA1, 0xB2, 0xEE}, 240)[239], 97) << "-1 once, then -2 for 238 pixels";
}

TEST(GooRuns, ComeBackWhateverThePicture) {
  std::mt19937 random{7};
  for (int round = 0; round < 300; ++round) {
    std::vector<std::uint8_t> pixels;
    while (pixels.size() < 5000) {
      const auto kind = random() % 4, run = 1 + random() % (round % 3 == 0 ? 3000U : 40U);
      const int last = pixels.empty() ? 0 : pixels.back();
      const int value = kind == 0   ? 0
                        : kind == 1 ? 255
                        : kind == 2 ? int(random() % 256)
                                    : last + int(random() % 40) - 20;
      pixels.insert(pixels.end(), run, static_cast<std::uint8_t>(std::clamp(value, 0, 255)));
    }
    const auto packed = goo::pack(pixels);
    ASSERT_EQ(goo::unpack(packed, pixels.size()).value(), pixels) << round;
    ASSERT_LT(packed.size(), pixels.size() + 3000);
  }
}

TEST(GooRuns, AreRefusedWhereTheyAreNotThePixelsOfTheFrame) {
  EXPECT_THAT(refusal(sealed({0x05}), 4), HasSubstr("more pixels than the frame"));
  EXPECT_THAT(refusal(sealed({0x3F, 0xFF, 0xFF, 0xFF}), 100), HasSubstr("more pixels than the frame"));
  EXPECT_THAT(refusal(sealed({0x05}), 6), HasSubstr("5 pixels, where the frame has 6"))
      << "a missing tail is not black";
  EXPECT_THAT(refusal(sealed({0x05, 0x1F}), 6), HasSubstr("cut off"));
  EXPECT_THAT(refusal(sealed({0x45}), 5), HasSubstr("cut off"));
  EXPECT_THAT(refusal(sealed({0x00}), 5), HasSubstr("a run of no pixels"));
  EXPECT_THAT(refusal(sealed({0x91, 0x00}), 5), HasSubstr("a run of no pixels"));
  EXPECT_THAT(refusal(sealed({0xA1}), 1), HasSubstr("below 0"));
  EXPECT_THAT(refusal(sealed({0xC1, 0x81}), 2), HasSubstr("above 255"));
  auto damaged = sealed({0x05});
  damaged.back() ^= std::byte{1};
  EXPECT_THAT(refusal(damaged, 5), HasSubstr("checksum"));
  EXPECT_THAT(refusal({}, 5), HasSubstr("0x55"));
  EXPECT_THAT(refusal({std::byte{0x54}, std::byte{0xFF}}, 0), HasSubstr("0x55"));
}

class Goo : public telefab::test::ScratchFiles {
 protected:
  Goo() {
    auto& motion = machine.motion;
    motion.peel_mm = 2, motion.peel_speed_mm_per_s = 1.1;
    motion.approach_mm = 1, motion.approach_speed_mm_per_s = 0.55;
    motion.wait_after_exposure_s = 0.25, motion.wait_after_lift_s = 1.5;
    motion.bottom.lift_mm = 8, motion.bottom.settle_s = 4;
    machine.file = {PrinterFile::Goo, "ELEGOO Saturn 3 Ultra"};
    plan = plan_of(machine, masks);
    plan.layers[3].exposure = std::chrono::microseconds{2'345'000};
    plan.layers[4].motion.lift_mm = 6.5;
    plan.layers[4].light_share = 51 / 255.0;
  }
  std::vector<std::byte> written() {
    const auto report = export_masks(MaskFormat::Goo, plan, masks, machine, folder / "x.goo", {}, {});
    EXPECT_TRUE(report) << report.error().what;
    return bytes("x.goo");
  }
  /// With one byte changed.
  std::string refusal_of(std::size_t at, int value, std::size_t size = 0) {
    auto all = written();
    if (size > 0) all.resize(size);
    all.at(at) = static_cast<std::byte>(value);
    return refusal_of(all);
  }
  static std::string refusal_of(const std::vector<std::byte>& all) {
    const auto file = read_sliced_file(all);
    if (!file) return file.error().what;
    for (std::uint32_t i = 0; i < (*file)->job().layers.size(); ++i)
      if (const auto mask = (*file)->mask(LayerIndex{i}); !mask) return mask.error().what;
    return "read";
  }
  MachineProfile machine = test::small_machine();
  MemoryMasks masks{machine, 6};
  PrintPlan plan;
};

TEST_F(Goo, ComesBackWithItsPixelsTimesAndMotions) {
  for (const OpticsTurn turn : {OpticsTurn::Normal, OpticsTurn::MirrorX, OpticsTurn::MirrorY, OpticsTurn::Rotate180}) {
    machine.projection.orientation = turn;
    const auto all = written();
    const auto file = read_sliced_file(all);
    ASSERT_TRUE(file) << file.error().what;
    const SlicedJob& job = (*file)->job();
    EXPECT_EQ(job.format, SlicedFormat::Goo);
    EXPECT_EQ(job.model, "ELEGOO Saturn 3 Ultra");
    EXPECT_EQ(job.program, "Telefab");
    EXPECT_EQ(job.size, plan.mask_size);
    EXPECT_NEAR(job.pixel_width_mm, 0.1, 1e-9);
    EXPECT_EQ(job.thickness_mm, 0.1);
    EXPECT_TRUE(job.absent.empty());
    ASSERT_EQ(job.layers.size(), plan.layers.size());
    for (const PlannedLayer& layer : plan.layers) {
      const SlicedLayer& read = job.layers[layer.index.count()];
      EXPECT_EQ(read.exposure, layer.exposure);
      EXPECT_NEAR(read.z_mm, layer.z_mm, 1e-7);
      EXPECT_EQ(read.light_share, layer.light_share);
      EXPECT_EQ(read.motion, layer.motion) << layer.index.count();
      EXPECT_FALSE(read.pauses);
      EXPECT_EQ((*file)->mask(layer.index).value(), masks.masks[layer.index.count()]);
    }
  }
  EXPECT_EQ(read_sliced_file(bytes("x.goo")).value()->mask(LayerIndex{6}).error().code, ErrorCode::NotFound);
}

TEST_F(Goo, IsReadByAnotherReaderAsItWasPlanned) {
  machine.projection.orientation = OpticsTurn::MirrorX;
  const auto all = written();
  const OtherGooReader other{all};
  EXPECT_EQ(other.text(12, 32), "Telefab");
  EXPECT_EQ(other.text(92, 32), "ELEGOO Saturn 3 Ultra");
  EXPECT_EQ(other.number(195'318, 1), 1U) << "mirrored along x";
  EXPECT_EQ(other.number(195'319, 1), 0U);
  EXPECT_FLOAT_EQ(other.real(195'320), 40);
  EXPECT_FLOAT_EQ(other.real(195'336), 2);
  EXPECT_EQ(other.number(195'340, 1), 1U) << "waits as stated";
  EXPECT_FLOAT_EQ(other.real(195'369), 8);
  EXPECT_EQ(other.number(195'373, 4), 2U);
  EXPECT_EQ(other.number(195'445, 1), 1U) << "per-layer values hold";
  EXPECT_EQ(other.number(195'474, 1), 1U) << "greys to 255";
  EXPECT_EQ(other.number(195'475, 2), 0U) << "no transition beside the layers' own times";
  ASSERT_EQ(other.layers.size(), 6U);
  for (const PlannedLayer& layer : plan.layers) {
    const auto& read = other.layers[layer.index.count()];
    const LayerMotion& m = layer.motion;
    EXPECT_EQ(read.pixels, turned_for_optics(masks.masks[layer.index.count()].view(), Orientation{true, false}).rows);
    EXPECT_FLOAT_EQ(read.exposure_s, std::chrono::duration<float>(layer.exposure).count());
    EXPECT_FLOAT_EQ(read.z_mm, static_cast<float>(layer.z_mm));
    EXPECT_FLOAT_EQ(read.before_lift_s, static_cast<float>(m.wait_after_exposure_s));
    EXPECT_FLOAT_EQ(read.after_lift_s, static_cast<float>(m.wait_after_lift_s));
    EXPECT_FLOAT_EQ(read.after_retract_s, static_cast<float>(m.settle_s));
    EXPECT_FLOAT_EQ(read.lift_mm, 2);
    EXPECT_FLOAT_EQ(read.lift_speed, 66);
    EXPECT_FLOAT_EQ(read.lift_mm + read.lift2_mm, static_cast<float>(m.lift_mm));
    EXPECT_FLOAT_EQ(read.retract_mm + read.retract2_mm, static_cast<float>(m.lift_mm)) << "down as far as up";
    EXPECT_FLOAT_EQ(read.retract2_mm, 1);
    EXPECT_FLOAT_EQ(read.retract2_speed, 33);
    EXPECT_EQ(read.pwm, layer.light_share == 1 ? 255U : 51U);
  }
  // Both previews show something: not one colour alone.
  for (const auto& [at, size] : {std::pair{194U, 116U * 116}, {27'108U, 290U * 290}}) {
    std::set<unsigned> colours;
    for (unsigned i = 0; i < size; ++i) colours.insert(other.number(at + 2 * i, 2));
    EXPECT_GT(colours.size(), 3U);
  }
}

TEST_F(Goo, WithoutLayersValuesGoesByItsHeader) {
  auto all = written();
  all[195'445] = std::byte{0};
  all[195'476] = std::byte{1};  // one layer of transition
  const auto file = read_sliced_file(all);
  ASSERT_TRUE(file) << file.error().what;
  const auto& layers = (*file)->job().layers;
  EXPECT_EQ(layers[1].exposure, std::chrono::seconds{8});
  EXPECT_EQ(layers[2].exposure, std::chrono::seconds{5});
  EXPECT_EQ(layers[3].exposure, std::chrono::seconds{2});
  EXPECT_EQ(layers[4].motion, plan.layers[3].motion);
  EXPECT_EQ(layers[0].motion, plan.layers[0].motion);
}

TEST_F(Goo, NamesWhatAFileLeavesUnsaid) {
  auto all = written();
  all[195'340] = std::byte{0};  // waits by a turn-off time
  for (std::size_t i = 92; i < 124; ++i) all[i] = std::byte{0};
  const auto file = read_sliced_file(all);
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_THAT((*file)->job().absent, testing::ElementsAre(SlicedValue::Model, SlicedValue::WaitBeforeExposure,
                                                          SlicedValue::WaitAfterExposure, SlicedValue::WaitAfterLift));
}

TEST_F(Goo, ReadsSixteenGreysAsShareOfFullLight) {
  auto all = written();
  all[195'474] = std::byte{0};
  EXPECT_THAT(refusal_of(all), HasSubstr("in a file of 16 greys"));
}

TEST_F(Goo, RefusesWhatIsNotAsTheDocumentSays) {
  const std::size_t first = goo::kHeaderBytes, size = written().size();
  EXPECT_EQ(refusal_of(94, 'X'), "read") << "a name is any";
  EXPECT_THAT(refusal_of(8, 1), HasSubstr("magic"));
  EXPECT_THAT(refusal_of(27'106, 0), HasSubstr("the end of a preview"));
  EXPECT_THAT(refusal_of(195'314, 0xFF), HasSubstr("where the frame has")) << "wider than its pixels";
  EXPECT_THAT(refusal_of(195'310, 0x7F), HasSubstr("99999 layers"));
  EXPECT_THAT(refusal_of(195'313, 0), HasSubstr("no layers"));
  EXPECT_THAT(refusal_of(195'313, 7), HasSubstr("cut off"));
  EXPECT_THAT(refusal_of(195'473, 0), HasSubstr("the place of its layers"));
  EXPECT_THAT(refusal_of(195'336, 0x7F), HasSubstr("the exposure is"));
  EXPECT_THAT(refusal_of(first + 10, 0xFF), HasSubstr("layer 0: its exposure is")) << "below zero";
  EXPECT_THAT(refusal_of(first + 62, 1), HasSubstr("above 255"));
  EXPECT_THAT(refusal_of(first + 65, 0), HasSubstr("the end of its definition"));
  EXPECT_THAT(refusal_of(first + 66, 0x7F), HasSubstr("cut off"));
  EXPECT_THAT(refusal_of(first + 71, 0xFF), HasSubstr("layer 0: byte"));
  EXPECT_THAT(refusal_of(size - 1, 1), HasSubstr("its ending"));
  for (const std::size_t cut : {std::size_t{4}, std::size_t{100'000}, first, first + 30, size - 12, size - 1}) {
    auto all = written();
    all.resize(cut);
    EXPECT_THAT(refusal_of(all), HasSubstr("cut off")) << cut;
  }
  auto longer = written();
  longer.push_back(std::byte{0});
  EXPECT_THAT(refusal_of(longer), HasSubstr("stand behind the end"));
}

TEST_F(Goo, RefusesToWriteWhatItCannotHold) {
  machine.file.model = "a printer with a name of too many letters";
  const auto refused = export_masks(MaskFormat::Goo, plan, masks, machine, folder / "y", {}, {});
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("file.model"));
  machine.file.model = "ELEGOO Jupiter 2";
  EXPECT_THAT(export_masks(MaskFormat::Goo, plan, masks, machine, folder / "y", {}, {}).error().what,
              HasSubstr("order of bytes"));
  EXPECT_EQ(files(), 0);
}

}  // namespace
}  // namespace telefab::fab
