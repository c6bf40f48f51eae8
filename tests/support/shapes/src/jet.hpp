// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <cmath>

namespace telefab::test {

/// A value with its gradient and Hessian in x, y, z: formulas written once give exact derivatives.
struct Jet {
  double v = 0;
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  Eigen::Matrix3d h = Eigen::Matrix3d::Zero();

  Jet() = default;
  Jet(double value) : v{value} {}  // NOLINT: constants mix freely with jets in a formula
};

/// f(a) from f, f', f'' at a.v.
inline Jet chained(const Jet& a, double f, double f1, double f2) {
  Jet r;
  r.v = f;
  r.g = f1 * a.g;
  r.h = f1 * a.h + f2 * a.g * a.g.transpose();
  return r;
}
inline Jet operator+(const Jet& a, const Jet& b) {
  Jet r;
  r.v = a.v + b.v;
  r.g = a.g + b.g;
  r.h = a.h + b.h;
  return r;
}
inline Jet operator-(const Jet& a) { return chained(a, -a.v, -1, 0); }
inline Jet operator-(const Jet& a, const Jet& b) { return a + (-b); }
inline Jet operator*(const Jet& a, const Jet& b) {
  Jet r;
  r.v = a.v * b.v;
  r.g = a.v * b.g + b.v * a.g;
  r.h = a.v * b.h + b.v * a.h + a.g * b.g.transpose() + b.g * a.g.transpose();
  return r;
}
inline Jet operator/(const Jet& a, const Jet& b) {
  return a * chained(b, 1 / b.v, -1 / (b.v * b.v), 2 / (b.v * b.v * b.v));
}
inline Jet sqrt(const Jet& a) {
  const double s = std::sqrt(a.v);
  return s > 0 ? chained(a, s, 0.5 / s, -0.25 / (s * s * s)) : Jet{0.0};
}
inline Jet sin(const Jet& a) { return chained(a, std::sin(a.v), std::cos(a.v), -std::sin(a.v)); }
inline Jet cos(const Jet& a) { return chained(a, std::cos(a.v), -std::sin(a.v), -std::cos(a.v)); }
inline Jet exp(const Jet& a) { return chained(a, std::exp(a.v), std::exp(a.v), std::exp(a.v)); }
inline Jet abs(const Jet& a) { return a.v < 0 ? -a : a; }
inline Jet max(const Jet& a, const Jet& b) { return a.v < b.v ? b : a; }
inline Jet min(const Jet& a, const Jet& b) { return b.v < a.v ? b : a; }

}  // namespace telefab::test
