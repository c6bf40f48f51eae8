// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <telefab/scan/measure/contour_deviation.hpp>

namespace telefab::scan {
namespace {

std::uint64_t key_of(std::int64_t x, std::int64_t y) {
  return std::uint64_t{static_cast<std::uint32_t>(x)} << 32U | static_cast<std::uint32_t>(y);
}

double squared_mm2(Point2 p, Point2 a, Point2 b) {
  const double dx = b.x_mm - a.x_mm, dy = b.y_mm - a.y_mm, length = dx * dx + dy * dy;
  const double along =
      length > 0 ? std::clamp(((p.x_mm - a.x_mm) * dx + (p.y_mm - a.y_mm) * dy) / length, 0.0, 1.0) : 0;
  const double ex = p.x_mm - a.x_mm - along * dx, ey = p.y_mm - a.y_mm - along * dy;
  return ex * ex + ey * ey;
}

/// Every vertex, and places between at most `step_mm` apart.
template <class Take>
void walk(std::span<const Contour> contours, double step_mm, const Take& take) {
  for (const Contour& ring : contours) {
    const auto v = ring.vertices();
    for (std::size_t i = 0; i < v.size(); ++i) {
      const Point2 a = v[i], b = v[i + 1 == v.size() ? 0 : i + 1];
      const auto parts = static_cast<int>(std::ceil(distance_mm(a, b) / step_mm));
      for (int k = 0; k < parts; ++k) {
        const double t = static_cast<double>(k) / parts;
        take(Point2{a.x_mm + t * (b.x_mm - a.x_mm), a.y_mm + t * (b.y_mm - a.y_mm)});
      }
    }
  }
}

}  // namespace

ContourEdges::ContourEdges(std::span<const Contour> contours, double cell_mm) : cell_mm_{cell_mm} {
  for (const Contour& ring : contours) {
    const auto v = ring.vertices();
    for (std::size_t i = 0; i < v.size(); ++i) add({v[i], v[i + 1 == v.size() ? 0 : i + 1]});
  }
}

void ContourEdges::add(const Edge& edge) {
  // Places half a cell apart leave out a cell only where the edge cuts its corner, beside one that is kept.
  const auto parts = static_cast<int>(std::ceil(2 * telefab::distance_mm(edge.from, edge.to) / cell_mm_)) + 1;
  std::uint64_t before = ~std::uint64_t{0};
  for (int i = 0; i <= parts; ++i) {
    const double t = static_cast<double>(i) / parts;
    const std::uint64_t here =
        key_of(std::lround(std::floor((edge.from.x_mm + t * (edge.to.x_mm - edge.from.x_mm)) / cell_mm_)),
               std::lround(std::floor((edge.from.y_mm + t * (edge.to.y_mm - edge.from.y_mm)) / cell_mm_)));
    if (here != before) cells_[here].push_back(edge);
    before = here;
  }
}

double ContourEdges::distance_mm(Point2 place) const {
  double best = cell_mm_ * cell_mm_;
  const std::int64_t cx = std::lround(std::floor(place.x_mm / cell_mm_));
  const std::int64_t cy = std::lround(std::floor(place.y_mm / cell_mm_));
  // Two cells, not one: a corner that an edge cuts may be left out.
  for (std::int64_t x = cx - 2; x <= cx + 2; ++x)
    for (std::int64_t y = cy - 2; y <= cy + 2; ++y)
      if (const auto found = cells_.find(key_of(x, y)); found != cells_.end())
        for (const Edge& e : found->second) best = std::min(best, squared_mm2(place, e.from, e.to));
  return std::sqrt(best);
}

Result<void> ContourMeasure::validate() const {
  if (!(step_mm > 0 && most_mm > 0 && std::isfinite(step_mm + most_mm)))
    return fail(ErrorCode::InvalidInput, "the step along contours and the largest distance must be above 0");
  return {};
}

Result<ContourDeviation> measure_contours(std::span<const Layer> reference, std::span<const Layer> built,
                                          const ContourMeasure& options, std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (reference.size() != built.size() || reference.empty())
    return fail(ErrorCode::InvalidInput,
                fmt::format("stacks of {} and {} layers cannot be compared", reference.size(), built.size()));
  std::vector<std::vector<double>> found(reference.size());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, reference.size()}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end() && !stop.stop_requested(); ++i) {
      const ContourEdges there{reference[i].contours, options.most_mm}, here{built[i].contours, options.most_mm};
      walk(reference[i].contours, options.step_mm, [&](Point2 p) { found[i].push_back(here.distance_mm(p)); });
      walk(built[i].contours, options.step_mm, [&](Point2 p) { found[i].push_back(there.distance_mm(p)); });
    }
  });
  if (stop.stop_requested()) return cancelled("measuring contours");
  ContourDeviation deviation;
  std::vector<double> all;
  for (std::size_t i = 0; i < found.size(); ++i) {
    all.insert(all.end(), found[i].begin(), found[i].end());
    deviation.reference_rings += reference[i].contours.size();
    deviation.rings += built[i].contours.size();
    deviation.other_counts += reference[i].contours.size() != built[i].contours.size();
  }
  if (all.empty()) return fail(ErrorCode::InvalidInput, "neither stack has a contour");
  deviation.layers = static_cast<std::uint32_t>(reference.size());
  deviation.places = all.size();
  for (const double d : all) deviation.mean_mm += d / static_cast<double>(all.size());
  const auto rank = all.begin() + static_cast<std::ptrdiff_t>(0.95 * static_cast<double>(all.size() - 1) + 0.5);
  std::nth_element(all.begin(), rank, all.end());
  deviation.p95_mm = *rank;
  deviation.max_mm = *std::max_element(rank, all.end());
  return deviation;
}

std::string to_json(const ContourDeviation& d, double pixel_mm) {
  const auto size = [&](double unit) {
    return fmt::format(R"({{"mean":{:.6g},"p95":{:.6g},"max":{:.6g}}})", d.mean_mm / unit, d.p95_mm / unit,
                       d.max_mm / unit);
  };
  return fmt::format(
      R"({{"size":{},"size_px":{},"places":{},"layers":{},"rings":[{},{}],"layers_with_other_rings":{}}})", size(1),
      pixel_mm > 0 ? size(pixel_mm) : "null", d.places, d.layers, d.reference_rings, d.rings, d.other_counts);
}

}  // namespace telefab::scan
