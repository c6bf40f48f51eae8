// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/formats/sliced_file.hpp>
#include <telefab/image/png.hpp>

#include "masks_in_memory.hpp"
#include "scratch_files.hpp"
#include "zip_entries.hpp"

namespace telefab::fab {
namespace {

using test::MemoryMasks;
using test::plan_of;
using testing::HasSubstr;
using Entries = std::map<std::string, std::string>;

std::string png_of(PixelSize size, const std::vector<std::uint8_t>& grey) {
  const auto png = encode_png_grey(size.width_px, size.height_px, grey).value();
  return {reinterpret_cast<const char*>(png.data()), png.size()};
}

class SlicedFiles : public telefab::test::ScratchFiles {
 protected:
  std::vector<std::byte> zipped(const Entries& entries) {
    const auto path = folder / "made.zip";
    int code = 0;
    zip_t* zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code);
    for (const auto& [name, text] : entries)
      zip_file_add(zip, name.c_str(), zip_source_buffer(zip, text.data(), text.size(), 0), ZIP_FL_ENC_UTF_8);
    EXPECT_EQ(zip_close(zip), 0);
    return bytes("made.zip");
  }
  std::string refusal(const Entries& entries) {
    const auto all = zipped(entries);
    const auto file = read_sliced_file(all);
    if (!file) return file.error().what;
    const auto mask = (*file)->mask(LayerIndex{static_cast<std::uint32_t>((*file)->job().layers.size()) - 1});
    return mask ? "read" : mask.error().what;
  }
  std::vector<std::byte> written(MaskFormat format, const PrintPlan& plan) {
    const auto report = export_masks(format, plan, masks, machine, folder / "x", {}, {});
    EXPECT_TRUE(report) << report.error().what;
    return bytes("x");
  }
  MachineProfile machine = test::small_machine();
  MemoryMasks masks{machine, 6};
};

/// As PrusaSlicer 2.5 writes it, with a picture of 2 x 3 pixels whose one lit corner shows how it is turned.
Entries prusa_archive() {
  return {{"config.ini",
           "action = print\nexpTime = 2\nexpTimeFirst = 20\njobDir = part\nlayerHeight = 0.05\nmaterialName = resin\n"
           "numFade = 5\nnumFast = 7\nnumSlow = 0\nprinterModel = SL1\nprusaSlicerVersion = PrusaSlicer-2.5.0\n"},
          {"prusaslicer.ini",
           "display_height = 68\ndisplay_mirror_x = 1\ndisplay_mirror_y = 0\ndisplay_orientation = portrait\n"
           "display_pixels_x = 2560\ndisplay_pixels_y = 1440\ndisplay_width = 120\nfast_tilt_time = 5\n"
           "initial_layer_height = 0.04\nslow_tilt_time = 8\n"},
          {"part00000.png", png_of({2, 3}, {0, 0, 0, 0, 255, 0})},
          {"part00001.png", png_of({2, 3}, {0, 0, 0, 0, 0, 9})},
          {"part00002.png", png_of({2, 3}, {1, 2, 3, 4, 5, 6})},
          {"thumbnail/thumbnail400x400.png", "not a layer"}};
}

TEST_F(SlicedFiles, OfThePlansFormatsComeBackWithPixelsAndTimes) {
  machine.layers.exposure_s = 2, machine.layers.bottom_exposure_s = 8;
  machine.layers.bottom_count = 1, machine.layers.transition_count = 2;
  auto& motion = machine.motion;
  motion.peel_mm = 2, motion.peel_speed_mm_per_s = 1.1, motion.approach_mm = 1, motion.approach_speed_mm_per_s = 0.55;
  motion.wait_after_exposure_s = 0.25, motion.wait_after_lift_s = 1.5;
  motion.bottom.lift_mm = 8, motion.bottom.settle_s = 4;
  PrintPlan plan = plan_of(machine, masks);
  for (PlannedLayer& layer : plan.layers) {
    layer.exposure = std::chrono::microseconds{std::llround(1e6 * machine.exposure_of_layer_s(layer.index.count()))};
    layer.motion = motion_of(machine.motion, layer.index.count() < 1, 100);
  }
  for (const auto& [format, read_as] : {std::pair{MaskFormat::Sl1, SlicedFormat::Sl1},
                                        {MaskFormat::NanoDlp, SlicedFormat::NanoDlp},
                                        {MaskFormat::Goo, SlicedFormat::Goo}}) {
    for (const OpticsTurn turn :
         {OpticsTurn::Normal, OpticsTurn::MirrorX, OpticsTurn::MirrorY, OpticsTurn::Rotate180}) {
      machine.projection.orientation = turn;
      const auto all = written(format, plan);
      const auto file = read_sliced_file(all);
      ASSERT_TRUE(file) << file.error().what;
      const SlicedJob& job = (*file)->job();
      EXPECT_EQ(job.format, read_as);
      EXPECT_EQ(job.model, "small") << name_of(read_as);
      EXPECT_EQ(job.size, plan.mask_size);
      EXPECT_NEAR(job.pixel_width_mm, 0.1, 1e-7);
      EXPECT_NEAR(job.pixel_height_mm, 0.1, 1e-7);
      EXPECT_NEAR(job.thickness_mm, 0.1, 1e-9);
      ASSERT_EQ(job.layers.size(), plan.layers.size());
      for (const PlannedLayer& layer : plan.layers) {
        const SlicedLayer& read = job.layers[layer.index.count()];
        EXPECT_EQ(read.exposure, layer.exposure) << name_of(read_as) << ' ' << layer.index.count();
        EXPECT_NEAR(read.z_mm, layer.z_mm, 1e-6);
        EXPECT_EQ(read.light_share, 1);
        EXPECT_EQ((*file)->mask(layer.index).value(), masks.masks[layer.index.count()]) << name_of(read_as);
        LayerMotion expected = layer.motion;
        if (format == MaskFormat::NanoDlp)  // speeds and two stages are the machine's
          expected = {.settle_s = expected.settle_s,
                      .wait_after_exposure_s = 0.25,
                      .lift_mm = expected.lift_mm,
                      .wait_after_lift_s = 1.5};
        EXPECT_EQ(read.motion, expected) << name_of(read_as) << ' ' << layer.index.count();
      }
      EXPECT_EQ(job.absent.empty(), format != MaskFormat::NanoDlp);
    }
  }
}

TEST_F(SlicedFiles, OfPrusaSlicerComeOutAsTheyLieOnThePlatform) {
  // Found by slicing an L with PrusaSlicer 2.5.0 in each setting: columns along y, rows along x. Lit: column 0, row 2.
  struct Case {
    const char *orientation, *mirror_x, *mirror_y;
    std::uint32_t column, row;  ///< of the mask, as seen from above
  };
  for (const Case& c : {Case{"portrait", "1", "0", 0, 1},
                        {"portrait", "0", "0", 0, 0},
                        {"portrait", "0", "1", 2, 0},
                        {"portrait", "1", "1", 2, 1},
                        {"landscape", "0", "0", 0, 2},
                        {"landscape", "1", "0", 1, 2},
                        {"landscape", "0", "1", 0, 0},
                        {"landscape", "1", "1", 1, 0}}) {
    Entries archive = prusa_archive();
    archive["prusaslicer.ini"] = std::string{"display_orientation = "} + c.orientation +
                                 "\ndisplay_mirror_x = " + c.mirror_x + "\ndisplay_mirror_y = " + c.mirror_y + "\n";
    const auto all = zipped(archive);
    const auto file = read_sliced_file(all);
    ASSERT_TRUE(file) << file.error().what;
    const auto mask = (*file)->mask(LayerIndex{0});
    ASSERT_TRUE(mask) << mask.error().what;
    EXPECT_EQ(mask->size, (std::string_view{c.orientation} == "portrait" ? PixelSize{3, 2} : PixelSize{2, 3}));
    EXPECT_EQ(mask->size, (*file)->job().size);
    EXPECT_EQ(mask->rows.at(c.row * mask->size.width_px + c.column), 255) << c.orientation << c.mirror_x << c.mirror_y;
  }
}

TEST_F(SlicedFiles, OfPrusaSlicerFadeAndNameWhatTheyLeaveUnsaid) {
  const auto all = zipped(prusa_archive());
  const auto file = read_sliced_file(all);
  ASSERT_TRUE(file) << file.error().what;
  const SlicedJob& job = (*file)->job();
  EXPECT_EQ(job.name, "part");
  EXPECT_EQ(job.model, "SL1");
  EXPECT_EQ(job.resin, "resin");
  EXPECT_EQ(job.program, "PrusaSlicer-2.5.0");
  ASSERT_EQ(job.layers.size(), 3U);
  EXPECT_EQ(job.layers[0].exposure, std::chrono::seconds{20});
  EXPECT_EQ(job.layers[1].exposure, std::chrono::milliseconds{15500});
  EXPECT_NEAR(job.layers[0].z_mm, 0.04, 1e-12);
  EXPECT_NEAR(job.layers[2].z_mm, 0.14, 1e-12);
  EXPECT_EQ(job.layers[2].motion.tilt_s, 5);
  EXPECT_EQ(job.pixel_width_mm, 120.0 / 2560);
  EXPECT_EQ(job.pixel_height_mm, 68.0 / 1440);
  EXPECT_THAT(job.absent,
              testing::ElementsAre(SlicedValue::Lift, SlicedValue::LowerSpeed, SlicedValue::WaitBeforeExposure,
                                   SlicedValue::WaitAfterExposure, SlicedValue::WaitAfterLift));
  Entries bare = prusa_archive();
  bare.erase("prusaslicer.ini");
  bare["config.json"] = "{}";
  const auto poor = zipped(bare);
  const auto without = read_sliced_file(poor);
  ASSERT_TRUE(without) << without.error().what;
  EXPECT_EQ((*without)->job().pixel_width_mm, 0.04725) << "of that model";
  EXPECT_TRUE((*without)->job().lacks(SlicedValue::Mirroring));
  EXPECT_TRUE((*without)->job().lacks(SlicedValue::PrinterProfile));
}

TEST_F(SlicedFiles, RefuseAnSl1ArchiveThatIsNoJobAndSayWhy) {
  const auto with = [&](const std::string& from, const std::string& to) {
    Entries archive = prusa_archive();
    std::string& config = archive["config.ini"];
    config.replace(config.find(from), from.size(), to);
    return refusal(archive);
  };
  EXPECT_EQ(refusal(prusa_archive()), "read");
  EXPECT_THAT(with("expTime = 2\n", ""), HasSubstr("config.ini has no expTime"));
  EXPECT_THAT(with("expTime = 2\n", "expTime = two\n"), HasSubstr("expTime is \"two\""));
  EXPECT_THAT(with("expTime = 2\n", "expTime = -1\n"), HasSubstr("not a number within"));
  EXPECT_THAT(with("layerHeight = 0.05", "layerHeight = 0"), HasSubstr("layerHeight"));
  EXPECT_THAT(with("jobDir = part", "jobDir = other"), HasSubstr("no picture"));
  EXPECT_THAT(with("jobDir = part\n", ""), HasSubstr("jobDir"));
  Entries archive = prusa_archive();
  archive["part00002.png"] = png_of({3, 2}, {1, 2, 3, 4, 5, 6});
  EXPECT_THAT(refusal(archive), HasSubstr("part00002.png has 3 x 2 pixels"));
  archive["part00002.png"] = "not a picture";
  EXPECT_THAT(refusal(archive), HasSubstr("part00002.png"));
  const auto colour = encode_png({2, 3, 3, std::vector<std::uint8_t>(18, 7)}).value();
  archive["part00002.png"] = std::string{reinterpret_cast<const char*>(colour.data()), colour.size()};
  EXPECT_THAT(refusal(archive), HasSubstr("coloured"));
}

TEST_F(SlicedFiles, RefuseAnArchiveWhoseTextUnpacksToMoreThanIsEverParsed) {
  Entries archive = prusa_archive();
  archive["config.ini"] += "; " + std::string(8U << 20U, 'x') + "\n";
  EXPECT_THAT(refusal(archive), HasSubstr("config.ini unpacks to"));
  archive = prusa_archive();
  archive["config.ini"] += "; " + std::string(7U << 20U, 'x') + "\n";
  EXPECT_EQ(refusal(archive), "read");
}

TEST_F(SlicedFiles, RefuseANanoDlpArchiveThatIsNoJobAndSayWhy) {
  (void)written(MaskFormat::NanoDlp, plan_of(machine, masks));
  const Entries whole = telefab::test::zip_entries(folder / "x");
  EXPECT_EQ(refusal(whole), "read");
  const auto with = [&](const std::string& name, const std::string& from, const std::string& to) {
    Entries archive = whole;
    std::string& text = archive.at(name);
    const auto at = text.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    return refusal((text.replace(at, from.size(), to), archive));
  };
  EXPECT_THAT(with("meta.json", "\"FormatVersion\": 2", "\"FormatVersion\": 3"), HasSubstr("FormatVersion 3"));
  EXPECT_THAT(with("plate.json", "\"LayersCount\": 6", "\"LayersCount\": 7"), HasSubstr("7.png is missing"));
  EXPECT_THAT(with("plate.json", "\"LayersCount\": 6", "\"LayersCount\": 1e9"), HasSubstr("LayersCount"));
  EXPECT_THAT(with("options.json", "\"ImageRotate\": 0", "\"ImageRotate\": 90"), HasSubstr("ImageRotate"));
  EXPECT_THAT(with("profile.json", "\"CureTime\": 2.0", "\"CureTime\": \"2\""), HasSubstr("CureTime"));
  Entries archive = whole;
  archive["override.json"] = R"({"1":{"CureTime":9}})";
  EXPECT_THAT(refusal(archive), HasSubstr("override.json"));
  archive = whole;
  archive.erase("profile.json");
  const auto all = zipped(archive);
  const auto file = read_sliced_file(all);
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_TRUE((*file)->job().lacks(SlicedValue::Exposure));
  EXPECT_EQ((*file)->job().layers[3].exposure.count(), 0);
}

TEST_F(SlicedFiles, AreKnownByTheirBytesAlone) {
  const std::string text = "solid part";
  EXPECT_FALSE(sliced_format_of(std::as_bytes(std::span{text})));
  EXPECT_FALSE(sliced_format_of({}));
  EXPECT_FALSE(sliced_format_of(zipped({{"other.txt", "x"}})));
  EXPECT_EQ(read_sliced_file({}).error().code, ErrorCode::InvalidInput);
}

}  // namespace
}  // namespace telefab::fab
