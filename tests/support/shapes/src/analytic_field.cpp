// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/analytic_field.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "jet.hpp"

namespace telefab::test {
namespace {

// Formulas are generic lambdas over (x, y, z), each a double or a Jet; std:: and Jet functions are found together.
using std::abs;
using std::cos;
using std::exp;
using std::max;
using std::min;
using std::sin;
using std::sqrt;

template <class T>
T squared(const T& a) {
  return a * a;
}
template <class T>
T length(const T& x, const T& y) {
  return sqrt(squared(x) + squared(y));
}
template <class T>
T length(const T& x, const T& y, const T& z) {
  return sqrt(squared(x) + squared(y) + squared(z));
}
/// Larger of two, rounded over a width of about `round`.
template <class T>
T smooth_max(const T& a, const T& b, double round) {
  return T{0.5} * (a + b + sqrt(squared(a - b) + T{round * round}));
}
template <class T>
T box_distance(const T& x, const T& y, const T& z, const Vec3& half, double edge) {
  const T qx = abs(x) - T{half.x() - edge};
  const T qy = abs(y) - T{half.y() - edge};
  const T qz = abs(z) - T{half.z() - edge};
  const T zero{0.0};
  return length(max(qx, zero), max(qy, zero), max(qz, zero)) + min(max(qx, max(qy, qz)), zero) - T{edge};
}

template <class Formula>
class FormulaCursor final : public scan::FieldCursor {
 public:
  FormulaCursor(const Formula& formula, const Pose& pose, double kernel_mm)
      : formula_{formula}, pose_{pose}, kernel_mm_{kernel_mm} {}

  scan::FieldSample at(const Vec3& point_mm) override {
    const Vec3 local = pose_.rotation.transpose() * (point_mm - pose_.shift_mm);
    std::array<Jet, 3> axis;
    for (int i = 0; i < 3; ++i) {
      axis[i].v = local[i];
      axis[i].g = pose_.rotation.col(i);
    }
    const Jet f = formula_(axis[0], axis[1], axis[2]);
    scan::FieldSample sample;
    const double steepness = f.g.norm();
    if (!(steepness > 1e-12)) return sample;
    sample.value_mm = f.v / steepness;
    sample.gradient = f.g / steepness - f.v / (steepness * steepness * steepness) * (f.h * f.g);
    sample.closeness_mm = sample.value_mm;
    sample.in_reach = std::abs(sample.value_mm) <= 3 * kernel_mm_;
    return sample;
  }

 private:
  const Formula& formula_;
  const Pose& pose_;
  double kernel_mm_;
};

template <class Formula>
class FormulaField final : public AnalyticField {
 public:
  FormulaField(Formula formula, Pose pose, double reach_mm, double kernel_mm, ShapeFacts facts)
      : formula_{std::move(formula)},
        pose_{pose},
        reach_mm_{reach_mm},
        kernel_mm_{kernel_mm},
        facts_{std::move(facts)} {
    for (auto* heights : {&facts_.minima_mm, &facts_.saddles_mm, &facts_.maxima_mm}) {
      for (double& z : *heights) z += pose_.shift_mm.z();
      std::sort(heights->begin(), heights->end());
    }
  }

  std::unique_ptr<scan::FieldCursor> cursor() const override {
    return std::make_unique<FormulaCursor<Formula>>(formula_, pose_, kernel_mm_);
  }
  scan::Box3 bounds() const override {
    return {pose_.shift_mm - Vec3::Constant(reach_mm_), pose_.shift_mm + Vec3::Constant(reach_mm_)};
  }
  double kernel_width_mm(const Vec3&) const override { return kernel_mm_; }
  const ShapeFacts& facts() const override { return facts_; }
  bool inside(const Vec3& point_mm) const override { return formula(point_mm) < 0; }
  double formula(const Vec3& point_mm) const override {
    const Vec3 p = pose_.rotation.transpose() * (point_mm - pose_.shift_mm);
    return formula_(p.x(), p.y(), p.z());
  }

