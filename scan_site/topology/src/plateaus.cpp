#include "plateaus.hpp"

#include <algorithm>
#include <numeric>
#include <unordered_map>

#include "cells.hpp"

namespace telefab::scan::topology {
namespace {

constexpr double kLevelNz = 0.985;    // of the field's own normal: 10 degrees
constexpr double kCellKernels = 0.9;  // samples this near are connected
constexpr double kLinkKernels = 2.0;  // critical points this near need no samples between them
constexpr std::size_t kCrowd = 4;     // fewer can be told apart by the graph

class Groups {
 public:
  explicit Groups(std::size_t count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), std::size_t{0}); }
  std::size_t root(std::size_t a) {
    while (parent_[a] != a) a = parent_[a] = parent_[parent_[a]];
    return a;
  }
  /// The lower index stays the root.
  void join(std::size_t a, std::size_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::size_t> parent_;
};

}  // namespace

std::vector<Plateau> gather_plateaus(const ScalarField& field, std::span<const Vec3> starts,
                                     std::vector<CriticalPoint>& points, double gap_kernels) {
  if (points.empty()) return {};
  double widest = 0;
  for (const CriticalPoint& c : points) widest = std::max(widest, field.kernel_width_mm(c.position_mm));
  const double cell_mm = kCellKernels * widest;

  // Level places: cells of level samples (by the field) joined over their neighbours; the critical points lie in them.
  struct Place {
    Vec3 at;
    bool up;
  };
  std::vector<Place> places;
  for (const CriticalPoint& c : points) places.push_back({c.position_mm, c.normal_up});
  const auto cursor = field.cursor();
  for (const Vec3& start : starts) {
    const FieldSample f = cursor->at(start);
    if (f.in_reach && std::abs(f.gradient.z()) > kLevelNz * f.gradient.norm())
      places.push_back({start, f.gradient.z() > 0});
  }
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells;
  for (std::size_t i = 0; i < places.size(); ++i) cells[key_of(cell_of(places[i].at, cell_mm))].push_back(i);
  Groups level{places.size()};
  for (std::size_t i = 0; i < places.size(); ++i)
    around(cell_of(places[i].at, cell_mm), [&](std::uint64_t key) {
      if (const auto at = cells.find(key); at != cells.end())
        for (const std::size_t j : at->second)
          if (places[j].up == places[i].up) level.join(i, j);
    });

  // Within a level place (or beside each other), heights in a chain of small gaps.
  Groups group{points.size()};
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double h = field.kernel_width_mm(points[i].position_mm);
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      if (points[j].position_mm.z() - points[i].position_mm.z() > gap_kernels * h) break;
      if (points[i].normal_up != points[j].normal_up) continue;
      if (level.root(i) == level.root(j) || (points[i].position_mm - points[j].position_mm).norm() < kLinkKernels * h)
        group.join(i, j);
    }
  }

  std::vector<std::vector<std::size_t>> members(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) members[group.root(i)].push_back(i);
  std::vector<Plateau> plateaus;
  for (const auto& m : members) {
    const bool without_bend = std::any_of(m.begin(), m.end(), [&](std::size_t i) { return points[i].degenerate; });
    if (m.empty() || (m.size() < kCrowd && !without_bend)) continue;
    for (const std::size_t i : m) points[i].plateau = plateaus.size();
    plateaus.push_back({points[m.front()].position_mm.z(), points[m.back()].position_mm.z(),
                        points[m[m.size() / 2]].position_mm, m.size()});
  }
  return plateaus;
}

std::vector<Vec3> samples_around(const ScalarField& field, std::span<const Vec3> samples, std::span<const Vec3> normals,
                                 std::span<const CriticalPoint> points, std::span<const std::size_t> members,
                                 double low_mm, double high_mm) {
  const double h = field.kernel_width_mm(points[members.front()].position_mm);
  const double cell_mm = kCellKernels * h;
  std::vector<std::size_t> slab;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells;
  for (std::size_t i = 0; i < samples.size(); ++i)
    if (samples[i].z() >= low_mm && samples[i].z() <= high_mm) {
      cells[key_of(cell_of(samples[i], cell_mm))].push_back(slab.size());
      slab.push_back(i);
    }
  std::vector<char> reached(slab.size(), 0);
  std::vector<std::size_t> front;
  const auto spread = [&](const Vec3& from, const Vec3& normal, double limit) {
    around(cell_of(from, cell_mm), [&](std::uint64_t key) {
      const auto at = cells.find(key);
      if (at == cells.end()) return;
      for (const std::size_t k : at->second)
        if (!reached[k] && normals[slab[k]].dot(normal) > limit) {
          reached[k] = 1;
          front.push_back(k);
        }
    });
  };
  for (const std::size_t m : members)
    spread(points[m].position_mm, (points[m].normal_up ? 1 : -1) * Vec3::UnitZ(), 0.5);
  // An edge may turn by a right angle from one sample to the next; the far side of a thin wall looks the other way.
  while (!front.empty()) {
    const std::size_t k = front.back();
    front.pop_back();
    spread(samples[slab[k]], normals[slab[k]], -0.3);
  }
  std::vector<Vec3> around_it;
  for (std::size_t k = 0; k < slab.size(); ++k)
    if (reached[k]) around_it.push_back(samples[slab[k]]);
  return around_it;
}

}  // namespace telefab::scan::topology
