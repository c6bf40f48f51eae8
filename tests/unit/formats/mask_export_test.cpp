// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spng.h>

#include <nlohmann/json.hpp>
#include <sstream>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/mask/orientation.hpp>
#include <telefab/fab/print/print_time.hpp>
#include <telefab/image/png.hpp>

#include "masks_in_memory.hpp"
#include "scratch_files.hpp"
#include "zip_entries.hpp"

namespace telefab::fab {
namespace {

using telefab::test::zip_entries;
using test::MemoryMasks;
using test::plan_of;
using testing::HasSubstr;

/// By spng itself, not through the library under test. Fails unless it is 8-bit grey.
Mask decoded(const std::string& png) {
  spng_ctx* context = spng_ctx_new(0);
  spng_set_png_buffer(context, png.data(), png.size());
  spng_ihdr header{};
  EXPECT_EQ(spng_get_ihdr(context, &header), 0);
  EXPECT_EQ(header.color_type, SPNG_COLOR_TYPE_GRAYSCALE);
  EXPECT_EQ(header.bit_depth, 8);
  Mask mask{{header.width, header.height}, std::vector<std::uint8_t>(std::size_t{header.width} * header.height)};
  EXPECT_EQ(spng_decode_image(context, mask.rows.data(), mask.rows.size(), SPNG_FMT_PNG, 0), 0);
  spng_ctx_free(context);
  return mask;
}

std::map<std::string, std::string> ini(const std::string& text) {
  std::map<std::string, std::string> values;
  std::istringstream lines{text};
  for (std::string line; std::getline(lines, line);)
    if (const auto at = line.find(" = "); at != std::string::npos) values[line.substr(0, at)] = line.substr(at + 3);
  return values;
}

class MaskExport : public telefab::test::ScratchFiles {
 protected:
  Result<MaskExportReport> write(MaskFormat format, const std::string& name = "x", std::stop_token stop = {}) {
    return export_masks(format, plan_of(machine, masks), masks, machine, folder / name, {}, stop);
  }
  MachineProfile machine = test::small_machine();
  MemoryMasks masks{machine, 6};
};

TEST_F(MaskExport, Sl1HoldsEveryMaskPixelByPixel) {
  const auto report = write(MaskFormat::Sl1);
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->layers, 6U);
  const auto entries = zip_entries(folder / "x");
  const auto config = ini(entries.at("config.ini"));
  for (std::uint32_t i = 0; i < 6; ++i)
    EXPECT_EQ(decoded(entries.at(config.at("jobDir") + "0000" + std::to_string(i) + ".png")), masks.masks[i]) << i;
  EXPECT_EQ(entries.size(), 6U + 4U);
}

TEST_F(MaskExport, Sl1SaysWhatItsReadersAskFor) {
  ASSERT_TRUE(write(MaskFormat::Sl1));
  const auto entries = zip_entries(folder / "x");
  const auto config = ini(entries.at("config.ini"));
  EXPECT_EQ(config.at("action"), "print");
  EXPECT_EQ(config.at("jobDir"), "job");  // no path, and no reader takes a layer for a preview
  EXPECT_EQ(config.at("layerHeight"), "0.1");
  EXPECT_EQ(config.at("expTime"), "2");
  EXPECT_EQ(config.at("expTimeFirst"), "8");
  EXPECT_EQ(config.at("numFade"), "3");  // 8 s, 5 s, 2 s: two equal ones it cannot say
  EXPECT_EQ(config.at("numFast"), "6");
  EXPECT_EQ(config.at("numSlow"), "0");
  // Every key that Odyssey parses; it refuses an archive that lacks one.
  for (const char* key :
       {"action", "expTime", "expTimeFirst", "expUserProfile", "fileCreationTimestamp", "hollow", "jobDir",
        "layerHeight", "materialName", "numFade", "numFast", "numSlow", "printProfile", "printTime", "printerModel",
        "printerProfile", "printerVariant", "prusaSlicerVersion", "usedMaterial"})
    EXPECT_EQ(config.count(key), 1U) << key;
  const auto profile = ini(entries.at("prusaslicer.ini"));
  EXPECT_EQ(profile.at("display_pixels_x"), "400");
  EXPECT_EQ(profile.at("display_pixels_y"), "300");
  EXPECT_EQ(std::stod(profile.at("display_width")), 40);
  EXPECT_EQ(std::stod(profile.at("display_height")), 30);
  EXPECT_EQ(profile.at("bed_shape"), "0x0,40.000000x0,40.000000x30.000000,0x30.000000");
  EXPECT_EQ(profile.at("display_orientation"), "landscape");
  EXPECT_EQ(profile.at("display_mirror_x"), "0");
  EXPECT_EQ(profile.at("layer_height"), config.at("layerHeight"));
  EXPECT_EQ(profile.at("initial_layer_height"), config.at("layerHeight"));
  for (const char* name : {"thumbnail/thumbnail400x400.png", "thumbnail/thumbnail800x480.png"})
    EXPECT_THAT(decode_png(std::as_bytes(std::span{entries.at(name)}), 1'000'000),
                testing::Truly([](const auto& r) { return r.has_value() && r->channels == 3; }))
        << name;
}

TEST_F(MaskExport, NanoDlpCountsItsLayersFromOneAndSaysWhatItsReadersAskFor) {
  ASSERT_TRUE(write(MaskFormat::NanoDlp));
  const auto entries = zip_entries(folder / "x");
  for (std::uint32_t i = 0; i < 6; ++i)
    EXPECT_EQ(decoded(entries.at(std::to_string(i + 1) + ".png")), masks.masks[i]) << i;
  const auto json = [&](const char* name) { return nlohmann::json::parse(entries.at(name)); };
  EXPECT_EQ(json("meta.json").at("FormatVersion"), 2);
  EXPECT_EQ(json("plate.json").at("LayersCount"), 6);
  EXPECT_NEAR(json("plate.json").at("XMin").get<double>(), 2 - 20, 1e-6);
  EXPECT_NEAR(json("plate.json").at("ZMax").get<double>(), 0.6, 1e-6);
  EXPECT_EQ(json("slicer.json").at("PWidth"), 400);
  EXPECT_EQ(json("slicer.json").at("PHeight"), 300);
  EXPECT_EQ(json("slicer.json").at("Thickness"), 100);
  EXPECT_EQ(json("options.json"), json("slicer.json"));
  EXPECT_EQ(json("profile.json").at("CureTime"), 2);
  EXPECT_EQ(json("profile.json").at("SupportCureTime"), 8);
  EXPECT_EQ(json("profile.json").at("SupportLayerNumber"), 2);
  const auto info = json("info.json");
  ASSERT_EQ(info.size(), 6U);
  EXPECT_EQ(info[0].at("AreaCount"), 1);
  EXPECT_EQ(info[0].at("MinX"), 20);
  EXPECT_EQ(info[0].at("MaxY"), 300 - 30);
  EXPECT_NEAR(info[0].at("TotalSolidArea").get<double>(), 18.03 * 2.55 + 4 * 8.45, 0.05);
}

TEST_F(MaskExport, GivesTheSameBytesTwice) {
  for (const auto format : {MaskFormat::Sl1, MaskFormat::NanoDlp, MaskFormat::Goo}) {
    ASSERT_TRUE(write(format, "a"));
    ASSERT_TRUE(write(format, "b"));
    EXPECT_EQ(bytes("a"), bytes("b"));
  }
}

TEST_F(MaskExport, TurnsTheMasksAsTheOpticsNeedAndStatesIt) {
  const std::pair<OpticsTurn, Orientation> all[] = {{OpticsTurn::MirrorX, {true, false}},
                                                    {OpticsTurn::MirrorY, {false, true}},
                                                    {OpticsTurn::Rotate180, {true, true}}};
  for (const auto& [turn, optics] : all) {
    const std::string_view name = name_of(turn);
    machine.projection.orientation = turn;
    ASSERT_TRUE(write(MaskFormat::Sl1));
    const auto entries = zip_entries(folder / "x");
    const Mask shown = decoded(entries.at("job00003.png"));
    EXPECT_NE(shown, masks.masks[3]);
    // What the optics do to the picture gives the mask again.
    EXPECT_EQ(turned_for_optics(shown.view(), optics), masks.masks[3]) << name;
    const auto profile = ini(entries.at("prusaslicer.ini"));
    EXPECT_EQ(profile.at("display_mirror_x"), optics.mirrors_x ? "1" : "0") << name;
    EXPECT_EQ(profile.at("display_mirror_y"), optics.mirrors_y ? "1" : "0") << name;
  }
}

TEST_F(MaskExport, CountsLayersWhoseExposureTheFormatCannotSay) {
  PrintPlan plan = plan_of(machine, masks);
  plan.layers[4].exposure = std::chrono::milliseconds{3000};
  const auto report = export_masks(MaskFormat::Sl1, plan, masks, machine, folder / "x", {}, {});
  ASSERT_TRUE(report);
  EXPECT_EQ(report->other_exposures, 2U);  // the second bottom layer and this one
  EXPECT_NEAR(report->most_exposure_error, 3.0 / 8, 1e-9);
  EXPECT_EQ(ini(zip_entries(folder / "x").at("config.ini")).at("expTime"), "2");
  const auto nano = export_masks(MaskFormat::NanoDlp, plan, masks, machine, folder / "x", {}, {});
  ASSERT_TRUE(nano);
  EXPECT_EQ(nano->other_exposures, 1U);
  EXPECT_NEAR(nano->most_exposure_error, 1.0 / 3, 1e-9);
  const auto goo = export_masks(MaskFormat::Goo, plan, masks, machine, folder / "x", {}, {});
  ASSERT_TRUE(goo);
  EXPECT_EQ(goo->other_exposures, 0U);
}

TEST_F(MaskExport, OfOnePlainMotionSaysOfItWhatItEverSaid) {
  ASSERT_TRUE(write(MaskFormat::Sl1));
  const auto profile = ini(zip_entries(folder / "x").at("prusaslicer.ini"));
  EXPECT_EQ(profile.at("printer_notes"), "LiftHeight_5\\nLiftSpeed_120\\nRetractSpeed_180\\nWaitTimeBeforeCure_0.5");
  EXPECT_EQ(profile.count("fast_tilt_time"), 0U);
}

TEST_F(MaskExport, SaysMotionAndWaitsInTheWordsOfEachFormat) {
  auto& motion = machine.motion;
  motion.peel_mm = 2, motion.peel_speed_mm_per_s = 1;
  motion.approach_mm = 1, motion.approach_speed_mm_per_s = 0.5;
  motion.wait_after_exposure_s = 0.25, motion.wait_after_lift_s = 1.5;
  motion.bottom.lift_mm = 8, motion.bottom.settle_s = 4, motion.bottom.wait_after_exposure_s = 2;
  const auto report = write(MaskFormat::Sl1);
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->other_motions, 0U);
  const auto notes = ini(zip_entries(folder / "x").at("prusaslicer.ini")).at("printer_notes");
  EXPECT_EQ(notes,
            "LiftHeight_2\\nLiftSpeed_60\\nLiftHeight2_3\\nLiftSpeed2_120\\nRetractSpeed_180\\nRetractHeight2_1\\n"
            "RetractSpeed2_30\\nWaitTimeBeforeCure_0.5\\nWaitTimeAfterCure_0.25\\nWaitTimeAfterLift_1.5\\n"
            "BottomLiftHeight_2\\nBottomLiftSpeed_60\\nBottomLiftHeight2_6\\nBottomLiftSpeed2_120\\n"
            "BottomRetractSpeed_180\\nBottomRetractHeight2_1\\nBottomRetractSpeed2_30\\nBottomWaitTimeBeforeCure_4\\n"
            "BottomWaitTimeAfterCure_2\\nBottomWaitTimeAfterLift_1.5\\nBottomLayerCount_2");
  ASSERT_TRUE(write(MaskFormat::NanoDlp));
  const auto profile = nlohmann::json::parse(zip_entries(folder / "x").at("profile.json"));
  EXPECT_EQ(profile.at("WaitHeight"), 5);
  EXPECT_EQ(profile.at("SupportWaitHeight"), 8);
  EXPECT_EQ(profile.at("WaitBeforePrint"), 0.5);
  EXPECT_EQ(profile.at("SupportWaitBeforePrint"), 4);
  EXPECT_EQ(profile.at("WaitAfterPrint"), 0.25);
  EXPECT_EQ(profile.at("SupportWaitAfterPrint"), 2);
  EXPECT_EQ(profile.at("TopWait"), 1.5);
  EXPECT_EQ(profile.at("SupportTopWait"), 1.5);
  EXPECT_TRUE(profile.at("SupportWaitBeforePrint").is_number_unsigned()) << "one reader takes whole seconds only";
}