 private:
  Formula formula_;
  Pose pose_;
  double reach_mm_;
  double kernel_mm_;
  ShapeFacts facts_;
};

template <class Formula>
Shape make(Formula formula, Pose pose, double reach_mm, double kernel_mm, ShapeFacts facts) {
  return std::make_unique<FormulaField<Formula>>(std::move(formula), pose, reach_mm, kernel_mm, std::move(facts));
}

class GappedField final : public AnalyticField {
 public:
  GappedField(Shape whole, const Vec3& centre_mm, double radius_mm)
      : whole_{std::move(whole)}, centre_mm_{centre_mm}, radius_mm_{radius_mm} {}

  std::unique_ptr<scan::FieldCursor> cursor() const override { return std::make_unique<Cursor>(*this); }
  scan::Box3 bounds() const override { return whole_->bounds(); }
  double kernel_width_mm(const Vec3& p) const override { return whole_->kernel_width_mm(p); }
  const ShapeFacts& facts() const override { return whole_->facts(); }
  bool inside(const Vec3& p) const override { return whole_->inside(p); }
  double formula(const Vec3& p) const override { return whole_->formula(p); }

 private:
  class Cursor final : public scan::FieldCursor {
   public:
    explicit Cursor(const GappedField& field) : field_{field}, whole_{field.whole_->cursor()} {}
    scan::FieldSample at(const Vec3& p) override {
      scan::FieldSample sample = whole_->at(p);
      sample.in_reach = sample.in_reach && (p - field_.centre_mm_).norm() > field_.radius_mm_;
      return sample;
    }

   private:
    const GappedField& field_;
    std::unique_ptr<scan::FieldCursor> whole_;
  };

  Shape whole_;
  Vec3 centre_mm_;
  double radius_mm_;
};

bool upright(const Pose& pose) { return pose.rotation.col(2).isApprox(Vec3::UnitZ()); }

}  // namespace

Pose Pose::turned(double degrees, const Vec3& axis, const Vec3& shift_mm) {
  const Eigen::AngleAxisd turn{degrees * std::numbers::pi / 180, axis.normalized()};
  return {turn.toRotationMatrix(), shift_mm};
}

Shape sphere(double radius_mm, double kernel_mm, Pose pose) {
  return make([=](const auto& x, const auto& y, const auto& z) { return length(x, y, z) - radius_mm; }, pose,
              radius_mm + kernel_mm, kernel_mm, {"sphere", 2, {0}, {-radius_mm}, {}, {radius_mm}});
}

Shape gapped(Shape whole, const Vec3& centre_mm, double radius_mm) {
  return std::make_unique<GappedField>(std::move(whole), centre_mm, radius_mm);
}

Shape ellipsoid(const Vec3& half_axes_mm, double kernel_mm, Pose pose) {
  const double top = (pose.rotation * half_axes_mm.asDiagonal()).row(2).norm();
  const Vec3 a = half_axes_mm;
  return make(
      [a](const auto& x, const auto& y, const auto& z) { return length(x / a.x(), y / a.y(), z / a.z()) - 1.0; }, pose,
      a.maxCoeff() + kernel_mm, kernel_mm, {"ellipsoid", 2, {0}, {-top}, {}, {top}});
}

Shape torus(double ring_mm, double tube_mm, double lean_degrees, double kernel_mm, const Vec3& shift_mm) {
  const double rise = ring_mm * std::sin(lean_degrees * std::numbers::pi / 180);
  ShapeFacts facts{"torus", 0, {1}, {}, {}, {}};
  if (lean_degrees != 0) {
    facts.minima_mm = {-rise - tube_mm};
    facts.saddles_mm = {-rise + tube_mm, rise - tube_mm};
    facts.maxima_mm = {rise + tube_mm};
  }
  return make([=](const auto& x, const auto& y, const auto& z) { return length(length(x, y) - ring_mm, z) - tube_mm; },
              Pose::turned(lean_degrees, Vec3::UnitY(), shift_mm), ring_mm + tube_mm + kernel_mm, kernel_mm,
              std::move(facts));
}

Shape genus_two(double size_mm, double kernel_mm, Pose pose) {
  constexpr double kThick = 0.015;
  ShapeFacts facts{"genus-2", -2, {2}, {}, {}, {}};
  if (upright(pose)) {
    // On the long axis q(u) = u^2 (1 - u^2) = +-sqrt(kThick): the tips, then both ends of each hole.
    const double t = std::sqrt(kThick);
    const double tip = size_mm * std::sqrt((1 + std::sqrt(1 + 4 * t)) / 2);
    const double far = size_mm * std::sqrt((1 + std::sqrt(1 - 4 * t)) / 2);
    const double near = size_mm * std::sqrt((1 - std::sqrt(1 - 4 * t)) / 2);
    facts.minima_mm = {-tip};
    facts.saddles_mm = {-far, -near, near, far};
    facts.maxima_mm = {tip};
  }
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        const auto u = z / size_mm;
        const auto q = squared(u) * (1.0 - squared(u)) - squared(x / size_mm);
        return squared(q) + 0.5 * squared(y / size_mm) - kThick;
      },
      pose, 1.1 * size_mm + kernel_mm, kernel_mm, std::move(facts));
}

