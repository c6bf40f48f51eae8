// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <telefab/fab/cure/calibration.hpp>
#include <telefab/fab/cure/calibration_band.hpp>
#include <telefab/fab/cure/dose_field.hpp>

#include "lit_plates.hpp"

namespace telefab::fab::test {
namespace {

using testing::HasSubstr;

/// A machine and readings of it with noise; every reading and its scatter come from the seed.
struct TrueMachine {
  double white = 8, leak = 0.02, gamma = 2.1, spread = 0.6, ec = 12, dp = 0.15;
  double light_noise = 0.004, contrast_noise = 0.01, depth_noise_mm = 0.004;

  [[nodiscard]] std::vector<MeasuredRow> readings(std::uint64_t seed) const {
    std::mt19937_64 rng{seed};
    std::normal_distribution<double> normal;
    std::vector<MeasuredRow> rows;
    const auto add = [&](MeasuredRow::Test test) -> MeasuredRow& {
      rows.emplace_back().test = test;
      rows.back().absolute = true;
      return rows.back();
    };
    for (int grey = 0; grey <= 255; grey += 17) {
      MeasuredRow& row = add(MeasuredRow::Test::Wedge);
      row.grey = grey;
      row.value = white * (leak + (1 - leak) * std::pow(grey / 255.0, gamma) + light_noise * normal(rng));
      row.value = std::max(0.0, row.value);
    }
    for (const double period : {2.0, 4.0, 6.0, 8.0, 12.0})
      for (int repeat = 0; repeat < 2; ++repeat) {
        MeasuredRow& row = add(MeasuredRow::Test::Lines);
        row.period_px = period;
        row.value = std::clamp(line_contrast(period, spread, leak) + contrast_noise * normal(rng), 0.0, 1.0);
      }
    for (const double seconds : {2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0}) {
      MeasuredRow& row = add(MeasuredRow::Test::Depth);
      row.exposure_s = seconds;
      row.value = dp * std::log(white * seconds / ec) + depth_noise_mm * normal(rng);
    }
    return rows;
  }
};

TEST(Calibration, FindsTheMachineWithinItsIntervals) {
  const TrueMachine truth;
  int held[6] = {};
  constexpr int seeds = 100;
  for (std::uint64_t seed = 0; seed < seeds; ++seed) {
    const auto c = fit_calibration(truth.readings(seed), 0);
    ASSERT_TRUE(c) << c.error().what;
    ASSERT_TRUE(c->gamma && c->leak && c->spread_px && c->critical_dose_mj_per_cm2 && c->penetration_mm);
    EXPECT_NEAR(c->gamma->value, truth.gamma, 0.08);
    EXPECT_NEAR(c->leak->value, truth.leak, 0.01);
    EXPECT_NEAR(c->irradiance_mw_per_cm2->value, truth.white, 0.1);
    EXPECT_NEAR(c->spread_px->value, truth.spread, 0.03);
    EXPECT_NEAR(c->penetration_mm->value, truth.dp, 0.012);
    EXPECT_NEAR(c->critical_dose_mj_per_cm2->value, truth.ec, 1.5);
    const auto holds = [](const FittedFigure& f, double value) { return f.least <= value && value <= f.most; };
    held[0] += holds(*c->gamma, truth.gamma);
    held[1] += holds(*c->leak, truth.leak);
    held[2] += holds(*c->irradiance_mw_per_cm2, truth.white);
    held[3] += holds(*c->spread_px, truth.spread);
    held[4] += holds(*c->penetration_mm, truth.dp);
    held[5] += holds(*c->critical_dose_mj_per_cm2, truth.ec);
  }
  // 95 of 100 with a standard deviation of 2.2; contrasts and black are cut off at their ends.
  for (const int count : held) EXPECT_GE(count, 88);
}

TEST(Calibration, BandHoldsWhatDosesCureInNineteenOfTwentyCalibrations) {
  const TrueMachine truth;
  constexpr double layer_mm = 0.1, dose = 60;
  const double true_depth = truth.dp * std::log(dose / truth.ec);
  const double true_through = truth.ec * std::exp(layer_mm / truth.dp);
  int depths = 0, shares = 0;
  double apart = 0;
  constexpr int seeds = 400;
  for (std::uint64_t seed = 0; seed < seeds; ++seed) {
    const auto c = fit_calibration(truth.readings(seed), truth.white);
    ASSERT_TRUE(c) << c.error().what;
    MachineProfile machine = calibrated(plate_machine(), *c);
    machine.layers.thickness_mm = layer_mm;
    const auto band = calibration_band(machine, dose);
    ASSERT_TRUE(band);
    depths += band->least_depth_mm <= true_depth && true_depth <= band->most_depth_mm;
    const auto& resin = machine.resin;
    const double through = resin.critical_dose_mj_per_cm2 * std::exp(layer_mm / resin.penetration_mm);
    shares += std::abs(std::log(through / true_through)) <= std::log1p(band->dose_share);
    apart = std::max(apart, (band->most_depth_mm - band->least_depth_mm) / 2 / true_depth);
  }
  // 380 with a standard deviation of 4.4; the wedge's own error of the irradiance is not in it.
  EXPECT_GE(depths, 360);
  EXPECT_GE(shares, 360);
  EXPECT_LT(apart, 0.2) << "the errors of both figures go together: by themselves they would say far less";
  EXPECT_FALSE(calibration_band(plate_machine(), dose)) << "nobody measured";
}

TEST(Calibration, IntervalsAreNarrowWhereReadingsAreAndWideWhereNot) {
  TrueMachine sharp, rough;
  sharp.depth_noise_mm = 0.001;
  rough.depth_noise_mm = 0.01;
  const auto a = fit_calibration(sharp.readings(3), 0), b = fit_calibration(rough.readings(3), 0);
  ASSERT_TRUE(a && b);
  EXPECT_NEAR(
      (b->penetration_mm->most - b->penetration_mm->least) / (a->penetration_mm->most - a->penetration_mm->least), 10,
      0.5);
}

TEST(Calibration, TakesTheMeasuredCurveWhereNoPowerFits) {
  TrueMachine truth;
  truth.light_noise = 0.002;
  auto rows = truth.readings(5);
  std::mt19937_64 rng{9};
  std::normal_distribution<double> normal;
  const auto curve = [](double c) { return c < 0.3 ? 0.1 * c : 0.03 + 0.97 * std::sin((c - 0.3) / 0.7 * 1.5707963); };
  for (MeasuredRow& row : rows)
    if (row.test == MeasuredRow::Test::Wedge)
      row.value = std::max(0.0, 8 * (0.02 + 0.98 * curve(row.grey / 255) + 0.002 * normal(rng)));
  const auto c = fit_calibration(rows, 0);
  ASSERT_TRUE(c) << c.error().what;
  EXPECT_FALSE(c->gamma);
  ASSERT_EQ(c->curve.size(), 16U);
  EXPECT_TRUE(std::is_sorted(c->curve.begin(), c->curve.end()));
  for (std::size_t i = 0; i < 16; ++i) EXPECT_NEAR(c->curve[i], curve(static_cast<double>(i) / 15), 0.012);
}

TEST(Calibration, FittedSectionsAreReadBackAsAProfile) {
  auto rows = TrueMachine{}.readings(1);
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 3; ++c) {
      MeasuredRow row;
      row.test = MeasuredRow::Test::Field;
      row.row = r;
      row.column = c;
      row.value = 8 - r - 0.5 * c;
      row.absolute = true;
      rows.push_back(row);
    }
  const auto c = fit_calibration(rows, 0);
  ASSERT_TRUE(c) << c.error().what;
  ASSERT_EQ(c->field.size(), 2U);
  EXPECT_EQ(c->field[0][0], 1);
  EXPECT_NEAR(c->field[1][2], 6.0 / 8, 1e-4);
  const MachineProfile machine = calibrated(plate_machine(), *c);
  EXPECT_EQ(machine_profile_from_toml(to_toml(machine), "text").value(), machine);
  MachineProfile guessed = plate_machine();
  guessed.assumed = {"projection.field", "resin.penetration_mm", "motion.pull_kpa"};
  EXPECT_EQ(calibrated(guessed, *c).assumed, (std::vector<std::string>{"motion.pull_kpa"})) << "what was measured";
  const std::string text = to_toml_fragment(*c);
  EXPECT_THAT(text, HasSubstr("[projection]"));
  EXPECT_THAT(text, HasSubstr("penetration_mm = 0.1"));
  EXPECT_THAT(text, HasSubstr("# 95 %:"));
  // Pasted into a profile as it is.
  const std::string resin = text.substr(text.find("[resin]"));
  const std::string profile =
      "name = \"a\"\n[platform]\nwidth_mm = 10.0\ndepth_mm = 10.0\nz_travel_mm = 10.0\n"
      "[projection]\npixel_pitch_mm = 0.1\nirradiance_mw_per_cm2 = 8.0\n"
      "[layers]\nthickness_mm = 0.1\nexposure_s = 5.0\nbottom_exposure_s = 5.0\n" +
      resin;
  const auto read = machine_profile_from_toml(profile, "text");
  ASSERT_TRUE(read) << read.error().what;
  EXPECT_TRUE(read->states_calibration_band());
  EXPECT_NEAR(read->resin.penetration_least_mm, c->penetration_mm->least, 1e-6);
  EXPECT_NEAR(read->resin.calibration_correlation, c->calibration_correlation, 1e-4);
}

TEST(Calibration, LineContrastIsThatOfTheDoseModel) {
  MachineProfile machine = plate_machine();
  machine.projection.spread_px = 0.7;
  const CureModel model = cure_model(machine).value();
  for (const int period : {4, 6, 8}) {
    const DoseField field =
        field_of(model, mask_of(model.mask, [&](int c, int) { return c % period < period / 2 ? 255 : 0; }), 500ms);
    const double lit_middle = 3 * period + period / 4.0, dark_middle = lit_middle + period / 2.0;
    const double most = field.sample({lit_middle, 24}).dose, least = field.sample({dark_middle, 24}).dose;
    EXPECT_NEAR(line_contrast(period, 0.7, 0), (most - least) / (most + least), 1e-4);
  }
}

TEST(Calibration, RefusesWhatNoMachineGivesAndSaysWhy) {
  const auto without = [](auto drop) {
    auto rows = TrueMachine{}.readings(2);
    std::erase_if(rows, drop);
    return fit_calibration(rows, 0);
  };
  using Kind = MeasuredRow::Test;
  EXPECT_THAT(without([](const MeasuredRow& r) { return r.test == Kind::Wedge && r.grey == 255; }).error().what,
              HasSubstr("grey 255 was not measured"));
  EXPECT_THAT(
      without([](const MeasuredRow& r) { return r.test == Kind::Wedge && r.grey > 34 && r.grey < 255; }).error().what,
      HasSubstr("at least 5"));
  EXPECT_THAT(without([](const MeasuredRow& r) { return r.test == Kind::Depth && r.exposure_s > 3; }).error().what,
              HasSubstr("at least 4 of 3"));
  EXPECT_THAT(without([](const MeasuredRow& r) { return r.test == Kind::Wedge; }).error().what,
              HasSubstr("no irradiance"));
  EXPECT_THAT(without([](const MeasuredRow& r) { return r.test == Kind::Lines && r.period_px < 8; }).error().what,
              HasSubstr("lines"));
  const auto changed = [](auto change) {
    auto rows = TrueMachine{}.readings(2);
    for (MeasuredRow& row : rows) change(row);
    return fit_calibration(rows, 0);
  };
  EXPECT_THAT(changed([](MeasuredRow& r) {
                if (r.test == Kind::Wedge) r.grey = 255 - r.grey;
              })
                  .error()
                  .what,
              HasSubstr("brighter than grey 255"));
  EXPECT_THAT(changed([](MeasuredRow& r) {
                if (r.test == Kind::Depth) r.value = 1 / r.value;
              })
                  .error()
                  .what,
              HasSubstr("does not grow"));
  EXPECT_THAT(changed([](MeasuredRow& r) {
                if (r.test == Kind::Depth) r.value *= 1000;
              })
                  .error()
                  .what,
              HasSubstr("units"));
  EXPECT_THAT(changed([](MeasuredRow& r) { r.absolute = r.test != Kind::Wedge || r.grey > 100; }).error().what,
              HasSubstr("mixed"));
}

TEST(MeasuredCsv, ReadsColumnsInAnyOrderAndUnits) {
  const auto rows = measured_from_csv(
      "# by hand\nunit,value,test,grey,exposure_s\r\nW/m2,80,wedge,255,\num,150,depth,,2.5\n\nmW/cm2,1.5,wedge,17,\n");
  ASSERT_TRUE(rows) << rows.error().what;
  ASSERT_EQ(rows->size(), 3U);
  EXPECT_DOUBLE_EQ((*rows)[0].value, 8);
  EXPECT_DOUBLE_EQ((*rows)[1].value, 0.15);
  EXPECT_DOUBLE_EQ((*rows)[1].exposure_s, 2.5);
  EXPECT_EQ((*rows)[2].grey, 17);
}

TEST(MeasuredCsv, NamesLineAndColumnOfWhatItRefuses) {
  const std::string head = "test,grey,row,column,period_px,exposure_s,value,unit\n";
  const auto what = [&](const std::string& rest) {
    const auto rows = measured_from_csv(head + rest);
    return rows ? std::string{"taken"} : rows.error().what;
  };
  EXPECT_THAT(what("wedge,0,,,,,,mW/cm2\n"), HasSubstr("line 2: value is empty"));
  EXPECT_THAT(what("wedge,0,,,,,nan,mW/cm2\n"), HasSubstr("not a number"));
  EXPECT_THAT(what("wedge,0,,,,,inf,mW/cm2\n"), HasSubstr("not a number"));
  EXPECT_THAT(what("wedge,300,,,,,1,mW/cm2\n"), HasSubstr("grey is 300; 0 to 255"));
  EXPECT_THAT(what("wedge,3,,,,,-1,mW/cm2\n"), HasSubstr("value is -1"));
  EXPECT_THAT(what("wedge,3,,,,,1,lux\n"), HasSubstr("unit is \"lux\""));
  EXPECT_THAT(what("field,,1.5,2,,,1,share\n"), HasSubstr("row is 1.5, not whole"));
  EXPECT_THAT(what("depth,,,,,2,0.1,inch\n"), HasSubstr("mm or um"));
  EXPECT_THAT(what("lines,,,,4,,1.2,contrast\n"), HasSubstr("value is 1.2; 0 to 1"));
  EXPECT_THAT(what("colour,,,,4,,1.2,contrast\n"), HasSubstr("unknown test"));
  EXPECT_THAT(what("wedge,3,,\n"), HasSubstr("line 2"));
  EXPECT_THAT(what(""), HasSubstr("no measurement"));
  EXPECT_THAT(measured_from_csv("test,value\n").error().what, HasSubstr("no column \"unit\""));
  EXPECT_THAT(measured_from_csv("test,value,unit,color\n").error().what, HasSubstr("unknown column \"color\""));
}

TEST(CalibrationMasks, FillTheFrameAndListEverythingToMeasure) {
  const auto tests = calibration_masks(plate_machine());
  ASSERT_FALSE(tests);  // 48 rows are too few
  MachineProfile machine = plate_machine();
  machine.platform = {20, 12, 50};
  const auto good = calibration_masks(machine);
  ASSERT_TRUE(good) << good.error().what;
  EXPECT_EQ(good->masks.size(), 16U + 1 + 1 + 8);
  double stairs = 0;
  for (const TestMask& test : good->masks) {
    EXPECT_EQ(test.mask.size, (PixelSize{200, 120}));
    EXPECT_GT(test.seconds, 0);
    EXPECT_THAT(good->readme + exposures_json(*good, machine), HasSubstr(test.file));
    if (test.file.starts_with("stairs")) stairs += test.seconds;
  }
  EXPECT_NEAR(stairs, 6 * machine.layers.exposure_s, 1e-9);
  // Every row is there, and every one still lacks its value.
  EXPECT_EQ(std::count(good->measured_csv.begin(), good->measured_csv.end(), '\n'), 1 + 16 + 35 + 12 + 8);
  EXPECT_THAT(measured_from_csv(good->measured_csv).error().what, HasSubstr("line 2: value is empty"));
}

}  // namespace
}  // namespace telefab::fab::test
