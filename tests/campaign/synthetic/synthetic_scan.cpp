// SPDX-License-Identifier: GPL-3.0-or-later
#include "synthetic_scan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace telefab::campaign {
namespace {

using scan::Vec3;
using test::Solid;
using test::SurfaceSamples;

constexpr double kLayers = 40;

struct Dice {
  explicit Dice(std::uint64_t seed) : random{seed} {}
  double uniform() { return (static_cast<double>(random() >> 11U) + 0.5) * 0x1p-53; }
  double normal() { return std::sqrt(-2 * std::log(uniform())) * std::cos(2 * std::numbers::pi * uniform()); }
  Vec3 bell() { return {normal(), normal(), normal()}; }
  std::mt19937_64 random;
};

class Cases {
 public:
  std::vector<SyntheticScan> scans;

  void add(std::string kind, std::string name, const Solid& solid, double spacing, bool bare,
           const std::function<void(SurfaceSamples&, Dice&)>& damage = {}) {
    const std::uint64_t seed = 1 + scans.size();
    const auto samples = [solid, spacing, seed, damage] {
      SurfaceSamples found = test::sample_solid(solid, spacing, seed);
      Dice dice{1000 + seed};
      if (damage) damage(found, dice);
      return found;
    };
    scans.push_back({std::move(kind), std::move(name), solid, spacing, samples, bare});
  }
};

/// A body with a handle: two critical points where the handle leaves it, two where it comes back.
Solid body_with_handle(double ring, double tube) {
  return joined(test::solid_box({8, 5, 5}, 1), shifted(turned(test::solid_ring(ring, tube), 90, {1, 0, 0}), {8, 0, 0}));
}

constexpr double kPinMm = 1.2;
constexpr double kPinHighMm = 12;

Vec3 foot_of_pin(int pin) { return {5.0 * (pin % 3), 5.0 * (pin / 3), 0}; }

Solid pins() {
  const auto pin = [](int k) {
    return test::solid_pin(foot_of_pin(k), foot_of_pin(k) + kPinHighMm * Vec3::UnitZ(), kPinMm);
  };
  Solid all = pin(0);
  for (int k = 1; k < 6; ++k) all = joined(std::move(all), pin(k));
  return all;
}

/// The pins in rows of one height, samples in a row `ratio` times as dense as the rows are apart.
SurfaceSamples pins_in_rows(double row_mm, double ratio) {
  SurfaceSamples rows;
  for (int pin = 0; pin < 6; ++pin)
    for (double z = -kPinMm + row_mm / 3; z < kPinHighMm + kPinMm; z += row_mm) {
      const double beyond = z < 0 ? z : std::max(z - kPinHighMm, 0.0);
      const double around = std::sqrt(kPinMm * kPinMm - beyond * beyond);
      const int count = std::max(1, static_cast<int>(2 * std::numbers::pi * around * ratio / row_mm));
      for (int k = 0; k < count; ++k) {
        const double angle = 2 * std::numbers::pi * k / count;
        const Vec3 out = around * Vec3{std::cos(angle), std::sin(angle), 0};
        rows.points.push_back(foot_of_pin(pin) + out + z * Vec3::UnitZ());
        rows.normals.push_back((out + beyond * Vec3::UnitZ()) / kPinMm);
      }
    }
  return rows;
}

void add_outliers(SurfaceSamples& samples, const Solid& solid, double share, Dice& dice) {
  const Vec3 size = solid.box.max - solid.box.min, middle = (solid.box.min + solid.box.max) / 2;
  const auto count = static_cast<std::size_t>(share * static_cast<double>(samples.points.size()));
  for (std::size_t i = 0; i < count; ++i) {
    samples.points.push_back(
        middle + 0.65 * size.cwiseProduct(Vec3{dice.uniform(), dice.uniform(), dice.uniform()} * 2 - Vec3::Ones()));
    samples.normals.push_back(dice.bell().normalized());
  }
}

/// Points between the edge of a near surface and what lies behind it, as seen along x: moved back by up to a fifth of
/// the size.
void mix_pixels(SurfaceSamples& samples, const Solid& solid, double share, Dice& dice) {
  const double depth = 0.2 * (solid.box.max - solid.box.min).norm();
  std::vector<std::size_t> edge;
  for (std::size_t i = 0; i < samples.points.size(); ++i)
    if (std::abs(samples.normals[i].x()) < 0.15) edge.push_back(i);
  if (edge.empty()) return;
  const auto count = static_cast<std::size_t>(share * static_cast<double>(samples.points.size()));
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t at = edge[dice.random() % edge.size()];
    samples.points.push_back(samples.points[at] + depth * dice.uniform() * Vec3::UnitX());
    samples.normals.push_back(samples.normals[at]);
  }
}

