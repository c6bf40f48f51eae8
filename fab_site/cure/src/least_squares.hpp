// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Dense>
#include <functional>
#include <optional>
#include <telefab/fab/cure/calibration.hpp>

namespace telefab::fab {

/// A model fitted to readings: its parameters, their covariance by the scatter of the readings.
struct LeastSquares {
  Eigen::VectorXd parameters;
  Eigen::MatrixXd covariance;
  double rms = 0;
  double student = 0;  ///< quantile of 95 % for its degrees of freedom

  [[nodiscard]] FittedFigure figure(Eigen::Index i) const;
};

/// `residuals(parameters)` gives one number a reading. Gauss-Newton with halved steps and central differences from a
/// good start; nothing if it does not settle, or if the readings do not tell the parameters. More readings than
/// parameters.
[[nodiscard]] std::optional<LeastSquares> least_squares(
    const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& residuals, Eigen::VectorXd start);

}  // namespace telefab::fab
