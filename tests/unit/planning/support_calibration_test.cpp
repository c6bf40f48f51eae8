// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <telefab/fab/cure/support_calibration.hpp>
#include <telefab/test/profiles.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using Kind = SupportSpecimen::Kind;

class SupportPrintOf : public testing::TestWithParam<const char*> {};

TEST_P(SupportPrintOf, StandsOnThePlatformNumberedWithEachStepTwice) {
  const MachineProfile machine = test::known_machine(GetParam());
  const auto specimens = support_specimens(machine);
  ASSERT_TRUE(specimens) << specimens.error().what;
  std::map<double, int> steps;
  std::vector<double> overhangs;
  int number = 0, off_centre = 0;
  for (const SupportSpecimen& s : *specimens) {
    EXPECT_EQ(s.number, ++number);
    EXPECT_GE(s.box.min.x_mm, 0);
    EXPECT_GE(s.box.min.y_mm, 0);
    EXPECT_LE(s.box.max.x_mm, machine.platform.width_mm);
    EXPECT_LE(s.box.max.y_mm, machine.platform.depth_mm);
    for (const SupportSpecimen& other : *specimens) {
      if (other.number <= s.number) continue;
      EXPECT_TRUE(s.box.max.x_mm < other.box.min.x_mm || other.box.max.x_mm < s.box.min.x_mm ||
                  s.box.max.y_mm < other.box.min.y_mm || other.box.max.y_mm < s.box.min.y_mm)
          << s.number << " and " << other.number << " overlap";
    }
    if (s.kind == Kind::Ladder) ++steps[s.demand];
    if (s.kind == Kind::Shelf) overhangs.push_back(s.overhang_mm);
    off_centre += s.kind == Kind::OffCentre ? 1 : 0;
  }
  EXPECT_EQ(off_centre, 3);
  ASSERT_GE(steps.size(), 8U);
  double before = 0;
  for (const auto& [demand, count] : steps) {
    EXPECT_EQ(count, 2) << demand;
    if (before > 0) {
      EXPECT_NEAR(demand / before, 1.25, 0.2) << demand;
    }
    before = demand;
  }
  EXPECT_NEAR(steps.begin()->first, 30, 2);
  ASSERT_GE(overhangs.size(), 4U);
  EXPECT_TRUE(std::is_sorted(overhangs.begin(), overhangs.end()));
  EXPECT_NEAR(overhangs.back() / machine.layers.thickness_mm, 12, 1);
}

