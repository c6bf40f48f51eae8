// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>
#include <sstream>
#include <telefab/fab/cure/size_calibration.hpp>
#include <telefab/fab/planning/drawn_contours.hpp>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using Kind = MeasuredSize::Kind;

MachineProfile printer() {
  MachineProfile m;
  m.name = "m";
  m.platform = {60, 45, 100, 0};
  m.projection.pixel_pitch_mm = 0.05;
  m.layers.thickness_mm = 0.05;
  return m;
}

/// What a synthetic print does to what is drawn.
struct Misprint {
  double shrink_x = 0.011, shrink_y = 0.008, shrink_z = 0.014;
  double edge_mm = 0.02;  ///< all edges lie so far outside
  double hole_mm = 0.07;  ///< radii of holes come out smaller by so much
  double height_offset_mm = -0.03;
  double noise_mm = 0;
};

double width_of(const Contour& c) { return c.bounds().width_mm(); }

/// All lengths of a printed body, as its README asks for them: of each layer's outline and its holes.
std::vector<MeasuredSize> measured(const LayerStack& drawn, const LayerStack& nominal, const Misprint& print,
                                   std::mt19937_64& rng) {
  std::normal_distribution<double> noise{0, 1};
  const auto read = [&](Kind kind, double nominal_mm, double printed_mm) {
    return MeasuredSize{kind, nominal_mm, printed_mm + print.noise_mm * noise(rng)};
  };
  std::vector<MeasuredSize> rows;
  const auto outer = [](const Layer& layer) {
    return *std::find_if(layer.contours.begin(), layer.contours.end(), [](const Contour& c) { return !c.is_hole(); });
  };
  const auto lengths = [&](const LayerStack& stack) {
    // The outline loses a bar at each step: its box gives a length along x, the last layers' boxes those along y.
    std::vector<std::pair<double, double>> steps;  // width, depth
    for (const Layer& layer : stack.layers()) {
      const Bounds2 b = outer(layer).bounds();
      if (steps.empty() || std::abs(steps.back().first - b.width_mm()) > 1e-6)
        steps.emplace_back(b.width_mm(), b.depth_mm());
    }
    return steps;
  };
  const auto is = lengths(drawn), was = lengths(nominal);
  EXPECT_EQ(is.size(), 4u);
  for (std::size_t k = 0; k < std::min(is.size(), was.size()); ++k) {
    rows.push_back(read(Kind::LengthX, was[k].first, is[k].first * (1 - print.shrink_x) + 2 * print.edge_mm));
    rows.push_back(read(Kind::LengthY, was[k].second, is[k].second * (1 - print.shrink_y) + 2 * print.edge_mm));
  }
  const auto steps = [&](const LayerStack& stack) {
    std::vector<double> heights;
    const auto layers = stack.layers();
    for (std::size_t i = 1; i <= layers.size(); ++i)
      if (i == layers.size() || width_of(outer(layers[i])) < width_of(outer(layers[i - 1])) - 1e-6)
        heights.push_back(static_cast<double>(i) * stack.header().layer_thickness_mm);
    return heights;
  };
  const auto high = steps(drawn), meant = steps(nominal);
  EXPECT_EQ(high.size(), meant.size());
  for (std::size_t k = 0; k < std::min(high.size(), meant.size()); ++k)
    rows.push_back(read(Kind::Height, meant[k], high[k] * (1 - print.shrink_z) + print.height_offset_mm));
  const auto diameters = [](const Layer& layer) {
    std::vector<double> all;
    for (const Contour& c : layer.contours)
      if (c.is_hole()) all.push_back(c.bounds().depth_mm());
    std::sort(all.begin(), all.end());
    return all;
  };
  const auto holes = diameters(drawn.layers()[0]), wanted = diameters(nominal.layers()[0]);
  EXPECT_EQ(holes.size(), 4u);
  for (std::size_t k = 0; k < std::min(holes.size(), wanted.size()); ++k)
    rows.push_back(
        read(Kind::Hole, wanted[k], holes[k] * (1 - (print.shrink_x + print.shrink_y) / 2) - 2 * print.hole_mm));
  return rows;
}

/// As the scan site cuts it of the body made larger by drawn_scale(), and the fab grows its holes.
LayerStack drawn_for(const MachineProfile& machine, const LayerStack& nominal) {
  const auto scale = machine.drawn_scale();
  StackHeader header = nominal.header();
  const double t = header.layer_thickness_mm;
  header.layer_count = static_cast<std::uint32_t>(std::ceil(header.layer_count * scale[2] - 0.5));
  std::vector<Layer> layers;
  header.bounds = Bounds2::nothing();
  for (std::uint32_t i = 0; i < header.layer_count; ++i) {
    const double z = cut_height_mm(LayerIndex{i}, t) / scale[2];
    const auto from = std::min<std::size_t>(static_cast<std::size_t>(z / t), nominal.layers().size() - 1);
    Layer layer{LayerIndex{i}, cut_height_mm(LayerIndex{i}, t), {}, {}};
    for (const Contour& ring : nominal.layers()[from].contours) {
      std::vector<Point2> places;
      for (const Point2 p : ring.vertices()) places.push_back({p.x_mm * scale[0], p.y_mm * scale[1]});
      layer.contours.push_back(Contour::from_vertices(std::move(places)).value());
      header.bounds.include(layer.contours.back().bounds());
    }
    layer.contours = sorted_canonically(std::move(layer.contours));
    layers.push_back(std::move(layer));
  }
  const auto stack = LayerStack::from_layers(std::move(header), std::move(layers));
  return with_grown_holes(stack.value(), Millimetres{machine.resin.hole_growth_mm}).value();
}

