// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/test/grid_block.hpp>

namespace telefab::scan {
namespace {

struct Case {
  test::GridBlock block;
  friend void PrintTo(const Case& c, std::ostream* out) {
    *out << "step " << c.block.step_mm << " turn " << c.block.turn_deg << " noise " << c.block.noise_mm;
  }
};

std::vector<Case> cases() {
  std::vector<Case> all;
  for (const double step : {0.3, 0.45, 0.7, 1.0})
    for (const double turn : {0.0, 1.0, 5.0})
      for (const double noise : {0.0, 0.03, 0.1}) all.push_back({{step, turn, noise}});
  return all;
}

class GridBlockProperty : public testing::TestWithParam<Case> {};

TEST_P(GridBlockProperty, HasNoEmptyLayerOverItsSamplesAndNearlyAllCertified) {
  std::string text;
  double low = 1e9, high = -1e9;
  for (const Eigen::Vector3d& p : test::points_of(GetParam().block)) {
    text += fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
    low = std::min(low, p.z());
    high = std::max(high, p.z());
  }
  SliceRequest request;
  request.machine.name = "bench";
  request.machine.platform = {60, 40, 50};
  request.machine.projection.pixel_pitch_mm = 0.1;
  request.machine.layers.thickness_mm = 0.15;
  std::size_t empty = 0, wrong = 0, seen = 0, certified = 0;
  const double margin_mm = GetParam().block.step_mm / 2 + 2 * GetParam().block.noise_mm;
  const LayerSink sink = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    if (layer.z_mm < margin_mm || layer.z_mm > high - low - margin_mm) return {};
    ++seen;
    empty += layer.contours.empty();
    certified += layer.certificate.is_certified();
    wrong += layer.certificate.is_certified() && layer.contours.size() != 1;
    return {};
  };
  const auto report = slice_scan(std::as_bytes(std::span{text}), "block.xyz", request, sink, {}, {});
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_GT(seen, 50U);
  EXPECT_EQ(empty, 0U);
  EXPECT_EQ(wrong, 0U);
  EXPECT_GE(certified, 0.85 * static_cast<double>(seen));
}
INSTANTIATE_TEST_SUITE_P(StepsTurnsNoises, GridBlockProperty, testing::ValuesIn(cases()));

/// Points of a cylinder on a grid, as coordinate machines give them: rows about the wall, a square grid on either end.
void add_cylinder(std::string& text, double radius, double low, double high, double step) {
  const int around = static_cast<int>(2 * std::numbers::pi * radius / step) + 1;
  const int rows = static_cast<int>((high - low) / step);
  for (int row = 0; row < rows; ++row)
    for (int i = 0; i < around; ++i) {
      const double angle = 2 * std::numbers::pi * i / around;
      text += fmt::format("{} {} {}\n", radius * std::cos(angle), radius * std::sin(angle),
                          low + (row + 0.5) * (high - low) / rows);
    }
  for (const double z : {low, high})
    for (double x = -radius; x <= radius; x += step)
      for (double y = -radius; y <= radius; y += step)
        if (std::hypot(x, y) <= radius) text += fmt::format("{} {} {}\n", x, y, z);
}

// Two bodies that touch, each sampled for itself: their faces lie on each other inside the part, and the field between
// them is nobody's.
TEST(Mushroom, HasContoursInEveryLayerThoughStemAndCapAreTwoBodies) {
  std::string text;
  add_cylinder(text, 2, 0, 10, 0.3);
  add_cylinder(text, 8, 10, 12, 0.4);
  SliceRequest request;
  request.machine.name = "bench";
  request.machine.platform = {60, 40, 50};
  request.machine.projection.pixel_pitch_mm = 0.1;
  request.machine.layers.thickness_mm = 0.15;
  request.layers = {{55, 75}};
  std::size_t seen = 0;
  const LayerSink sink = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    ++seen;
    EXPECT_FALSE(layer.contours.empty()) << layer.z_mm;
    return {};
  };
  const auto report = slice_scan(std::as_bytes(std::span{text}), "mushroom.xyz", request, sink, {}, {});
  ASSERT_TRUE(report) << report.error().what;
  EXPECT_EQ(seen, 21U);
}

}  // namespace
}  // namespace telefab::scan
