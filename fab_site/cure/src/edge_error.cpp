// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/cure/edge_error.hpp>
#include <telefab/fab/cure/edge_points.hpp>

#include "region_difference.hpp"
#include "ring_index.hpp"

namespace telefab::fab {
namespace {

constexpr double kMarch_px = 0.25;
/// Within this of what is joined the cured edge belongs to both.
constexpr double kJoin_px = 2;
constexpr std::size_t kSamplesPerTask = 256;

struct Probe {
  PixelPlace place;
  double normal_x, normal_y;
  bool smooth;
};

struct Found {
  double at_px;
  bool lost;
  double steepness;  ///< fall of ln(dose) a pixel, along the steepest way
};

/// The cured edge nearest to a point along a direction that leads out of the target.
Found edge_along(const DoseField& dose, double level, const Probe& probe, double most_px) {
  const auto off = [&](double t) {
    return dose.sample({probe.place.x_px + t * probe.normal_x, probe.place.y_px + t * probe.normal_y}).dose / level - 1;
  };
  double from = 0, from_off = off(0);
  const double way = from_off >= 0 ? kMarch_px : -kMarch_px;
  double to = from, to_off = from_off;
  while ((to_off >= 0) == (from_off >= 0)) {
    if (std::abs(to) > most_px) return {std::copysign(most_px, way), true, 0};
    from = to;
    from_off = to_off;
    to += way;
    to_off = off(to);
  }
  double middle = to;
  for (int round = 0; round < 20 && std::abs(to - from) > 1e-7; ++round) {  // Illinois
    middle = to - to_off * (to - from) / (to_off - from_off);
    const double middle_off = off(middle);
    if (std::abs(middle_off) < 1e-7) break;
    if ((middle_off >= 0) == (to_off >= 0)) {
      from_off /= 2;
    } else {
      from = to;
      from_off = to_off;
    }
    to = middle;
    to_off = middle_off;
  }
  if (std::abs(middle) > most_px) return {std::copysign(most_px, way), true, 0};
  const auto s = dose.sample({probe.place.x_px + middle * probe.normal_x, probe.place.y_px + middle * probe.normal_y});
  return {middle, false, std::hypot(s.slope_x, s.slope_y) / s.dose};
}

struct Probes {
  std::vector<Probe> edges;
  std::vector<Probe> corners;
};

/// Unit vector; zero for none.
PixelPlace unit(double x, double y) {
  const double length = std::hypot(x, y);
  return length > 0 ? PixelPlace{x / length, y / length} : PixelPlace{};
}

void add_corners(const Contour& ring, double pitch_mm, double corner_rad, std::vector<Probe>& corners) {
  const auto v = ring.vertices();
  for (std::size_t i = 0; i < v.size(); ++i) {
    const Point2 before = v[(i + v.size() - 1) % v.size()], here = v[i], after = v[(i + 1) % v.size()];
    const PixelPlace in = unit(here.x_mm - before.x_mm, here.y_mm - before.y_mm);
    const PixelPlace out = unit(after.x_mm - here.x_mm, after.y_mm - here.y_mm);
    const double turn = std::atan2(in.x_px * out.y_px - in.y_px * out.x_px, in.x_px * out.x_px + in.y_px * out.y_px);
    if (std::abs(turn) <= corner_rad) continue;
    // Outside lies to the right of either side; halfway between the two normals.
    PixelPlace normal = unit(in.y_px + out.y_px, -in.x_px - out.x_px);
    if (normal.x_px == 0 && normal.y_px == 0) normal = in;  // a spike: out of its tip
    corners.push_back({{here.x_mm / pitch_mm, here.y_mm / pitch_mm}, normal.x_px, normal.y_px, false});
  }
}

void add_edges(const Contour& ring, double pitch_mm, double step_px, std::vector<Probe>& edges) {
  const auto v = ring.vertices();
  double next = step_px / 2;  // way left to the next sample
  for (std::size_t i = 0; i < v.size(); ++i) {
    const Point2 a = v[i], b = v[(i + 1) % v.size()];
    const double dx = (b.x_mm - a.x_mm) / pitch_mm, dy = (b.y_mm - a.y_mm) / pitch_mm, length = std::hypot(dx, dy);
    for (; next < length; next += step_px)
      edges.push_back({{a.x_mm / pitch_mm + dx * next / length, a.y_mm / pitch_mm + dy * next / length},
                       dy / length,
                       -dx / length,
                       true});
    next -= length;
  }
}

Probes probes_of(std::span<const Contour> rings, double pitch_mm, const EdgeOptions& options) {
  Probes probes;
  for (const Contour& ring : rings) {
    add_edges(ring, pitch_mm, options.sample_px, probes.edges);
    add_corners(ring, pitch_mm, options.corner_rad, probes.corners);
  }
  // A corner spoils what is near it; both sorted by y, so that a window over the corners is enough.
  std::vector<PixelPlace> spoilt;
  for (const Probe& corner : probes.corners) spoilt.push_back(corner.place);
  std::sort(spoilt.begin(), spoilt.end(), [](PixelPlace a, PixelPlace b) { return a.y_px < b.y_px; });
  for (Probe& edge : probes.edges) {
    auto at = std::lower_bound(spoilt.begin(), spoilt.end(), edge.place.y_px - options.corner_px,
                               [](PixelPlace p, double y) { return p.y_px < y; });
    for (; at != spoilt.end() && at->y_px <= edge.place.y_px + options.corner_px && edge.smooth; ++at)
      edge.smooth = std::hypot(at->x_px - edge.place.x_px, at->y_px - edge.place.y_px) > options.corner_px;
  }
  return probes;
}

}  // namespace

void DistanceTally::add(double signed_px, double weight) {
  const double size = std::abs(signed_px);
  count_ += weight;
  sum_ += weight * size;
  signed_sum_ += weight * signed_px;
  square_sum_ += weight * size * size;
  max_ = std::max(max_, size);
  bins_[std::min(kBins - 1, static_cast<std::size_t>(size * kBins / kMost_px))] += weight;
}

void DistanceTally::add(const DistanceTally& other) {
  count_ += other.count_;
  sum_ += other.sum_;
  signed_sum_ += other.signed_sum_;
  square_sum_ += other.square_sum_;
  max_ = std::max(max_, other.max_);
  for (std::size_t i = 0; i < kBins; ++i) bins_[i] += other.bins_[i];
}

double DistanceTally::rms_px() const { return count_ > 0 ? std::sqrt(square_sum_ / count_) : 0; }

double DistanceTally::percentile_px(double share) const {
  double left = share * count_;
  for (std::size_t i = 0; i < kBins; ++i) {
    left -= bins_[i];
    if (left <= 0) return std::min(max_, kMost_px * (static_cast<double>(i) + 1) / kBins);
  }
  return max_;
}

Result<void> EdgeOptions::validate() const {
  if (!(sample_px >= 0.05 && sample_px <= 10))
    return fail(ErrorCode::InvalidInput, fmt::format("samples every {} px; 0.05 to 10 are possible", sample_px));
  if (!(lost_px > 0 && lost_px <= DistanceTally::kMost_px))
    return fail(ErrorCode::InvalidInput, fmt::format("edges lost at {} px; up to 3 are possible", lost_px));
  if (!(corner_rad > 0 && corner_rad < 3.15) || !(corner_px >= 0 && corner_px <= 100))
    return fail(ErrorCode::InvalidInput, "corners turn by 0 to 3.14 rad and spoil 0 to 100 px");
  if (sub_pixels < 1 || sub_pixels > 16)
    return fail(ErrorCode::InvalidInput, fmt::format("{} sub-pixels; 1 to 16 are possible", sub_pixels));
  return {};
}

void EdgeFigures::add(const EdgeFigures& other) {
  edges.add(other.edges);
  smooth.add(other.smooth);
  corners.add(other.corners);
  cured.add(other.cured);
  lost += other.lost;
  latitude_sum += other.latitude_sum;
  target_px2 += other.target_px2;
  cured_px2 += other.cured_px2;
  excess_px2 += other.excess_px2;
  missing_px2 += other.missing_px2;
  far_px2 += other.far_px2;
}

double EdgeFigures::latitude_px() const {
  const double found = edges.count() - lost;
  return found > 0 ? latitude_sum / found : 0;
}

Result<EdgeFigures> measure_edges(const DoseField& dose, double threshold, const EdgeTarget& target,
                                  double pixel_pitch_mm, const EdgeOptions& options, std::vector<EdgeSample>* samples) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  Probes probes = probes_of(target.rings, pixel_pitch_mm, options);
  const RingIndex joined{target.joined, pixel_pitch_mm};
  if (!joined.empty()) {
    std::erase_if(probes.edges, [&](const Probe& p) { return joined.holds(p.place, kJoin_px); });
    std::erase_if(probes.corners, [&](const Probe& p) { return joined.holds(p.place, kJoin_px); });
  }
  std::vector<Contour> all{target.rings.begin(), target.rings.end()};
  all.insert(all.end(), target.joined.begin(), target.joined.end());
  const RingIndex index{all, pixel_pitch_mm};
  EdgeFigures figures;

