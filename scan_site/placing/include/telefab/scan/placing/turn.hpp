// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Core>
#include <array>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::scan {

/// How a scan is turned before it is placed. Invariant: a proper rotation (orthonormal to 1e-15, determinant +1); a
/// quarter turn about an axis is exact.
class Turn {
 public:
  /// As the scan lies in its file.
  Turn() = default;
  /// The shortest turn after which this direction of the scan points up; of the two for straight down, the one about
  /// x. Any length. Fails: InvalidInput (not finite, or no direction).
  [[nodiscard]] static Result<Turn> with_up(const Eigen::Vector3d& direction);
  /// Degrees about the fixed axes of the scan, first x, then y, then z; counter-clockwise where the axis points at
  /// you. Fails: InvalidInput (not finite, beyond 3,600).
  [[nodiscard]] static Result<Turn> about_axes(const Eigen::Vector3d& degrees);
  /// turned = matrix * scan. What is off a rotation by no more than kMostRounding in an entry of M M^T is rounding and
  /// is orthonormalised. Fails: InvalidInput (stretched, sheared, mirrored, not finite).
  [[nodiscard]] static Result<Turn> from_matrix(const Eigen::Matrix3d& matrix);
  static constexpr double kMostRounding = 1e-4;

  [[nodiscard]] const Eigen::Matrix3d& matrix() const { return matrix_; }
  /// For about_axes: x and z in (-180, 180], y in [-90, 90].
  [[nodiscard]] Eigen::Vector3d angles_deg() const;
  /// This turn, then that about z. What was up stays up.
  [[nodiscard]] Turn then_about_z(double degrees) const;
  [[nodiscard]] bool is_none() const { return matrix_ == Eigen::Matrix3d::Identity(); }
  friend bool operator==(const Turn& a, const Turn& b) { return a.matrix_ == b.matrix_; }

 private:
  explicit Turn(const Eigen::Matrix3d& rotation) : matrix_{rotation} {}
  Eigen::Matrix3d matrix_ = Eigen::Matrix3d::Identity();
};

/// "x", "-x", "y", "-y", "z", "-z", or a direction "X,Y,Z" of the scan that shall point up. Fails: InvalidInput.
[[nodiscard]] Result<Turn> turn_from_up(std::string_view text);
/// "X,Y,Z" in degrees (Turn::about_axes), or a matrix, nine numbers row by row. Fails: InvalidInput.
[[nodiscard]] Result<Turn> turn_from_rotate(std::string_view text);
/// The text that turn_from_rotate reads: angles to 1e-6 degrees.
[[nodiscard]] std::string rotate_text(const Turn& turn);

/// Numbers with commas between them, nothing else. Fails: InvalidInput (another count, not a number, not finite).
[[nodiscard]] Result<std::vector<double>> numbers_from(std::string_view text);

}  // namespace telefab::scan
