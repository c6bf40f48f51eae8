// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/placing/turn.hpp>

#include <fmt/format.h>

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <charconv>
#include <cmath>
#include <numbers>
#include <vector>

namespace telefab::scan {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kMostDegrees = 3600;

/// Sine and cosine of degrees; quarter turns are exact.
std::array<double, 2> sine_cosine(double degrees) {
  const double turned = std::remainder(degrees, 360.0);
  if (turned == 0) return {0, 1};
  if (turned == 90) return {1, 0};
  if (turned == -90) return {-1, 0};
  if (std::abs(turned) == 180) return {0, -1};
  return {std::sin(turned * kDegree), std::cos(turned * kDegree)};
}

/// About x, y or z (0, 1, 2).
Matrix3d about(int axis, double degrees) {
  const auto [s, c] = sine_cosine(degrees);
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  Matrix3d turn = Matrix3d::Identity();
  turn(u, u) = c;
  turn(v, v) = c;
  turn(u, v) = 0 - s;
  turn(v, u) = s;
  return turn;
}

/// Negative zeros would stand in reports.
Matrix3d without_negative_zeros(const Matrix3d& m) { return (m.array() + 0.0).matrix(); }

double full_turn(double degrees) { return degrees <= -180 ? degrees + 360 : degrees + 0.0; }

}  // namespace

Result<Turn> Turn::with_up(const Vector3d& direction) {
  const double length = direction.stableNorm();
  if (!direction.allFinite() || !(length > 0))
    return fail(ErrorCode::InvalidInput, "the direction that shall point up has no length");
  const Vector3d up = direction / length;
  const Vector3d axis = up.cross(Vector3d::UnitZ());
  if (axis == Vector3d::Zero()) return up.z() > 0 ? Turn{} : Turn{without_negative_zeros(about(0, 180))};
  // 1 + cos of the angle; near straight down the sum has no digits left.
  const double rest = up.z() > 0 ? 1 + up.z() : axis.squaredNorm() / (1 - up.z());
  Matrix3d cross;
  cross << 0, -axis.z(), axis.y(), axis.z(), 0, -axis.x(), -axis.y(), axis.x(), 0;
  return from_matrix(Matrix3d::Identity() + cross + cross * cross / rest);
}

Result<Turn> Turn::about_axes(const Vector3d& degrees) {
  if (!degrees.allFinite() || degrees.cwiseAbs().maxCoeff() > kMostDegrees)
    return fail(ErrorCode::InvalidInput, fmt::format("angles are from -{0:g} to {0:g} degrees", kMostDegrees));
  return Turn{without_negative_zeros(about(2, degrees.z()) * about(1, degrees.y()) * about(0, degrees.x()))};
}

Result<Turn> Turn::from_matrix(const Matrix3d& matrix) {
  if (!matrix.allFinite()) return fail(ErrorCode::InvalidInput, "the matrix has an entry that is not finite");
  const Matrix3d gram = matrix * matrix.transpose();
  if ((gram - Matrix3d::Identity()).cwiseAbs().maxCoeff() > kMostRounding) {
    const Vector3d lengths = gram.diagonal().cwiseSqrt();
    const bool stretched = (lengths - Vector3d::Ones()).cwiseAbs().maxCoeff() > kMostRounding;
    return fail(ErrorCode::InvalidInput,
                stretched ? fmt::format("the matrix is not a rotation: its rows have the lengths {:.6g}, {:.6g} and "
                                        "{:.6g}, not 1; sizes are for --scale and --scale-axes",
                                        lengths.x(), lengths.y(), lengths.z())
                          : std::string{"the matrix is not a rotation: its rows are not at right angles"});
  }
  if (matrix.determinant() < 0)
    return fail(ErrorCode::InvalidInput, "the matrix mirrors (its determinant is -1); give --mirror and a rotation");
  if ((gram - Matrix3d::Identity()).cwiseAbs().maxCoeff() == 0) return Turn{without_negative_zeros(matrix)};
  const Eigen::JacobiSVD<Matrix3d> svd{matrix, Eigen::ComputeFullU | Eigen::ComputeFullV};
  return Turn{without_negative_zeros(svd.matrixU() * svd.matrixV().transpose())};
}

Vector3d Turn::angles_deg() const {
  const Matrix3d& m = matrix_;
  const double flat = std::hypot(m(0, 0), m(1, 0));
  const double y = std::atan2(-m(2, 0), flat);
  // Looking along its own axis the turn about x does what that about z would.
  if (flat < 1e-9) return {full_turn(std::atan2(-m(1, 2), m(1, 1)) / kDegree), y / kDegree, 0};
  return {full_turn(std::atan2(m(2, 1), m(2, 2)) / kDegree), y / kDegree + 0.0,
          full_turn(std::atan2(m(1, 0), m(0, 0)) / kDegree)};
}

Turn Turn::then_about_z(double degrees) const { return Turn{without_negative_zeros(about(2, degrees) * matrix_)}; }

Result<std::vector<double>> numbers_from(std::string_view text) {
  std::vector<double> numbers;
  const char* at = text.data();
  const char* const end = at + text.size();
  for (;;) {
    while (at != end && *at == ' ') ++at;
    if (at != end && *at == '+') ++at;
    double value = 0;
    const auto [after, error] = std::from_chars(at, end, value);
    if (error != std::errc{} || !std::isfinite(value))
      return fail(ErrorCode::InvalidInput, fmt::format("\"{}\": must be numbers with commas between them", text));
    numbers.push_back(value);
    at = after;
    while (at != end && *at == ' ') ++at;
    if (at == end) return numbers;
    if (*at++ != ',')
      return fail(ErrorCode::InvalidInput, fmt::format("\"{}\": must be numbers with commas between them", text));
  }
}

Result<Turn> turn_from_up(std::string_view text) {
  constexpr std::string_view kLetters = "xyz";
  const bool is_down = text.starts_with('-');
  const std::string_view letter = text.substr(is_down ? 1 : 0);
  if (letter.size() == 1 && kLetters.find(letter[0]) != std::string_view::npos)
    return Turn::with_up((is_down ? -1.0 : 1.0) * Vector3d::Unit(letter[0] - 'x'));
  const auto numbers = numbers_from(text);
  if (!numbers || numbers->size() != 3)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("\"{}\" is not a direction; there are x, -x, y, -y, z, -z, three numbers X,Y,Z, and auto", text));
  return Turn::with_up({(*numbers)[0], (*numbers)[1], (*numbers)[2]});
}

Result<Turn> turn_from_rotate(std::string_view text) {
  const auto numbers = numbers_from(text);
  if (!numbers) return tl::unexpected{numbers.error()};
  if (numbers->size() == 3) return Turn::about_axes({(*numbers)[0], (*numbers)[1], (*numbers)[2]});
  if (numbers->size() != 9)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} numbers; a turn is three angles in degrees or a matrix of nine", numbers->size()));
  return Turn::from_matrix(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>{numbers->data()});
}

std::string rotate_text(const Turn& turn) {
  const Vector3d a = turn.angles_deg();
  std::string text;
  for (int i = 0; i < 3; ++i) {
    std::string number = fmt::format("{:.6f}", a[i]);
    number.erase(number.find_last_not_of('0') + 1);
    if (number.ends_with('.')) number.pop_back();
    text += (i > 0 ? "," : "") + (number == "-0" ? std::string{"0"} : number);
  }
  return text;
}

}  // namespace telefab::scan