TEST_F(MaskExport, SaysFastAndSlowTiltsAndFromWhichAreaOn) {
  machine.motion.lift_mm = 0;
  machine.motion.tilt_s = 5;
  machine.motion.large_area_mm2 = 300;  // of 1200
  machine.motion.large.tilt_s = 8;
  PrintPlan plan = plan_of(machine, masks);
  for (const std::size_t layer : {1U, 4U}) plan.layers[layer].motion = motion_of(machine.motion, false, 301);
  const auto report = export_masks(MaskFormat::Sl1, plan, masks, machine, folder / "x", {}, {});
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(report->other_motions, 0U);
  const auto entries = zip_entries(folder / "x");
  const auto config = ini(entries.at("config.ini"));
  EXPECT_EQ(config.at("numFast"), "4");
  EXPECT_EQ(config.at("numSlow"), "2");
  EXPECT_NEAR(std::stod(config.at("printTime")), double(print_time(plan, {}, stage_pace(machine), {}).count()) * 1e-9,
              1e-3);
  const auto profile = ini(entries.at("prusaslicer.ini"));
  EXPECT_EQ(std::stod(profile.at("fast_tilt_time")), 5);
  EXPECT_EQ(std::stod(profile.at("slow_tilt_time")), 8);
  EXPECT_EQ(std::stod(profile.at("area_fill")), 25);
}