Shape two_bumps(double size_mm, double kernel_mm, Pose pose) {
  const double s = size_mm;
  return make(
      [s](const auto& x, const auto& y, const auto& z) {
        const auto ball = [&](double cx, double cy, double cz, double r) {
          return exp(-1.0 * (squared(x - cx * s) + squared(y - cy * s) + squared(z - cz * s)) / (r * r * s * s));
        };
        return 0.5 - ball(0, 0, 0, 0.8) - ball(0.62, 0.03, 0.66, 0.36) - ball(-0.6, -0.05, 0.78, 0.36);
      },
      pose, 1.5 * size_mm + kernel_mm, kernel_mm, {"two bumps", 2, {0}, {}, {}, {}});
}

Shape ball_with_knobs(double radius_mm, double kernel_mm) {
  // A knob lower than .06 radii has no top of its own.
  const double lean = 0.4, width = 0.075 * radius_mm, knob = 0.065 * radius_mm;
  const double y0 = radius_mm * std::sin(lean) / 1.2, z0 = radius_mm * std::cos(lean);
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        const auto on = [&](double side) {
          return exp(-0.5 * (squared(x) + squared(y - side * y0) + squared(z - z0)) / (width * width));
        };
        return length(x, 1.2 * y, z) - radius_mm - knob * (on(1) + on(-1));
      },
      Pose{}, 1.1 * radius_mm + kernel_mm, kernel_mm, {"ball with knobs", 2, {0}, {}, {}, {}});
}

Shape thin_wall(double width_mm, double height_mm, double thickness_mm, double kernel_mm) {
  const Vec3 half{width_mm / 2, thickness_mm / 2, height_mm / 2};
  const Pose pose{(Eigen::AngleAxisd{0.31, Vec3::UnitX()} * Eigen::AngleAxisd{0.47, Vec3::UnitY()}).toRotationMatrix(),
                  Vec3::Zero()};
  return make(
      [=](const auto& x, const auto& y, const auto& z) { return box_distance(x, y, z, half, 0.499 * thickness_mm); },
      pose, half.norm() + kernel_mm, kernel_mm, {"thin wall", 2, {0}, {}, {}, {}});
}

Shape near_touching_balls(double radius_mm, double gap_mm, double kernel_mm) {
  const double small = 0.7 * radius_mm;
  const double lift = 0.2 * radius_mm;
  const double apart = radius_mm + small + gap_mm;
  const double dx = std::sqrt(apart * apart - lift * lift);
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        return min(length(x + dx / 2, y, z) - radius_mm, length(x - dx / 2, y, z - lift) - small);
      },
      {}, dx / 2 + radius_mm + kernel_mm, kernel_mm,
      {"near-touching balls", 4, {0, 0}, {-radius_mm, lift - small}, {}, {radius_mm, lift + small}});
}

Shape flat_box(const Vec3& half_sizes_mm, double edge_mm, double kernel_mm, Pose pose) {
  const Vec3 half = half_sizes_mm;
  return make([=](const auto& x, const auto& y, const auto& z) { return box_distance(x, y, z, half, edge_mm); }, pose,
              half.norm() + kernel_mm, kernel_mm, {"flat box", 2, {0}, {}, {}, {}});
}

