// SPDX-License-Identifier: GPL-3.0-or-later
#include "winding_normals.hpp"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <telefab/scan/cloud/kd_tree.hpp>

namespace telefab::scan {
namespace {

/// Of so few points none can be spared: on sharp bodies half of them say less.
constexpr std::size_t kAllSolved = 8000;
constexpr std::size_t kMostSolved = 5000;  ///< of more points
constexpr int kRounds = 20;
constexpr float kFirstWidth = 1, kLastWidth = 0.5F;  ///< softening in spacings
constexpr std::size_t kNearest = 3;                  ///< solved points that a point takes after

/// Three numbers a point, coordinate by coordinate.
struct Vectors {
  std::vector<float> x, y, z;
  explicit Vectors(std::size_t n) : x(n, 0), y(n, 0), z(n, 0) {}
  [[nodiscard]] std::size_t size() const { return x.size(); }
  [[nodiscard]] Eigen::Vector3f at(std::size_t i) const { return {x[i], y[i], z[i]}; }
  void set(std::size_t i, const Eigen::Vector3f& v) { x[i] = v.x(), y[i] = v.y(), z[i] = v.z(); }
  [[nodiscard]] double squared_norm() const {
    double sum = 0;
    for (std::size_t i = 0; i < size(); ++i) sum += static_cast<double>(at(i).squaredNorm());
    return sum;
  }
};

template <class Use>
void for_each_point(std::size_t n, Use use) {
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, n, 32}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) use(i);
  });
}

constexpr std::size_t kLanes = 8;
using Lanes = std::array<float, kLanes>;

float sum_of(const Lanes& lanes) {
  float sum = 0;
  for (const float v : lanes) sum += v;
  return sum;
}

/// The sums over all pairs of points, softened by one width. Eight partners at a time, so that the compiler can put
/// them into the lanes of a register; padding points carry no dipole and no weight.
class PairSums {
 public:
  PairSums(const Vectors& points, float width) : p_{points}, soft_{width * width} {}

  /// Winding number at every point of dipoles m: sum m_j (p_j - p_i) / 4 pi R^3.
  [[nodiscard]] std::vector<float> winding(const Vectors& m) const {
    std::vector<float> out(p_.size());
    for_each_point(p_.size(), [&](std::size_t i) {
      Lanes sum{};
      const float px = p_.x[i], py = p_.y[i], pz = p_.z[i];
      for (std::size_t j = 0; j < p_.size(); j += kLanes)
        for (std::size_t k = 0; k < kLanes; ++k) {
          const float dx = p_.x[j + k] - px, dy = p_.y[j + k] - py, dz = p_.z[j + k] - pz;
          const float square = dx * dx + dy * dy + dz * dz + soft_;
          sum[k] += (m.x[j + k] * dx + m.y[j + k] * dy + m.z[j + k] * dz) / (square * std::sqrt(square));
        }
      out[i] = sum_of(sum) * kFactor;
    });
    return out;
  }
  /// Its transpose: sum r_i (p_j - p_i) / 4 pi R^3.
  [[nodiscard]] Vectors pull(const std::vector<float>& r) const {
    Vectors out{p_.size()};
    for_each_point(p_.size(), [&](std::size_t j) {
      Lanes x{}, y{}, z{};
      const float px = p_.x[j], py = p_.y[j], pz = p_.z[j];
      for (std::size_t i = 0; i < p_.size(); i += kLanes)
        for (std::size_t k = 0; k < kLanes; ++k) {
          const float dx = px - p_.x[i + k], dy = py - p_.y[i + k], dz = pz - p_.z[i + k];
          const float square = dx * dx + dy * dy + dz * dz + soft_;
          const float weight = r[i + k] / (square * std::sqrt(square));
          x[k] += weight * dx;
          y[k] += weight * dy;
          z[k] += weight * dz;
        }
      out.set(j, kFactor * Eigen::Vector3f{sum_of(x), sum_of(y), sum_of(z)});
    });
    return out;
  }
  /// Where the winding number falls fastest: sum m / R^3 - 3 (m d) d / R^5.
  [[nodiscard]] Vectors fall(const Vectors& m) const {
    Vectors out{p_.size()};
    for_each_point(p_.size(), [&](std::size_t i) {
      Lanes x{}, y{}, z{};
      const float px = p_.x[i], py = p_.y[i], pz = p_.z[i];
      for (std::size_t j = 0; j < p_.size(); j += kLanes)
        for (std::size_t k = 0; k < kLanes; ++k) {
          const float dx = p_.x[j + k] - px, dy = p_.y[j + k] - py, dz = p_.z[j + k] - pz;
          const float square = dx * dx + dy * dy + dz * dz + soft_;
          const float weight = 1 / (square * std::sqrt(square));
          const float along = 3 * (m.x[j + k] * dx + m.y[j + k] * dy + m.z[j + k] * dz) / square;
          x[k] += weight * (m.x[j + k] - along * dx);
          y[k] += weight * (m.y[j + k] - along * dy);
          z[k] += weight * (m.z[j + k] - along * dz);
        }
      out.set(i, {sum_of(x), sum_of(y), sum_of(z)});
    });
    return out;
  }