TEST_F(MaskExport, CountsLayersWhoseMotionTheFormatCannotSay) {
  PrintPlan plan = plan_of(machine, masks);
  plan.layers[4].motion.lift_mm = 9;
  const auto report = export_masks(MaskFormat::NanoDlp, plan, masks, machine, folder / "x", {}, {});
  ASSERT_TRUE(report);
  EXPECT_EQ(report->other_motions, 1U);
}

TEST_F(MaskExport, SaysATransitionAndWhatAnSl1PrinterMakesOfIt) {
  machine.layers.exposure_s = 2, machine.layers.bottom_exposure_s = 8;
  for (const std::uint32_t bottoms : {1U, 2U}) {
    machine.layers.bottom_count = bottoms;
    machine.layers.transition_count = 2;
    PrintPlan plan = plan_of(machine, masks);
    for (PlannedLayer& layer : plan.layers)
      layer.exposure = std::chrono::microseconds{std::llround(1e6 * machine.exposure_of_layer_s(layer.index.count()))};
    const auto nano = export_masks(MaskFormat::NanoDlp, plan, masks, machine, folder / "x", {}, {});
    ASSERT_TRUE(nano);
    EXPECT_EQ(nano->other_exposures, 0U);
    const auto profile = nlohmann::json::parse(zip_entries(folder / "x").at("profile.json"));
    EXPECT_EQ(profile.at("TransitionalLayer"), 2);
    EXPECT_EQ(profile.at("SupportLayerNumber"), bottoms);
    const auto sl1 = export_masks(MaskFormat::Sl1, plan, masks, machine, folder / "x", {}, {});
    ASSERT_TRUE(sl1);
    // F, F - (F - E)/3, F - 2 (F - E)/3, E: as an SL1 fades over four layers. A second equal one it cannot say.
    EXPECT_EQ(ini(zip_entries(folder / "x").at("config.ini")).at("numFade"), bottoms == 1 ? "4" : "5");
    EXPECT_EQ(sl1->other_exposures, bottoms == 1 ? 0U : 3U);
    ASSERT_EQ(sl1->fades.size(), 3U);
    EXPECT_EQ(sl1->fades[0].reader, FadeReader::Slafw);
    EXPECT_EQ(sl1->fades[0].layers.size(), bottoms == 1 ? 0U : 3U);
    EXPECT_GT(sl1->fades[1].layers.size(), 1U) << "slafw up to 2022 keeps the first exposure for two layers more";
    EXPECT_GT(sl1->fades[2].layers.size(), 1U) << "Odyssey divides by one layer more";
  }
}

