// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>

namespace telefab::scan {
namespace {

using testing::HasSubstr;

MachineProfile machine() { return find_machine(builtin_profiles()->machines(), "dlp6500").value(); }

/// A legal value that is not what is taken where nothing is said.
void set_unusual(SliceParameters& parameters, const SliceParameter& row, std::string_view choice = {}) {
  if (const auto* number = std::get_if<SliceParameter::Number>(&row.field))
    parameters.** number = row.range.is_whole ? 2 : 0.03125;
  if (const auto* flag = std::get_if<SliceParameter::Flag>(&row.field)) parameters.** flag = true;
  if (const auto* text = std::get_if<SliceParameter::Choice>(&row.field)) parameters.** text = std::string{choice};
}

/// Everything that a parameter may decide, as one text.
std::string fingerprint(const JobParameters& p) {
  const SliceRequest& s = p.slice;
  const auto number = [](const std::optional<double>& v) { return v ? std::to_string(*v) + ' ' : std::string{"- "}; };
  return number(s.placement.height_mm) + number(s.placement.scale) + number(s.placement.unit_mm) + number(s.layer_mm) +
         number(s.chord_mm) + number(s.most_gap_mm) + number(s.thickness_mm) + number(s.mls.kernel_mm) +
         number(s.speck_px2) + std::to_string(s.placement.fit) + std::to_string(s.complete) +
         std::to_string(s.flat_base) + std::to_string(s.intake.pick.crop ? s.intake.pick.crop->max.z() : 0) +
         std::to_string(s.intake.pick.pieces) + std::to_string(s.intake.sample_faces) +
         std::to_string(s.mls.drop_outliers) + to_json(s.placement) +
         std::to_string(static_cast<int>(s.placement.stand_for.value_or(StandFor{}))) +
         std::to_string(static_cast<int>(s.method)) + std::to_string(static_cast<int>(s.mls.surface)) +
         std::to_string(static_cast<int>(p.codec.coding));
}

// A knob that is in the table and reaches nothing could be submitted and would be ignored.
TEST(SliceParameters, EveryRowChangesWhatIsSliced) {
  const std::string usual = fingerprint(job_parameters_of({}, machine()).value());
  for (const SliceParameter& row : slice_parameter_table()) {
    // The machine is composed with the others before, or they are the fleet's.
    if (row.subject != SliceParameter::Subject::Slicing) continue;
    std::vector<std::string_view> values{row.choices.begin(), row.choices.end()};
    if (values.empty()) values.emplace_back(row.example);
    int changed = 0;
    for (const std::string_view value : values) {
      SliceParameters parameters;
      set_unusual(parameters, row, value);
      const auto made = job_parameters_of(parameters, machine());
      ASSERT_TRUE(made) << row.key << ' ' << value << ": " << made.error().what;
      const bool is_fallback = !value.empty() && value == row.fallback;
      changed += fingerprint(*made) != usual;
      if (is_fallback) {
        EXPECT_EQ(fingerprint(*made), usual) << row.key << " is said to be " << value << " where it is left out";
      }
    }
    EXPECT_GE(changed, static_cast<int>(values.size()) - (row.choices.empty() ? 0 : 1)) << row.key;
  }
}

TEST(SliceParameters, OfAJobAndOfACommandLineAreReadAlike) {
  SliceParameters all;
  for (const SliceParameter& row : slice_parameter_table())
    if (row.key != "scale" && row.key != "fit" && row.key != "up")
      set_unusual(all, row, row.choices.empty() ? row.example : row.choices.front());
  const auto read = slice_parameters_from_json(to_json(all));
  ASSERT_TRUE(read) << read.error().what;
  EXPECT_EQ(*read, all);
  EXPECT_EQ(fingerprint(job_parameters_from(to_json(all), machine()).value()),
            fingerprint(job_parameters_of(all, machine()).value()));
}

TEST(SliceParameters, WhatOnceCouldNotBeSubmittedIsTaken) {
  const auto made = job_parameters_from(R"({"chord_mm":0.01,"kernel_mm":0.5,"keep_outliers":true})", machine());
  ASSERT_TRUE(made) << made.error().what;
  EXPECT_EQ(made->slice.chord_mm, 0.01);
  EXPECT_EQ(made->slice.mls.kernel_mm, 0.5);
  EXPECT_FALSE(made->slice.mls.drop_outliers);
  // The coding is told how much of the error the chords have taken.
  EXPECT_NEAR(made->codec.chord_error_pitch, 0.01 / machine().projection.pixel_pitch_mm, 1e-12);
  EXPECT_GT(made->codec.total_error_pitch, made->codec.chord_error_pitch);
}

TEST(SliceParameters, ChordsOfCodedContoursAreShorterThanAPixel) {
  SliceParameters coarse;
  coarse.chord_mm = 0.5;
  EXPECT_THAT(job_parameters_of(coarse, machine()).error().what, HasSubstr("chord_mm"));
  EXPECT_EQ(job_parameters_of(coarse, machine(), Contours::Plain)->slice.chord_mm, 0.5);
  coarse.coding = "exact";
  EXPECT_EQ(job_parameters_of(coarse, machine())->slice.chord_mm, 0.5);
}

TEST(SliceParameters, LayersBeyondWhatThePrinterPrintsAreRefused) {
  MachineProfile limited = machine();
  limited.platform.least_layer_mm = 0.02;
  limited.platform.most_layer_mm = 0.1;
  EXPECT_TRUE(job_parameters_from(R"({"layer_mm":0.1})", limited));
  for (const char* beyond : {R"({"layer_mm":0.01})", R"({"layer_mm":0.15})"})
    EXPECT_THAT(job_parameters_from(beyond, limited).error().what, HasSubstr("0.02 to 0.1 mm")) << beyond;
  EXPECT_TRUE(job_parameters_from(R"({"layer_mm":0.15})", machine())) << "no limit is stated";
}

TEST(SliceParameters, WrongOnesAreRefusedByName) {
  const auto why = [](std::string_view json) { return slice_parameters_from_json(json).error().what; };
  EXPECT_THAT(why(R"({"hight_mm":3})"), HasSubstr("hight_mm"));
  EXPECT_THAT(why(R"({"height_mm":"3"})"), HasSubstr("height_mm: must be a number"));
  EXPECT_THAT(why(R"({"height_mm":0})"), HasSubstr("height_mm: 0 is not above 0"));
  EXPECT_THAT(why(R"({"layer_mm":1.5})"), HasSubstr("layer_mm"));
  EXPECT_THAT(why(R"({"fit":1})"), HasSubstr("fit: must be true or false"));
  EXPECT_THAT(why(R"({"mirror":"w"})"), HasSubstr("x, y, z"));
  EXPECT_THAT(why(R"({"up":"x","rotate":"0,0,90"})"), HasSubstr("cannot be stated together with up"));
  EXPECT_THAT(why(R"({"fit":true,"height_mm":3})"), HasSubstr("cannot be stated together with height_mm"));
  EXPECT_THAT(why(R"({"scale":2,"units":"mm"})"), HasSubstr("cannot be stated together with scale"));
  // The scan site reads these.
  const auto refusal = [](std::string_view json) { return job_parameters_from(json, machine()).error().what; };
  EXPECT_THAT(refusal(R"({"up":"w"})"), HasSubstr("x, -x, y, -y, z, -z"));
  EXPECT_THAT(refusal(R"({"up":"auto:speed"})"), HasSubstr("supports, height, quality"));
  EXPECT_THAT(refusal(R"({"up":"automatic"})"), HasSubstr("auto:GOAL"));
  EXPECT_THAT(refusal(R"({"up":"auto","base":"flat"})"), HasSubstr("which way is up"));
  EXPECT_THAT(refusal(R"({"rotate":"1,2"})"), HasSubstr("three angles"));
  EXPECT_THAT(refusal(R"({"scale_axes":"2,1,1"})"), HasSubstr("0.8 to 1.25"));
  EXPECT_THAT(refusal(R"({"position":"here"})"), HasSubstr("numbers with commas"));
  EXPECT_THAT(why("[]"), HasSubstr("not a JSON object"));
}

}  // namespace
}  // namespace telefab::scan