 private:
  static constexpr float kFactor = 1 / (4 * std::numbers::pi_v<float>);
  const Vectors& p_;
  float soft_;
};

/// The first `solved` points are true ones; the others fill the last lanes.
void one_round(const Vectors& points, std::size_t solved, float width, Vectors& m) {
  const PairSums sums{points, width};
  std::vector<float> missing = sums.winding(m);
  for (std::size_t i = 0; i < missing.size(); ++i) missing[i] = i < solved ? 0.5F - missing[i] : 0;
  Vectors gradient = sums.pull(missing);
  for (std::size_t i = solved; i < gradient.size(); ++i) gradient.set(i, Eigen::Vector3f::Zero());
  const std::vector<float> answer = sums.winding(gradient);
  double change = 0;
  for (std::size_t i = 0; i < solved; ++i) change += static_cast<double>(answer[i]) * static_cast<double>(answer[i]);
  const auto step = static_cast<float>(change > 0 ? gradient.squared_norm() / change : 0);
  for (std::size_t i = 0; i < m.size(); ++i) m.set(i, m.at(i) + step * gradient.at(i));
  const Vectors way = sums.fall(m);
  for (std::size_t i = 0; i < solved; ++i)
    if (const float length = way.at(i).norm(); length > 0) m.set(i, m.at(i).norm() / length * way.at(i));
}

/// The volume the normals enclose is positive, or all are turned.
void force_outward(std::span<const Eigen::Vector3f> points, std::span<const float> areas,
                   std::vector<Eigen::Vector3f>& normals) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3f& p : points) middle += p.cast<double>() / static_cast<double>(points.size());
  double flux = 0;
  for (std::size_t i = 0; i < points.size(); ++i)
    flux += static_cast<double>(areas[i]) * (points[i].cast<double>() - middle).dot(normals[i].cast<double>());
  if (flux < 0)
    for (Eigen::Vector3f& n : normals) n = -n;
}

}  // namespace

bool winding_normals_ask_all(std::size_t points) { return points <= kAllSolved; }

Result<std::vector<Eigen::Vector3f>> winding_normals(std::span<const Eigen::Vector3f> points,
                                                     std::span<const float> areas, std::stop_token stop) {
  // Every so manieth point in the order of the tree: even over the surface as far as the cloud is.
  const KdTree all{points};
  const std::size_t stride =
      winding_normals_ask_all(points.size()) ? 1 : (points.size() + kMostSolved - 1) / kMostSolved;
  std::vector<std::uint32_t> chosen;
  const auto order = all.leaf_order();
  for (std::size_t k = 0; k < order.size(); k += stride) chosen.push_back(order[k]);
  std::sort(chosen.begin(), chosen.end());

  std::vector<Eigen::Vector3f> places;
  std::vector<float> chosen_areas;
  for (const std::uint32_t i : chosen) {
    places.push_back(points[i]);
    chosen_areas.push_back(static_cast<float>(stride) * areas[i]);
  }
  const auto middle = chosen_areas.begin() + static_cast<std::ptrdiff_t>(chosen_areas.size() / 2);
  std::nth_element(chosen_areas.begin(), middle, chosen_areas.end());
  const float spacing = std::sqrt(*middle);
  const std::size_t padded = (places.size() + kLanes - 1) / kLanes * kLanes;
  Vectors at{padded}, m{padded};
  for (std::size_t i = 0; i < places.size(); ++i) at.set(i, (places[i] - places[0]) / spacing);
  for (int round = 0; round < kRounds; ++round) {
    if (stop.stop_requested()) return cancelled("orienting normals");
    const float part = static_cast<float>(round) / (kRounds - 1);
    one_round(at, places.size(), kFirstWidth + part * (kLastWidth - kFirstWidth), m);
  }

  const KdTree tree{places};
  std::vector<Eigen::Vector3f> normals(points.size());
  for_each_point(points.size(), [&](std::size_t i) {
    std::array<Neighbour, kNearest> near;
    const std::size_t count =
        stride == 1 ? tree.nearest(points[i], std::span{near}.first(1)) : tree.nearest(points[i], near);
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (std::size_t k = 0; k < count; ++k) sum += m.at(near[k].index).normalized();
    normals[i] = sum.norm() > 0 ? Eigen::Vector3f{sum.normalized()} : Eigen::Vector3f::UnitZ();
  });
  force_outward(points, areas, normals);
  return normals;
}

}  // namespace telefab::scan