TEST_F(MaskExport, FitsTheFadeToTheProgramThatTheProfileNames) {
  machine.layers.exposure_s = 2, machine.layers.bottom_exposure_s = 8;
  PrintPlan plan = plan_of(machine, masks);
  // F, (F + E)/2, E: what Odyssey makes of numFade = 2, slafw of 3.
  plan.layers[0].exposure = std::chrono::seconds{8};
  plan.layers[1].exposure = std::chrono::seconds{5};
  for (const auto& [reader, fade] : {std::pair{FadeReader::Slafw, 3U}, {FadeReader::Odyssey, 2U}}) {
    machine.file.fade = reader;
    const auto report = survey_export(MaskFormat::Sl1, plan, machine, "x.sl1");
    ASSERT_TRUE(report) << report.error().what;
    EXPECT_EQ(report->fade, fade);
    EXPECT_EQ(report->other_exposures, 0U);
  }
  // F for three layers, then falling: what slafw up to 2022 makes of 2.
  for (const std::size_t i : {0U, 1U, 2U}) plan.layers[i].exposure = std::chrono::seconds{8};
  plan.layers[3].exposure = std::chrono::seconds{5};
  machine.file.fade = FadeReader::Slafw2022;
  const auto report = survey_export(MaskFormat::Sl1, plan, machine, "x.sl1");
  ASSERT_TRUE(report);
  EXPECT_EQ(report->fade, 2U);
  EXPECT_EQ(report->other_exposures, 0U);
}