TEST(SizeArtefact, HasFourLengthsEachWayFourHeightsAndFourHoles) {
  const auto artefact = size_artefact(printer());
  ASSERT_TRUE(artefact) << artefact.error().what;
  std::mt19937_64 rng{1};
  const auto rows = measured(artefact->stack, artefact->stack, {0, 0, 0, 0, 0, 0, 0}, rng);
  std::map<Kind, std::vector<double>> by_kind;
  for (const MeasuredSize& row : rows) by_kind[row.kind].push_back(row.drawn_mm);
  for (const Kind kind : {Kind::LengthX, Kind::LengthY, Kind::Height, Kind::Hole}) {
    auto lengths = by_kind[kind];
    std::sort(lengths.begin(), lengths.end());
    ASSERT_EQ(lengths.size(), 4u);
    EXPECT_EQ(std::adjacent_find(lengths.begin(), lengths.end()), lengths.end()) << "all differ";
  }
  const Bounds2 b = artefact->stack.header().bounds;
  EXPECT_GE(b.min.x_mm, 0);
  EXPECT_LE(b.max.y_mm, printer().platform.depth_mm);
}

TEST(SizeArtefact, AsksForTheVeryLengthsThatItHas) {
  MachineProfile machine = printer();
  machine.resin.hole_growth_mm = 0.05;
  const auto artefact = size_artefact(machine);
  ASSERT_TRUE(artefact);
  std::mt19937_64 rng{1};
  const LayerStack planned = with_grown_holes(artefact->stack, Millimetres{0.05}).value();
  const auto rows = measured(planned, planned, {0, 0, 0, 0, 0, 0, 0}, rng);
  std::multimap<std::string, double> asked;
  std::istringstream lines{artefact->measured_csv};
  std::string line;
  std::getline(lines, line);
  EXPECT_EQ(line, "test,drawn_mm,value,unit");
  while (std::getline(lines, line)) {
    const auto comma = line.find(',');
    asked.emplace(line.substr(0, comma), std::stod(line.substr(comma + 1)));
  }
  EXPECT_EQ(asked.size(), 16u);
  const std::map<Kind, std::string> names{
      {Kind::LengthX, "length-x"}, {Kind::LengthY, "length-y"}, {Kind::Height, "height"}, {Kind::Hole, "hole"}};
  for (const MeasuredSize& row : rows) {
    const auto [from, to] = asked.equal_range(names.at(row.kind));
    EXPECT_TRUE(std::any_of(from, to, [&](const auto& a) { return std::abs(a.second - row.drawn_mm) < 2e-3; }))
        << names.at(row.kind) << ' ' << row.drawn_mm;
  }
}

TEST(SizeArtefact, IsRefusedWhereItWouldTellNothing) {
  MachineProfile machine = printer();
  machine.platform.width_mm = 5;
  const auto refused = size_artefact(machine);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::InvalidInput);
  EXPECT_THAT(refused.error().what, HasSubstr("40 pixels"));
}

// Printed, measured, fitted, printed again with what was fitted, measured again.
TEST(SizeCalibration, MakesTheNextPrintRight) {
  MachineProfile machine = printer();
  const LayerStack nominal = size_artefact(machine)->stack;
  Misprint print;
  print.noise_mm = 0.005;
  std::mt19937_64 rng{7};
  std::vector<MeasuredSize> rows;
  for (int reading = 0; reading < 3; ++reading)
    for (const MeasuredSize& row : measured(nominal, nominal, print, rng)) rows.push_back(row);
  const auto fitted = fit_sizes(rows);
  ASSERT_TRUE(fitted) << fitted.error().what;
  machine = with_sizes(machine, *fitted);
  const auto worst = [&](const LayerStack& drawn, Kind kind) {
    print.noise_mm = 0;
    double most = 0;
    for (const MeasuredSize& row : measured(drawn, nominal, print, rng)) {
      if (row.kind != kind) continue;
      // What no key makes good stays: edges of outlines, and what the first layers do to heights.
      const double stays = kind == Kind::Height ? print.height_offset_mm : kind == Kind::Hole ? 0 : 2 * print.edge_mm;
      most = std::max(most, std::abs(row.measured_mm - row.drawn_mm - stays));
    }
    return most;
  };
  const LayerStack compensated = drawn_for(machine, nominal);
  struct Bound {
    Kind kind;
    const char* name;
    double before_mm, after_mm;
  };
  for (const Bound& bound :
       {Bound{Kind::LengthX, "length-x", 0.4, 0.015}, Bound{Kind::LengthY, "length-y", 0.25, 0.015},
        Bound{Kind::Height, "height", 0.2, 0.025 + 0.01}, Bound{Kind::Hole, "hole", 0.14, 0.012}}) {
    const double before = worst(nominal, bound.kind), after = worst(compensated, bound.kind);
    fmt::print("{:10} off by {:6.1f} um before, {:5.1f} um after\n", bound.name, 1000 * before, 1000 * after);
    EXPECT_GT(before, bound.before_mm) << bound.name;
    EXPECT_LT(after, bound.after_mm) << bound.name;
  }
}