  std::vector<Found> found(probes.edges.size());
  const std::size_t tasks = (found.size() + kSamplesPerTask - 1) / kSamplesPerTask;
  tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
    const std::size_t last = std::min(found.size(), (task + 1) * kSamplesPerTask);
    for (std::size_t i = task * kSamplesPerTask; i < last; ++i)
      found[i] = edge_along(dose, threshold, probes.edges[i], options.lost_px);
  });
  for (std::size_t i = 0; i < found.size(); ++i) {
    figures.edges.add(found[i].at_px);
    if (probes.edges[i].smooth) figures.smooth.add(found[i].at_px);
    figures.lost += found[i].lost;
    if (found[i].steepness > 0) figures.latitude_sum += 0.01 / found[i].steepness;
    if (samples) samples->push_back({probes.edges[i].place, found[i].at_px});
  }
  for (const Probe& corner : probes.corners)
    figures.corners.add(edge_along(dose, threshold, corner, DistanceTally::kMost_px).at_px);

  const auto cured = edge_points(dose, threshold, options.sub_pixels, 1);
  std::vector<double> away(cured.size());
  tbb::parallel_for(std::size_t{0}, (cured.size() + kSamplesPerTask - 1) / kSamplesPerTask, [&](std::size_t task) {
    const std::size_t last = std::min(cured.size(), (task + 1) * kSamplesPerTask);
    for (std::size_t i = task * kSamplesPerTask; i < last; ++i)
      away[i] = !joined.empty() && joined.holds(cured[i].place, kJoin_px)
                    ? -1
                    : index.distance(cured[i].place, DistanceTally::kMost_px);
  });
  for (std::size_t i = 0; i < cured.size(); ++i) {
    // One crossing a line that meets it head on: both kinds together would count slanted edges twice.
    const bool head_on = cured[i].on_upright ? std::abs(cured[i].normal_y) >= std::abs(cured[i].normal_x)
                                             : std::abs(cured[i].normal_x) > std::abs(cured[i].normal_y);
    if (head_on && away[i] >= 0) figures.cured.add(away[i]);
  }
  add_difference(dose, threshold, index, options.sub_pixels, figures);
  return figures;
}

}  // namespace telefab::fab