void double_sheets(SurfaceSamples& samples, double by_mm, Dice& dice) {
  const Vec3 shift = by_mm * dice.bell().normalized();
  for (std::size_t i = 1; i < samples.points.size(); i += 2) samples.points[i] += shift;
}

void add_noise(SurfaceSamples& samples, double by_mm, Dice& dice) {
  for (Vec3& p : samples.points) p += by_mm * dice.bell();
}

struct Body {
  std::string name;
  Solid solid;
};

std::vector<Body> bodies() {
  return {{"ball", test::solid_ball({0, 0, 0}, 8)},
          {"handle", turned(body_with_handle(5, 1.6), 25, {1, 2, 3})},
          {"spring", turned(test::solid_spring(6, 1.6, 7, 2.5), 20, {1, 1, 0})},
          {"pins", turned(pins(), 8, {1, 3, 0})}};
}

}  // namespace

std::vector<SyntheticScan> synthetic_scans() {
  Cases cases;
  for (const double away : {1.5, 3.0, 10.0, 50.0})
    for (const bool bare : {false, true})
      for (const double spacing : {0.4, 0.8})
        cases.add("stray point", fmt::format("{} radii away, spacing {}, bare {}", away, spacing, bare),
                  test::solid_ball({0, 0, 0}, 8), spacing, bare, [=](SurfaceSamples& s, Dice& dice) {
                    Vec3 way = dice.bell().normalized();
                    way.z() = -std::abs(way.z());
                    s.points.push_back(8 * away * way);
                    s.normals.push_back(dice.bell().normalized());
                  });
  for (const double gap : {-0.5, -0.1, 0.0, 0.5, 1.0, 2.0, 4.0})
    for (const double lean : {0.0, 35.0, 90.0})
      for (const bool bare : {false, true})
        cases.add(
            "touching balls", fmt::format("{} spacings apart, leaning {}, bare {}", gap, lean, bare),
            turned(joined(test::solid_ball({-6 - 0.25 * gap, 0, 0}, 6), test::solid_ball({6 + 0.25 * gap, 0, 0}, 6)),
                   lean, {0, 1, 0}),
            0.5, bare);
  for (const double ratio : {1.0, 2.0, 5.0, 10.0})
    for (const double row : {0.4, 0.6}) {
      cases.add("pins on scan lines", fmt::format("rows {} apart, {} to 1", row, ratio), pins(), row, false);
      cases.scans.back().samples = [row, ratio] { return pins_in_rows(row, ratio); };
    }
  for (const double wire : {1.0, 1.5, 2.0})
    for (const double pitch : {1.25, 1.6, 2.5})
      for (const double lean : {0.0, 30.0, 90.0})
        cases.add("springs", fmt::format("wire {}, pitch {} wires, leaning {}", wire, pitch, lean),
                  turned(test::solid_spring(7, wire, 2 * pitch * wire, 2.3), lean, {1, 0, 0}), 0.45, lean == 30.0);
  for (const double spacings : {1.0, 1.5, 2.0, 3.0, 5.0})
    for (const double lean : {0.0, 10.0, 40.0})
      for (const bool bare : {false, true})
        cases.add("walls", fmt::format("{} spacings thick, leaning {}, bare {}", spacings, lean, bare),
                  turned(test::solid_box({8, 0.25 * spacings, 8}, 0.2 * spacings), lean, {1, 0.2, 0}), 0.5, bare);
  for (const double tube : {0.7, 1.0, 1.5, 2.5})
    for (const double lean : {0.0, 25.0, 70.0})
      for (const bool bare : {false, true})
        cases.add("handles", fmt::format("tube {}, leaning {}, bare {}", tube, lean, bare),
                  turned(body_with_handle(5, tube), lean, {1, 2, 3}), 0.5, bare);
  for (const Body& body : bodies()) {
    for (const double by : {0.25, 0.5, 1.0})
      cases.add("doubled sheets", fmt::format("{}, by {} spacings", body.name, by), body.solid, 0.45, false,
                [=](SurfaceSamples& s, Dice& dice) { double_sheets(s, 0.45 * by, dice); });
    for (const double share : {0.003, 0.01})
      for (const bool bare : {false, true})
        cases.add("mixed pixels", fmt::format("{}, {} %, bare {}", body.name, 100 * share, bare), body.solid, 0.45,
                  bare, [=](SurfaceSamples& s, Dice& dice) { mix_pixels(s, body.solid, share, dice); });
    for (const double share : {0.01, 0.05})
      for (const bool bare : {false, true})
        cases.add("outliers", fmt::format("{}, {} %, bare {}", body.name, 100 * share, bare), body.solid, 0.45, bare,
                  [=](SurfaceSamples& s, Dice& dice) { add_outliers(s, body.solid, share, dice); });
    for (const double noise : {0.0, 0.1, 0.3})
      cases.add("noise", fmt::format("{}, {} spacings", body.name, noise), body.solid, 0.45, false,
                [=](SurfaceSamples& s, Dice& dice) { add_noise(s, 0.45 * noise, dice); });
  }
  return std::move(cases.scans);
}