TEST(SizeCalibration, HoldsTheTruthInNineteenOfTwentyIntervals) {
  const LayerStack nominal = size_artefact(printer())->stack;
  Misprint print;
  print.noise_mm = 0.01;
  std::map<std::string, int> held;
  constexpr int kPrints = 300;
  for (int seed = 0; seed < kPrints; ++seed) {
    std::mt19937_64 rng{static_cast<std::uint64_t>(seed)};
    const auto fitted = fit_sizes(measured(nominal, nominal, print, rng));
    ASSERT_TRUE(fitted) << fitted.error().what;
    const auto count = [&](const char* name, const std::optional<FittedFigure>& f, double truth) {
      held[name] += f->least <= truth && truth <= f->most;
    };
    count("x", fitted->shrink_x_percent, 1.1);
    count("y", fitted->shrink_y_percent, 0.8);
    count("z", fitted->shrink_z_percent, 1.4);
    count("hole", fitted->hole_growth_mm, print.hole_mm);
    count("edge", fitted->edge_mm, print.edge_mm);
    count("offset", fitted->height_offset_mm, print.height_offset_mm);
  }
  for (const auto& [name, count] : held) {
    EXPECT_GT(count, 0.91 * kPrints) << name;
    EXPECT_LT(count, 0.99 * kPrints) << name;
  }
}

TEST(SizeCalibration, FitsWhatWasMeasuredAloneAndSaysItInKeys) {
  std::vector<MeasuredSize> rows;
  for (const double mm : {5.0, 10.0, 20.0, 40.0}) rows.push_back({Kind::Height, mm, mm * 0.99 + 0.001 * (mm == 10)});
  const auto fitted = fit_sizes(rows);
  ASSERT_TRUE(fitted) << fitted.error().what;
  EXPECT_FALSE(fitted->shrink_x_percent || fitted->hole_growth_mm || fitted->edge_mm);
  EXPECT_NEAR(fitted->shrink_z_percent->value, 1, 0.02);
  const std::string text = to_toml_fragment(*fitted);
  EXPECT_THAT(text, HasSubstr("[resin]\nshrink_z_percent = "));
  EXPECT_THAT(text, testing::Not(HasSubstr("shrink_x_percent")));
  EXPECT_EQ(with_sizes(printer(), *fitted).resin.shrink_z_percent, fitted->shrink_z_percent->value);
}

TEST(SizeCalibration, SaysWhatItLacks) {
  const auto lacks = [](std::vector<MeasuredSize> rows) {
    const auto fitted = fit_sizes(rows);
    return fitted ? std::string{} : fitted.error().what;
  };
  EXPECT_THAT(lacks({}), HasSubstr("no measurement"));
  EXPECT_THAT(lacks({{Kind::LengthX, 10, 9.9}, {Kind::LengthX, 10, 9.9}, {Kind::LengthX, 10, 9.9}}),
              HasSubstr("length-x: 3 readings of 1 drawn lengths"));
  EXPECT_THAT(lacks({{Kind::Hole, 3, 2.9}, {Kind::Hole, 4, 3.9}}), HasSubstr("hole: holes shrink with lengths"));
  EXPECT_THAT(lacks({{Kind::Height, 10, 8}, {Kind::Height, 20, 16.001}, {Kind::Height, 30, 24}}),
              HasSubstr("shrinkage along z (%) is 20"));
}

TEST(SizeCalibration, RefusesABadLineAndNamesIt) {
  const std::string head = "test,drawn_mm,value,unit\n";
  const auto refused = [&](const std::string& rows) {
    const auto read = sizes_from_csv(head + rows);
    return read ? std::string{} : read.error().what;
  };
  EXPECT_EQ(refused("length-x,10,9.9,mm\n# note\nhole,3,2950,um\n"), "");
  EXPECT_THAT(refused("width,10,9.9,mm\n"), HasSubstr("line 2: unknown test \"width\""));
  EXPECT_THAT(refused("hole,10,,mm\n"), HasSubstr("line 2: value is empty"));
  EXPECT_THAT(refused("hole,10,9.9,inch\n"), HasSubstr("unit is \"inch\""));
  EXPECT_THAT(refused("hole,10,9900,mm\n"), HasSubstr("look at the unit"));
  EXPECT_THAT(refused(""), HasSubstr("no measurement"));
  EXPECT_THAT(sizes_from_csv("test,value,unit\nhole,1,mm\n").error().what, HasSubstr("no column \"drawn_mm\""));
}

}  // namespace
}  // namespace telefab::fab