Shape stepped_box(double size_mm, double edge_mm, double kernel_mm) {
  const double s = size_mm;
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        const auto base = box_distance(x, y, z + 0.25 * s, Vec3{0.5 * s, 0.4 * s, 0.25 * s}, edge_mm);
        const auto tower = box_distance(x + 0.1 * s, y, z - 0.05 * s, Vec3{0.2 * s, 0.2 * s, 0.35 * s}, edge_mm);
        return min(base, tower);
      },
      {}, size_mm + kernel_mm, kernel_mm, {"stepped box", 2, {0}, {}, {}, {}});
}

Shape bored_plate(int holes, double thickness_mm, double edge_mm, double kernel_mm) {
  const double pitch = 6 * thickness_mm;
  const double bore = 1.6 * thickness_mm;
  const Vec3 half{pitch * holes / 2, pitch / 2, thickness_mm / 2};
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        auto solid = box_distance(x, y, z, half, edge_mm);
        for (int i = 0; i < holes; ++i)
          solid = smooth_max(solid, bore - length(x - pitch * (i - 0.5 * (holes - 1)), y), edge_mm);
        return solid;
      },
      {}, half.norm() + kernel_mm, kernel_mm, {"bored plate", 2 - 2 * holes, {holes}, {}, {}, {}});
}

Shape hollow_sphere(double radius_mm, double wall_mm, double kernel_mm) {
  const double inner = radius_mm - wall_mm;
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        const auto r = length(x, y, z);
        return max(r - radius_mm, inner - r);
      },
      {}, radius_mm + kernel_mm, kernel_mm, {"hollow sphere", 4, {0, 0}, {-radius_mm, -inner}, {}, {inner, radius_mm}});
}

Shape bowl(double radius_mm, double wall_mm, double kernel_mm) {
  const double inner = radius_mm - wall_mm;
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        const auto shell = smooth_max(length(x, y, z) - radius_mm, inner - length(x, y, z), 0.5 * wall_mm);
        return smooth_max(shell, z - 0.3 * radius_mm, 0.5 * wall_mm);
      },
      Pose::turned(17, Vec3::UnitY()), radius_mm + kernel_mm, kernel_mm, {"bowl", 2, {0}, {}, {}, {}});
}

Shape gyroid_ball(double radius_mm, double period_mm, double kernel_mm) {
  const double k = 2 * std::numbers::pi / period_mm;
  return make(
      [=](const auto& x, const auto& y, const auto& z) {
        const auto a = k * x + 0.3;
        const auto b = k * y + 0.9;
        const auto c = k * z + 0.5;
        const auto network = (sin(a) * cos(b) + sin(b) * cos(c) + sin(c) * cos(a) + 0.25) / (1.2 * k);
        return smooth_max(network, length(x, y, z) - radius_mm, 0.3 * period_mm);
      },
      Pose::turned(23, Vec3{1, 0.4, 0.2}), radius_mm + kernel_mm, kernel_mm, {"gyroid ball", {}, {}, {}, {}, {}});
}

Shape bumpy(double radius_mm, double kernel_mm) {
  struct Wave {
    double x, y, z, phase, height;
  };
  const std::array waves{Wave{3.1, 1.2, -0.7, 0.4, 0.06},  Wave{-1.4, 4.2, 2.1, 1.9, 0.045},
                         Wave{5.5, -3.0, 4.1, 2.7, 0.03},  Wave{-7.3, 6.4, 3.2, 0.1, 0.016},
                         Wave{4.6, 8.9, -7.0, 3.3, 0.012}, Wave{-9.7, -5.1, 8.3, 5.0, 0.008}};
  return make(
      [radius_mm, waves](const auto& x, const auto& y, const auto& z) {
        const auto r = length(x, y, z);
        auto reach = 0.0 * x + 1.0;
        for (const Wave& w : waves)
          reach = reach + w.height * sin(w.x * (x / r) + w.y * (y / r) + w.z * (z / r) + w.phase);
        return r - radius_mm * reach;
      },
      {}, 1.2 * radius_mm + kernel_mm, kernel_mm, {"bumpy", 2, {0}, {}, {}, {}});
}

}  // namespace telefab::test