// machine-c's pixels are wider than its layers are thick; the last two are of the catalogue.
INSTANTIATE_TEST_SUITE_P(Machines, SupportPrintOf,
                         testing::Values("machine-a", "machine-b", "machine-c", "elegoo-mars-3",
                                         "anycubic-photon-ultra"),
                         [](const auto& at) {
                           std::string name = at.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

/// What a resin with that r, kappa and scatter leaves of a print.
std::vector<SupportReading> printed(std::span<const SupportSpecimen> specimens, double thickness_mm, double r,
                                    double kappa, double scatter, std::uint64_t seed) {
  std::mt19937_64 rng{seed};
  std::normal_distribution<double> normal{0, 1};
  std::vector<SupportReading> readings;
  for (const SupportSpecimen& s : specimens) {
    const double reach = s.overhang_mm / thickness_mm;
    const double demand = s.kind == Kind::Shelf ? 3 * reach * reach / kappa : s.demand;
    readings.push_back({s, demand < r * std::exp(scatter * normal(rng))});
  }
  return readings;
}

TEST(SupportCalibration, HoldsTheTruthInNineOfTenIntervals) {
  constexpr int kPrints = 300;
  const MachineProfile machine = test::known_machine("machine-b");
  const auto specimens = support_specimens(machine);
  ASSERT_TRUE(specimens);
  for (const double scatter : {0.0, 0.1, 0.25}) {
    int fitted = 0, demand_in = 0, share_in = 0, shares = 0;
    double width = 0;
    for (int seed = 0; seed < kPrints; ++seed) {
      // A resin of its own each time.
      std::mt19937_64 rng{static_cast<std::uint64_t>(seed) + 1000};
      std::uniform_real_distribution<double> even{0, 1};
      const double r = 80 * std::pow(5, even(rng)), kappa = 0.3 * std::pow(4, even(rng));
      const auto readings =
          printed(*specimens, machine.layers.thickness_mm, r, kappa, scatter, static_cast<std::uint64_t>(seed));
      const auto fit = fit_supports(readings, machine.layers.thickness_mm);
      ASSERT_TRUE(fit) << fit.error().what << " seed " << seed;
      ++fitted;
      demand_in += fit->demand.least <= r && r <= fit->demand.most;
      width += std::log(fit->demand.most / fit->demand.least);
      if (fit->overhang_share) {
        ++shares;
        share_in += (fit->overhang_ends == KnownEnds::Most || fit->overhang_share->least <= kappa) &&
                    (fit->overhang_ends == KnownEnds::Least || kappa <= fit->overhang_share->most);
      } else {
        ASSERT_TRUE(fit->overhang_share_below);
      }
    }
    fmt::print("scatter {:.2f}: r in {} of {}, kappa in {} of {}; interval of r +- {:.0f} %\n", scatter, demand_in,
               fitted, share_in, shares, 100 * (std::exp(width / fitted / 2) - 1));
    EXPECT_GE(demand_in, 0.9 * fitted) << scatter;
    EXPECT_GE(shares, 0.9 * kPrints);
    EXPECT_GE(share_in, 0.9 * shares) << scatter;
    EXPECT_LT(width / fitted, std::log(4)) << "an interval that says something";
  }
}

std::vector<SupportReading> where(std::span<const SupportSpecimen> specimens, auto holds) {
  std::vector<SupportReading> readings;
  for (const SupportSpecimen& s : specimens) readings.push_back({s, holds(s)});
  return readings;
}

TEST(SupportCalibration, GivesKeysByWhichAPlanMayAskForWhatHeld) {
  const MachineProfile machine = test::known_machine("machine-b");
  const double t = machine.layers.thickness_mm;
  const auto specimens = support_specimens(machine).value();
  const auto fit = fit_supports(printed(specimens, t, 200, 0.6, 0, 1), t);
  ASSERT_TRUE(fit) << fit.error().what;
  EXPECT_EQ(fit->demand_ends, KnownEnds::Both);
  EXPECT_NEAR(fit->demand.value, 200, 0.13 * 200);
  const MachineProfile after = with_supports(machine, *fit);
  EXPECT_NEAR(after.carried_demand() * after.supports.safety, fit->demand.value, 1e-9 * fit->demand.value);
  EXPECT_TRUE(after.states_what_carries());
  ASSERT_TRUE(fit->overhang_share);
  double longest = 0;
  for (const SupportSpecimen& s : specimens)
    if (s.kind == Kind::Shelf && 3 * s.overhang_mm * s.overhang_mm / (t * t) < 0.6 * 200)
      longest = std::max(longest, s.overhang_mm);
  EXPECT_NEAR(fit->overhang_share->value, 3 * longest * longest / (t * t) / fit->demand.value, 1e-9);
  const std::string text = to_toml_fragment(*fit, machine);
  EXPECT_THAT(text, HasSubstr("[resin]\ngreen_strength_mpa = "));
  EXPECT_THAT(text, HasSubstr("[motion]\npull_kpa = "));
  EXPECT_THAT(text, HasSubstr("[supports]\noverhang_share = "));
  EXPECT_THAT(text, HasSubstr("Off centre by 0.30"));
}

TEST(SupportCalibration, TellsWhereTheLeverRuleIsNotWhatThePrintShows) {
  const MachineProfile machine = test::known_machine("machine-b");
  const double t = machine.layers.thickness_mm;
  const auto specimens = support_specimens(machine).value();
  const auto text = [&](bool moved_hold, double torn_from) {
    const auto fit = fit_supports(where(specimens,
                                        [&](const SupportSpecimen& s) {
                                          return s.kind == Kind::OffCentre ? moved_hold
                                                 : s.kind == Kind::Shelf   ? s.overhang_mm < 5 * t
                                                                           : s.demand < torn_from;
                                        }),
                                  t);
    EXPECT_TRUE(fit);
    return fit ? to_toml_fragment(*fit, machine) : std::string{};
  };
  EXPECT_THAT(text(false, 250), HasSubstr("tore, so it bears less there than the lever rule says"));
  EXPECT_THAT(text(true, 50), HasSubstr("held, so it bears more there than the lever rule says"));
  EXPECT_THAT(text(true, 250), testing::Not(HasSubstr("lever rule says")));
}

TEST(SupportCalibration, NamesABoundOfOneSideAsSuch) {
  const MachineProfile machine = test::known_machine("machine-b");
  const double t = machine.layers.thickness_mm;
  const auto specimens = support_specimens(machine).value();
  const auto all = fit_supports(where(specimens, [](const auto&) { return true; }), t);
  ASSERT_TRUE(all) << all.error().what;
  EXPECT_EQ(all->demand_ends, KnownEnds::Least);
  EXPECT_EQ(all->overhang_ends, KnownEnds::Least);
  double most = 0;
  for (const SupportSpecimen& s : specimens)
    if (s.kind == Kind::Ladder) most = std::max(most, s.demand);
  EXPECT_NEAR(all->demand.value, most, 0.1 * most);
  EXPECT_THAT(to_toml_fragment(*all, machine), HasSubstr("a lower bound"));
  const auto no_shelf = fit_supports(
      where(specimens, [](const SupportSpecimen& s) { return s.kind != Kind::Shelf && s.demand < 100; }), t);
  ASSERT_TRUE(no_shelf) << no_shelf.error().what;
  EXPECT_FALSE(no_shelf->overhang_share);
  ASSERT_TRUE(no_shelf->overhang_share_below);
  EXPECT_THAT(to_toml_fragment(*no_shelf, machine), HasSubstr("# No shelf is whole"));
}

TEST(SupportCalibration, RefusesWhatNoPrintLeaves) {
  const MachineProfile machine = test::known_machine("machine-b");
  const double t = machine.layers.thickness_mm;
  const auto specimens = support_specimens(machine).value();
  const auto refusal = [&](auto holds) {
    const auto fit = fit_supports(where(specimens, holds), t);
    return fit ? std::string{} : fit.error().what;
  };
  EXPECT_THAT(refusal([](const SupportSpecimen& s) { return s.kind == Kind::Shelf; }), HasSubstr("no disc held"));
  EXPECT_THAT(refusal([](const SupportSpecimen& s) { return s.kind != Kind::Ladder || s.demand > 100; }),
              HasSubstr("discs of higher demand held where discs of lower tore"));
  EXPECT_THAT(
      refusal([&](const SupportSpecimen& s) { return s.kind == Kind::Shelf ? s.overhang_mm > 6 * t : s.demand < 100; }),
      HasSubstr("longer shelves are whole"));
  EXPECT_THAT(fit_supports({}, t).error().what, HasSubstr("0 discs were read; at least 4"));
}

/// The table with every specimen that is below 100 held, and shelves shorter than half.
std::string filled_in(const SupportPrint& print) {
  std::string text;
  std::size_t row = 0;
  for (std::size_t from = 0; from < print.supports_csv.size(); ++row) {
    const auto end = print.supports_csv.find('\n', from);
    text += print.supports_csv.substr(from, end - from);
    if (row > 0) {
      const SupportSpecimen& s = print.specimens.at(row - 1);
      text += s.kind == Kind::Shelf ? s.overhang_mm < 0.3 ? "yes" : "no" : s.demand < 100 ? "yes" : "no";
    }
    text += '\n';
    from = end + 1;
  }
  return text;
}

TEST(SupportReadings, AreReadFromTheTableThatThePrintCameWith) {
  const MachineProfile machine = test::known_machine("machine-b");
  const auto print = support_print(machine);
  ASSERT_TRUE(print);
  const auto readings = support_readings_from_csv(filled_in(*print), machine);
  ASSERT_TRUE(readings) << readings.error().what;
  ASSERT_EQ(readings->size(), print->specimens.size());
  for (const SupportReading& r : *readings)
    EXPECT_EQ(r.held, r.specimen.kind == Kind::Shelf ? r.specimen.overhang_mm < 0.3 : r.specimen.demand < 100);
}

TEST(SupportReadings, NameTheLineThatCannotBe) {
  const MachineProfile machine = test::known_machine("machine-b");
  const auto print = support_print(machine);
  ASSERT_TRUE(print);
  const auto refusal = [&](const std::string& text, const MachineProfile& by) {
    const auto readings = support_readings_from_csv(text, by);
    return readings ? std::string{} : readings.error().what;
  };
  const std::string head = "machine,test,number,demand,overhang_mm,held\n";
  const SupportSpecimen& first = print->specimens.front();
  const std::string row = fmt::format("machine-b,{},1,{:.6g},,", name_of(first.kind), first.demand);
  EXPECT_EQ(refusal(head + row + "yes\n", machine), "");
  EXPECT_THAT(refusal(print->supports_csv, machine), HasSubstr("line 2: held is empty; write yes or no"));
  EXPECT_THAT(refusal(head + row + "maybe\n", machine), HasSubstr("line 2: held is \"maybe\""));
  EXPECT_THAT(refusal(head + row + "yes\n" + row + "no\n", machine), HasSubstr("line 3: number 1 was there before"));
  EXPECT_THAT(refusal(filled_in(*print), test::known_machine("machine-a")),
              HasSubstr("machine is \"machine-b\", and the profile that was chosen is of machine-a"));
  EXPECT_THAT(refusal(head + "machine-b,ladder,999,30,,yes\n", machine), HasSubstr("there is no number 999"));
  EXPECT_THAT(refusal(head + "machine-b,shelf,1,,0.1,yes\n", machine), HasSubstr("test of number 1 is \"shelf\""));
  EXPECT_THAT(refusal(head + fmt::format("machine-b,{},1,12345,,yes\n", name_of(first.kind)), machine),
              HasSubstr("Read the table with the profile that it was printed with"));
  EXPECT_THAT(refusal("machine,test,number,held\n", machine), HasSubstr("no column \"demand\""));
  EXPECT_THAT(refusal("colour,test\n", machine), HasSubstr("unknown column \"colour\""));
  EXPECT_THAT(refusal("", machine), HasSubstr("no measurement"));
}

TEST(SupportPrint, IsRefusedWhereNotAllOfItFits) {
  MachineProfile machine = test::known_machine("machine-b");
  machine.platform.width_mm = 5;
  const auto narrow = support_print(machine);
  ASSERT_FALSE(narrow);
  EXPECT_EQ(narrow.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(narrow.error().what, HasSubstr("do not fit"));
  machine = test::known_machine("machine-b");
  machine.platform.z_travel_mm = 3;
  EXPECT_THAT(support_print(machine).error().what, HasSubstr("the travel is 3.00 mm"));
}

TEST(SupportPrint, IsTheSameEachTime) {
  const MachineProfile machine = test::known_machine("machine-b");
  const auto first = support_print(machine), second = support_print(machine);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->stack, second->stack);
  EXPECT_EQ(first->supports_csv, second->supports_csv);
  EXPECT_EQ(first->map, second->map);
}

}  // namespace
}  // namespace telefab::fab
