// SPDX-License-Identifier: GPL-3.0-or-later
#include "plateaus.hpp"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <unordered_map>

#include "cells.hpp"

namespace telefab::scan::topology {
namespace {

constexpr double kLevelNz = 0.985;    // of the field's own normal: 10 degrees
constexpr double kCellKernels = 0.9;  // samples this near are connected
constexpr double kScatterKernels = 0.3;
constexpr std::size_t kCrowd = 6;  // fewer can be told apart by the graph

/// Places where the surface is level, near enough to each other to be joined: first the critical points, in order,
/// then others.
class LevelPlaces {
 public:
  LevelPlaces(std::span<const LevelPlace> level, std::span<const CriticalPoint> points, double cell_mm)
      : cell_mm_{cell_mm} {
    for (const CriticalPoint& c : points) add({c.position_mm, c.normal_up});
    for (const LevelPlace& place : level) add(place);
  }

  /// Splits critical points into those connected by level places with low <= z <= high.
  [[nodiscard]] std::vector<std::vector<std::size_t>> connected(std::span<const std::size_t> members, double low_mm,
                                                                double high_mm) const {
    std::unordered_map<std::size_t, std::size_t> piece;  // of a place reached
    std::vector<std::vector<std::size_t>> pieces;
    for (const std::size_t m : members) {
      if (const auto known = piece.find(m); known != piece.end()) {
        pieces[known->second].push_back(m);
        continue;
      }
      pieces.push_back({m});
      std::vector<std::size_t> front{m};
      piece[m] = pieces.size() - 1;
      while (!front.empty()) {
        const std::size_t from = front.back();
        front.pop_back();
        around(cell_of(places_[from].at, cell_mm_), [&](std::uint64_t key) {
          const auto at = cells_.find(key);
          if (at == cells_.end()) return;
          for (const std::size_t k : at->second)
            if (places_[k].up == places_[from].up && places_[k].at.z() >= low_mm && places_[k].at.z() <= high_mm &&
                piece.try_emplace(k, pieces.size() - 1).second)
              front.push_back(k);
        });
      }
    }
    return pieces;
  }

 private:
  void add(const LevelPlace& place) {
    cells_[key_of(cell_of(place.at, cell_mm_))].push_back(places_.size());
    places_.push_back(place);
  }
  double cell_mm_;
  std::vector<LevelPlace> places_;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells_;
};

}  // namespace

std::vector<LevelPlace> level_places(const ScalarField& field, std::span<const Vec3> starts) {
  const std::vector<std::uint32_t> order = by_cell(field, starts);
  std::vector<std::optional<LevelPlace>> found(starts.size());
  tbb::enumerable_thread_specific<std::unique_ptr<FieldCursor>> cursors([&] { return field.cursor(); });
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, order.size(), 256}, [&](const auto& range) {
    FieldCursor& cursor = *cursors.local();
    for (std::size_t k = range.begin(); k < range.end(); ++k) {
      const Vec3& start = starts[order[k]];
      const FieldSample f = cursor.at(start);
      if (f.in_reach && std::abs(f.gradient.z()) > kLevelNz * f.gradient.norm())
        found[order[k]] = {start - f.value_mm / f.gradient.squaredNorm() * f.gradient, f.gradient.z() > 0};
    }
  });
  std::vector<LevelPlace> places;
  for (const auto& place : found)
    if (place) places.push_back(*place);
  return places;
}

