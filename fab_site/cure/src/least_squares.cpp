// SPDX-License-Identifier: GPL-3.0-or-later
#include "least_squares.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace telefab::fab {
namespace {

/// Quantile 0.975 of Student's t; tabulated to 10 degrees of freedom, by the first terms of its expansion beyond.
double student_of(Eigen::Index freedom) {
  constexpr std::array<double, 10> table{12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228};
  if (freedom <= 10) return table[static_cast<std::size_t>(std::max<Eigen::Index>(freedom, 1) - 1)];
  const double z = 1.959964, n = static_cast<double>(freedom);
  return z + (z * z * z + z) / (4 * n) + (5 * std::pow(z, 5) + 16 * z * z * z + 3 * z) / (96 * n * n);
}

}  // namespace

FittedFigure LeastSquares::figure(Eigen::Index i) const {
  const double half = student * std::sqrt(std::max(0.0, covariance(i, i)));
  return {parameters[i], parameters[i] - half, parameters[i] + half};
}

std::optional<LeastSquares> least_squares(const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& residuals,
                                          Eigen::VectorXd start) {
  Eigen::VectorXd at = std::move(start), off = residuals(at);
  const Eigen::Index parameters = at.size(), readings = off.size();
  const auto jacobian = [&] {
    Eigen::MatrixXd j(readings, parameters);
    for (Eigen::Index p = 0; p < parameters; ++p) {
      const double step = 1e-5 * std::max(1e-3, std::abs(at[p]));
      Eigen::VectorXd more = at, less = at;
      more[p] += step;
      less[p] -= step;
      j.col(p) = (residuals(more) - residuals(less)) / (2 * step);
    }
    return j;
  };
  for (int round = 0; round < 200; ++round) {
    const Eigen::MatrixXd j = jacobian();
    if (!j.allFinite() || !off.allFinite()) return std::nullopt;
    const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr{j};
    if (qr.rank() < parameters) return std::nullopt;
    const Eigen::VectorXd step = qr.solve(off);
    double share = 1;
    Eigen::VectorXd next = at - step, next_off = residuals(next);
    while (share > 1e-6 && !(next_off.allFinite() && next_off.squaredNorm() <= off.squaredNorm())) {
      share /= 2;
      next = at - share * step;
      next_off = residuals(next);
    }
    const bool converged = share <= 1e-6 || (share * step).norm() < 1e-9 * (1 + at.norm());
    if (share > 1e-6) {
      at = next;
      off = next_off;
    }
    if (!converged) continue;
    LeastSquares fit;
    fit.parameters = at;
    const Eigen::Index freedom = std::max<Eigen::Index>(1, readings - parameters);
    const Eigen::MatrixXd last = jacobian();
    const Eigen::MatrixXd normal = last.transpose() * last;
    const Eigen::FullPivLU<Eigen::MatrixXd> lu{normal};
    if (!lu.isInvertible()) return std::nullopt;
    fit.covariance = lu.inverse() * (off.squaredNorm() / static_cast<double>(freedom));
    fit.rms = std::sqrt(off.squaredNorm() / static_cast<double>(readings));
    fit.student = student_of(freedom);
    return fit;
  }
  return std::nullopt;
}

}  // namespace telefab::fab