TEST_F(MaskExport, RefusesExposuresThatSl1PrintersRefuse) {
  PrintPlan plan = plan_of(machine, masks);
  plan.layers[0].exposure = plan.layers[1].exposure = std::chrono::seconds{121};
  const auto first = survey_export(MaskFormat::Sl1, plan, machine, "x.sl1");
  ASSERT_FALSE(first);
  EXPECT_THAT(first.error().what, HasSubstr("layers.bottom_exposure_s"));
  for (auto& layer : plan.layers) layer.exposure = std::chrono::seconds{61};
  const auto normal = survey_export(MaskFormat::Sl1, plan, machine, "x.sl1");
  ASSERT_FALSE(normal);
  EXPECT_THAT(normal.error().what, HasSubstr("layers.exposure_s"));
  EXPECT_TRUE(survey_export(MaskFormat::Goo, plan, machine, "x.goo"));
}

TEST_F(MaskExport, NamesTheSl1ModelByProfileDisplayOrFileEnding) {
  const auto model = [&](const std::string& name) {
    const auto done = write(MaskFormat::Sl1, name);
    return done ? ini(zip_entries(folder / name).at("config.ini")).at("printerModel") : done.error().what;
  };
  EXPECT_EQ(model("a.sl1"), machine.name) << "no printer takes it for its own";
  machine.file.model = "SL1S";
  machine.file.variant = "fast";
  EXPECT_EQ(model("b.sl1s"), "SL1S");
  EXPECT_EQ(ini(zip_entries(folder / "b.sl1s").at("config.ini")).at("printerVariant"), "fast");
  EXPECT_THAT(model("c.sl1"), HasSubstr(".sl1s"));
  machine.file = {};
  machine.platform.width_mm = 81.001, machine.platform.depth_mm = 128.001, machine.projection.pixel_pitch_mm = 0.05;
  masks.masks = MemoryMasks{machine, 2}.masks;
  EXPECT_EQ(model("d.sl1s"), "SL1S");
  EXPECT_EQ(model("e.m1"), "M1");
  EXPECT_EQ(model("f.zip"), "SL1S");
}

TEST_F(MaskExport, RefusesToLeaveDimmedLightUnsaid) {
  PrintPlan plan = plan_of(machine, masks);
  plan.layers[3].light_share = 0.5;
  for (const auto format : {MaskFormat::Sl1, MaskFormat::NanoDlp}) {
    const auto refused = export_masks(format, plan, masks, machine, folder / "x", {}, {});
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
    EXPECT_THAT(refused.error().what, testing::HasSubstr("layers.light_share"));
  }
  EXPECT_EQ(files(), 0);
  // GOO says it, in 255 steps.
  const auto refused = export_masks(MaskFormat::Goo, plan, masks, machine, folder / "x", {}, {});
  EXPECT_TRUE(refused) << refused.error().what;
  plan.layers[3].light_share = 0.013;
  EXPECT_THAT(export_masks(MaskFormat::Goo, plan, masks, machine, folder / "y", {}, {}).error().what,
              HasSubstr("layer 3"));
  EXPECT_EQ(files(), 1);
}

TEST_F(MaskExport, LeavesTheOlderFileWhereAMaskFailsOrTheUserStops) {
  ASSERT_TRUE(write_file_atomically(folder / "x", "older"));
  masks.fail_at = 2;
  for (const auto format : {MaskFormat::Sl1, MaskFormat::Goo}) {
    const auto failed = write(format);
    ASSERT_FALSE(failed);
    EXPECT_EQ(failed.error().code, ErrorCode::NotTrusted);
  }
  masks.fail_at.reset();
  std::stop_source stop;
  stop.request_stop();
  for (const auto format : {MaskFormat::NanoDlp, MaskFormat::Goo})
    EXPECT_EQ(write(format, "x", stop.get_token()).error().code, ErrorCode::Cancelled);
  EXPECT_EQ(text("x"), "older");
  EXPECT_EQ(files(), 1);
}

TEST_F(MaskExport, RefusesAPlanOfAnotherMachine) {
  const PrintPlan plan = plan_of(machine, masks);
  machine.projection.pixel_pitch_mm = 0.05;
  const auto done = export_masks(MaskFormat::Sl1, plan, masks, machine, folder / "x", {}, {});
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().what, HasSubstr("plan the job again"));
  EXPECT_EQ(files(), 0);
}

}  // namespace
}  // namespace telefab::fab