SyntheticVerdict& SyntheticVerdict::operator+=(const SyntheticVerdict& other) {
  right_certified += other.right_certified;
  wrong_certified += other.wrong_certified;
  right_flagged += other.right_flagged;
  wrong_flagged += other.wrong_flagged;
  critical += other.critical;
  seconds += other.seconds;
  worst_over_median = std::max(worst_over_median, other.worst_over_median);
  return *this;
}

Result<SyntheticVerdict> judge(const SyntheticScan& scan) {
  std::string text;
  const SurfaceSamples samples = scan.samples();
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    const Vec3 &p = samples.points[i], &n = samples.normals[i];
    text += scan.bare ? fmt::format("{} {} {}\n", p.x(), p.y(), p.z())
                      : fmt::format("{} {} {} {} {} {}\n", p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  scan::SliceRequest request;
  request.machine.name = "campaign";
  request.machine.platform = {1e4, 1e4, 1e4};
  request.machine.projection.pixel_pitch_mm = 0.1;
  request.placement.scale = 1;
  request.layer_mm = std::min(1.0, (scan.solid.box.max - scan.solid.box.min).z() / kLayers);
  std::vector<Layer> layers;
  const auto take = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    layers.push_back(std::move(layer));
    return {};
  };
  const auto report = scan::slice_scan(std::as_bytes(std::span{text}), "synthetic.xyz", request, take, {}, {});
  if (!report) return tl::unexpected{report.error()};

  SyntheticVerdict verdict;
  for (const auto& t : report->times) verdict.seconds += t.seconds;
  const scan::LayerCosts costs = layer_costs(*report);
  verdict.worst_over_median =
      static_cast<double>(costs.most) / static_cast<double>(std::max<std::uint64_t>(1, costs.median));
  const double rise = report->header.scan_to_build[11], h = report->kernel.kernel_mm;
  const double pitch = scan.spacing_mm / 5;
  for (const Layer& layer : layers) {
    test::SliceCount found;
    for (const Contour& ring : layer.contours) ++(ring.is_hole() ? found.holes : found.outers);
    const double z = layer.z_mm - rise;
    const auto at = [&](double kernels, double offset_kernels) {
      return test::count_slice(scan.solid, z + kernels * h, pitch, offset_kernels * h);
    };
    bool right = found == at(0, 0);
    if (!right) {
      for (const double share : {-0.1, -0.05, 0.05, 0.1})
        right = right || found == at(share, 0) || found == at(0, share);
      verdict.critical += right;
    }
    const bool certified = layer.certificate.is_certified();
    ++(certified ? right ? verdict.right_certified : verdict.wrong_certified
       : right   ? verdict.right_flagged
                 : verdict.wrong_flagged);
    if (certified && !right) {
      const test::SliceCount exact = at(0, 0);
      verdict.lines.push_back(fmt::format("layer {} at {:.2f} of the body: {}+{} rings, the body {}+{}",
                                          layer.index.count(), z, found.outers, found.holes, exact.outers,
                                          exact.holes));
    }
  }
  return verdict;
}

}  // namespace telefab::campaign
