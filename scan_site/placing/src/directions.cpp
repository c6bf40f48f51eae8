// SPDX-License-Identifier: GPL-3.0-or-later
#include "directions.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace telefab::scan {
namespace {

using Eigen::Vector3d;

constexpr double kDegree = std::numbers::pi / 180;
/// Normals this near to each other are of one flat side; sought from wide to narrow.
constexpr std::array kFlatDegrees{6.0, 3.0, 1.5};
/// A flat side has at least so much of the area,
constexpr double kFlatShare = 0.004;
/// and so many of them are tried.
constexpr int kMostFlats = 30;
/// What the area vectors leave open is a side where it is so much of the area.
constexpr double kOpenShare = 0.02;
/// Directions nearer than this are one.
constexpr double kSameDegrees = 0.2;

/// Evenly over the sphere.
std::vector<Vector3d> spread_evenly(std::uint32_t count) {
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  std::vector<Vector3d> spread;
  for (std::uint32_t i = 0; i < count; ++i) {
    const double z = 1 - (2.0 * i + 1) / count, flat = std::sqrt(1 - z * z), turn = golden * i;
    spread.emplace_back(flat * std::cos(turn), flat * std::sin(turn), z);
  }
  return spread;
}

/// Directions in which much of the area looks, exactly, the largest first.
std::vector<Vector3d> flat_sides(const std::vector<Eigen::Vector3f>& normals, const std::vector<float>& areas) {
  const std::vector<Vector3d> seeds = spread_evenly(1000);
  const double all = std::accumulate(areas.begin(), areas.end(), 0.0);
  // Area by the seed nearest to each normal; a flat side lies in one seed or between a few.
  std::vector<double> weight(seeds.size(), 0);
  std::vector<std::uint32_t> seed_of(normals.size(), 0);
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const Vector3d n = normals[i].cast<double>();
    // Seeds are sorted by z: only those near in z can be near.
    const double place = (1 - n.z()) / 2 * static_cast<double>(seeds.size());
    const auto from = static_cast<std::size_t>(std::max(0.0, place - 60));
    const auto to = std::min(seeds.size(), static_cast<std::size_t>(std::max(0.0, place + 60)));
    double best = -2;
    for (std::size_t s = from; s < to; ++s)
      if (const double c = seeds[s].dot(n); c > best) best = c, seed_of[i] = static_cast<std::uint32_t>(s);
    weight[seed_of[i]] += areas[i];
  }
  std::vector<std::uint32_t> order(seeds.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(), [&](auto a, auto b) { return weight[a] > weight[b]; });
  std::vector<Vector3d> flats;
  std::vector<double> share;
  for (std::size_t k = 0; k < order.size() && k < 3 * static_cast<std::size_t>(kMostFlats); ++k) {
    Vector3d mean = seeds[order[k]];
    double area = 0;
    for (const double width : kFlatDegrees) {
      const double least = std::cos(width * kDegree);
      Vector3d sum = Vector3d::Zero();
      area = 0;
      for (std::size_t i = 0; i < normals.size(); ++i) {
        const Vector3d n = normals[i].cast<double>();
        if (n.dot(mean) < least) continue;
        sum += static_cast<double>(areas[i]) * n;
        area += areas[i];
      }
      if (sum.norm() == 0) break;
      mean = sum.normalized();
    }
    if (area < kFlatShare * all) continue;
    const bool is_known =
        std::any_of(flats.begin(), flats.end(), [&](const Vector3d& f) { return f.dot(mean) > std::cos(2 * kDegree); });
    if (is_known) continue;
    flats.push_back(mean);
    share.push_back(area);
  }
  std::vector<std::size_t> by_share(flats.size());
  std::iota(by_share.begin(), by_share.end(), std::size_t{0});
  std::stable_sort(by_share.begin(), by_share.end(), [&](auto a, auto b) { return share[a] > share[b]; });
  std::vector<Vector3d> sorted;
  for (const std::size_t i : by_share)
    if (sorted.size() < static_cast<std::size_t>(kMostFlats)) sorted.push_back(flats[i]);
  return sorted;
}

}  // namespace

std::vector<Direction> directions_of(const std::vector<Eigen::Vector3f>& normals, const std::vector<float>& areas,
                                     std::uint32_t spread) {
  std::vector<Direction> found;
  const auto add = [&](const Vector3d& up, StandingSource source) {
    const bool is_known = std::any_of(found.begin(), found.end(), [&](const Direction& d) {
      return (d.up - up).norm() < 2 * std::sin(kSameDegrees / 2 * kDegree);
    });
    if (!is_known) found.push_back({up, source});
  };
  add(Vector3d::UnitZ(), StandingSource::AsInFile);
  for (const Vector3d& axis : {Vector3d{1, 0, 0}, Vector3d{0, 1, 0}})
    for (const double sign : {1.0, -1.0}) add(sign * axis, StandingSource::Axis);
  add(-Vector3d::UnitZ(), StandingSource::Axis);
  Vector3d sum = Vector3d::Zero();
  double all = 0;
  for (std::size_t i = 0; i < normals.size(); ++i) {
    sum += static_cast<double>(areas[i]) * normals[i].cast<double>();
    all += areas[i];
  }
  // What is missing looks against the sum; it goes down.
  if (sum.norm() > kOpenShare * all) add(sum.normalized(), StandingSource::OpenSide);
  for (const Vector3d& flat : flat_sides(normals, areas)) add(-flat, StandingSource::FlatSide);
  for (const Vector3d& up : spread_evenly(spread)) add(up, StandingSource::Spread);
  return found;
}

double turn_along(const std::vector<Eigen::Vector2d>& places, bool wide) {
  struct Box {
    double x = 0, y = 0;
  };
  const auto box_at = [&](double degrees) -> Box {
    const double c = std::cos(degrees * kDegree), s = std::sin(degrees * kDegree);
    double x0 = 1e300, x1 = -1e300, y0 = 1e300, y1 = -1e300;
    for (const Eigen::Vector2d& p : places) {
      const double x = c * p.x() - s * p.y(), y = s * p.x() + c * p.y();
      x0 = std::min(x0, x), x1 = std::max(x1, x), y0 = std::min(y0, y), y1 = std::max(y1, y);
    }
    return {x1 - x0, y1 - y0};
  };
  const auto area_at = [&](double degrees) {
    const Box b = box_at(degrees);
    return b.x * b.y;
  };
  double best = 0, least = area_at(0);
  // From no turn on, so that of equal ones the smallest is taken; a hair better is no better.
  const auto try_turn = [&](double degrees) {
    if (const double area = area_at(degrees); area < 0.9999 * least) least = area, best = degrees;
  };
  for (int i = 1; i <= 45; ++i)
    for (const double sign : {1.0, -1.0}) try_turn(sign * i);
  for (const double step : {0.1, 0.01}) {
    const double about = best;
    for (int i = 1; i <= 9; ++i)
      for (const double sign : {1.0, -1.0})
        if (const double area = area_at(about + sign * i * step); area < least)
          least = area, best = about + sign * i * step;
  }
  const Box b = box_at(best);
  if (wide ? b.x < 0.999 * b.y : b.y < 0.999 * b.x) best += best > 0 ? -90 : 90;
  return best;
}

}  // namespace telefab::scan