std::vector<Plateau> gather_plateaus(const ScalarField& field, std::span<const LevelPlace> level,
                                     std::vector<CriticalPoint>& points, double gap_kernels) {
  if (points.empty()) return {};
  std::vector<double> kernels;
  for (const CriticalPoint& c : points) kernels.push_back(field.kernel_width_mm(c.position_mm));
  const double widest = *std::max_element(kernels.begin(), kernels.end());
  const LevelPlaces places{level, points, kCellKernels * widest};

  // Chains of heights with small gaps, split by what level places connect at those heights, until nothing splits.
  std::vector<std::vector<std::size_t>> open(2);
  for (std::size_t i = 0; i < points.size(); ++i) open[points[i].normal_up ? 1 : 0].push_back(i);
  std::vector<std::vector<std::size_t>> groups;
  while (!open.empty()) {
    const std::vector<std::size_t> group = std::move(open.back());
    open.pop_back();
    std::vector<std::vector<std::size_t>> parts;
    for (const std::size_t i : group) {
      const double z = points[i].position_mm.z();
      if (parts.empty() || z - points[parts.back().back()].position_mm.z() > gap_kernels * kernels[i])
        parts.emplace_back();
      parts.back().push_back(i);
    }
    if (parts.size() == 1) {
      const double slack = gap_kernels * kernels[group.front()];
      parts = places.connected(group, points[group.front()].position_mm.z() - slack,
                               points[group.back()].position_mm.z() + slack);
    }
    for (auto& part : parts) {
      std::sort(part.begin(), part.end());
      (parts.size() == 1 ? groups : open).push_back(std::move(part));
    }
  }

  std::sort(groups.begin(), groups.end());
  std::vector<Plateau> plateaus;
  for (const auto& g : groups) {
    const bool bare = std::any_of(g.begin(), g.end(), [&](std::size_t i) { return points[i].degenerate; });
    if (g.size() < kCrowd && !bare) continue;
    for (const std::size_t i : g) points[i].plateau = plateaus.size();
    plateaus.push_back({points[g.front()].position_mm.z(), points[g.back()].position_mm.z(),
                        points[g[g.size() / 2]].position_mm, g.size()});
  }
  return plateaus;
}

std::vector<Vec3> points_around(const ScalarField& field, FieldCursor& cursor, std::span<const Vec3> samples,
                                std::span<const Vec3> normals, std::span<const CriticalPoint> points,
                                std::span<const std::size_t> members, double low_mm, double high_mm) {
  const double h = field.kernel_width_mm(points[members.front()].position_mm);
  const double cell_mm = kCellKernels * h;
  const double scatter_mm = kScatterKernels * h;  // of noisy samples about the surface
  struct Place {
    Vec3 at;
    Vec3 normal;
    bool reached = false;
  };
  std::vector<Place> slab;
  std::unordered_map<std::uint64_t, std::vector<std::size_t>> cells;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    if (samples[i].z() < low_mm - scatter_mm || samples[i].z() > high_mm + scatter_mm) continue;
    Place place{samples[i], normals[i]};
    for (int step = 0; step < 2; ++step) {
      const FieldSample f = cursor.at(place.at);
      const double steep = f.gradient.squaredNorm();
      if (!f.in_reach || !(steep > 1e-6)) break;
      place.at -= f.value_mm / steep * f.gradient;
      place.normal = f.gradient / std::sqrt(steep);
    }
    if (!(place.at.z() >= low_mm && place.at.z() <= high_mm)) continue;
    cells[key_of(cell_of(place.at, cell_mm))].push_back(slab.size());
    slab.push_back(place);
  }
  std::vector<std::size_t> front;
  const auto spread = [&](const Vec3& from, const Vec3& normal, double limit) {
    around(cell_of(from, cell_mm), [&](std::uint64_t key) {
      const auto at = cells.find(key);
      if (at == cells.end()) return;
      for (const std::size_t k : at->second)
        if (!slab[k].reached && slab[k].normal.dot(normal) > limit) {
          slab[k].reached = true;
          front.push_back(k);
        }
    });
  };
  for (const std::size_t m : members)
    spread(points[m].position_mm, (points[m].normal_up ? 1 : -1) * Vec3::UnitZ(), 0.5);
  // An edge may turn by a right angle from one sample to the next; the far side of a thin wall looks the other way.
  while (!front.empty()) {
    const Place from = slab[front.back()];
    front.pop_back();
    spread(from.at, from.normal, -0.3);
  }
  std::vector<Vec3> found;
  for (const Place& place : slab)
    if (place.reached) found.push_back(place.at);
  return found;
}

}  // namespace telefab::scan::topology
