// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/region/region.hpp>
#include <telefab/fab/verify/print_files.hpp>
#include <telefab/test/block_stack.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint32_t kLayers = 36;

/// A body with a ragged outline that drifts, grows or shrinks from layer to layer, solid or a shell.
class Body {
 public:
  explicit Body(std::mt19937& random) {
    const auto between = [&](double a, double b) {
      return a + (b - a) * (static_cast<double>(random()) / 4294967296.0);
    };
    at_ = {between(8, 32), between(8, 22)};
    drift_ = {between(-0.15, 0.15), between(-0.15, 0.15)};
    radius_ = std::exp(between(std::log(0.12), std::log(4.5)));
    growth_ = between(-0.12, 0.12);
    first_ = static_cast<std::uint32_t>(between(0, kLayers * 0.7));
    last_ = first_ + static_cast<std::uint32_t>(between(1, kLayers));
    shell_ = between(0, 1) < 0.25 ? between(0.4, 0.9) : 0;
    const int corners = 3 + static_cast<int>(between(0, 20));
    for (int i = 0; i < corners; ++i) outline_.push_back(between(0.5, 1));
  }

  [[nodiscard]] Region at(std::uint32_t k) const {
    if (k < first_ || k > last_) return {};
    const double up = k - first_;
    const double radius = std::clamp(radius_ + growth_ * up, 0.0, 5.0);
    if (radius < 0.02) return {};
    const Region solid = ring(up, radius);
    return shell_ > 0 ? subtract(solid, ring(up, radius * shell_)) : solid;
  }

 private:
  [[nodiscard]] Region ring(double up, double radius) const {
    std::vector<GridRing> rings(1);
    for (std::size_t i = 0; i < outline_.size(); ++i) {
      const double turn = 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(outline_.size());
      const double r = radius * outline_[i];
      rings[0].push_back(to_grid(
          {at_.x_mm + drift_.x_mm * up + r * std::cos(turn), at_.y_mm + drift_.y_mm * up + r * std::sin(turn)}));
    }
    return Region::from_rings(rings, true).value();
  }

  Point2 at_, drift_;
  double radius_ = 0, growth_ = 0, shell_ = 0;
  std::uint32_t first_ = 0, last_ = 0;
  std::vector<double> outline_;
};

LayerStack random_part(std::uint32_t seed) {
  std::mt19937 random{seed};
  std::vector<Body> bodies;
  for (auto i = 2 + random() % 9; i > 0; --i) bodies.emplace_back(random);
  std::vector<std::vector<Contour>> rings;
  for (std::uint32_t k = 0; k < kLayers; ++k) {
    std::vector<Region> found;
    for (const Body& body : bodies) found.push_back(body.at(k));
    rings.push_back(unite(found).to_contours());
  }
  return test::stack_of(rings);
}

/// Tips of two sizes, resin that light goes through deeply or hardly, part by part.
MachineProfile machine_of(std::uint32_t seed) {
  MachineProfile machine = test::small_machine();
  if (seed % 2 == 1) {
    auto& s = machine.supports;
    s.tip_radius_mm = 0.12, s.pin_radius_mm = 0.25, s.foot_radius_mm = 0.5;
    s.clearance_mm = 0.2, s.self_support_mm = 0.05;
  } else if (seed % 4 == 2) {
    machine.resin.penetration_mm = 0.1;
    machine.supports.self_support_mm = 0.3;
  }
  return machine;
}

class RandomParts : public testing::TestWithParam<std::uint32_t> {};

TEST_P(RandomParts, FloatNowhereAndNoPinEndsInResin) {
  const LayerStack stack = random_part(GetParam());
  const MachineProfile machine = machine_of(GetParam());
  const VirtualClock clock;
  const auto plan = plan_job(stack, machine, {}, [](const PlannedImage&) { return Result<void>{}; }, clock, {}, {});
  ASSERT_TRUE(plan) << plan.error().what;
  EXPECT_EQ(plan->check.count(Finding::Kind::Island), 0U) << to_json(plan->check);
  const auto supports = WrittenSupports::from_json(plan->supports_json);
  ASSERT_TRUE(supports);
  PrintGeometry print;
  print.part = stack.layers();
  print.elevation_layers = supports->elevation_layers();
  print.anchors = supports->anchors();
  print.support = [&](LayerIndex k) { return supports->section(k, stack.header().layer_thickness_mm); };
  const auto checked = check_supports(print, machine, {}, {});
  ASSERT_TRUE(checked);
  for (const auto kind : {Finding::Kind::Island, Finding::Kind::OutOfReach, Finding::Kind::FreePin})
    EXPECT_EQ(checked->count(kind), 0U) << name_of(kind) << '\n' << to_json(*checked);
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomParts, testing::Range(0U, 20U));
// A thin strip beside a body, and a ledge that ends with the last layer: once not held, and held by nothing.
INSTANTIATE_TEST_SUITE_P(OnceWrong, RandomParts, testing::Values(1082U, 1143U));

}  // namespace
}  // namespace telefab::fab
