// SPDX-License-Identifier: GPL-3.0-or-later
#include "side_check.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace telefab::scan {
namespace {

/// Places asked lie this far apart, in kernel widths, and up to two such steps from a sample or vertex.
constexpr double kStepKernels = 0.7;
constexpr int kSteps = 2;
/// The winding number contradicts a side only where it is this sure of the other,
constexpr double kSure = 0.15;
/// and where no sample is so near (in kernel widths) that it speaks for itself alone.
constexpr double kClearKernels = 0.4;
/// Stretches of one ring count as two where they are farther apart along it than this many kernel widths;
constexpr double kApartKernels = 4;
/// they are compared at places this far apart.
constexpr double kPlaceKernels = 0.4;

/// A quarter of the samples have narrower kernels: places are asked as densely as those ask for.
double typical_width(const ScalarField& field, const SurfaceSamples& near) {
  std::vector<double> widths;
  for (std::size_t i = 0; i < near.points.size(); i += 1 + near.points.size() / 256)
    widths.push_back(field.kernel_width_mm(near.points[i]));
  if (widths.empty()) return 0;
  const auto quarter = widths.begin() + static_cast<std::ptrdiff_t>(widths.size() / 4);
  std::nth_element(widths.begin(), quarter, widths.end());
  return *quarter;
}

struct Cell {
  std::int32_t row, column;
  friend auto operator<=>(const Cell&, const Cell&) = default;
};

/// Cells of this side within kSteps of a sample or vertex, row by row.
std::vector<Cell> cells_about(std::span<const Contour> contours, const SurfaceSamples& near, double side_mm) {
  std::vector<Cell> marked;
  const auto mark = [&](double x, double y) {
    const Cell cell{static_cast<std::int32_t>(std::floor(y / side_mm)),
                    static_cast<std::int32_t>(std::floor(x / side_mm))};
    if (marked.empty() || marked.back() != cell) marked.push_back(cell);
  };
  const auto sort = [](std::vector<Cell>& cells) {
    std::sort(cells.begin(), cells.end());
    cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
  };
  for (const Vec3& p : near.points) mark(p.x(), p.y());
  for (const Contour& ring : contours)
    for (const Point2& p : ring.vertices()) mark(p.x_mm, p.y_mm);
  sort(marked);
  std::vector<Cell> cells;
  for (const Cell& c : marked)
    for (int i = -kSteps; i <= kSteps; ++i)
      for (int j = -kSteps; j <= kSteps; ++j) cells.push_back({c.row + i, c.column + j});
  sort(cells);
  return cells;
}

/// Where the contours cross the line y, rising.
void crossings_of(std::span<const Contour> contours, double y_mm, std::vector<double>& found) {
  found.clear();
  for (const Contour& ring : contours) {
    const auto v = ring.vertices();
    for (std::size_t i = 0; i < v.size(); ++i) {
      const Point2 a = v[i], b = v[i + 1 == v.size() ? 0 : i + 1];
      if ((a.y_mm > y_mm) != (b.y_mm > y_mm))
        found.push_back(a.x_mm + (y_mm - a.y_mm) / (b.y_mm - a.y_mm) * (b.x_mm - a.x_mm));
    }
  }
  std::sort(found.begin(), found.end());
}

/// A place on a contour, and where along which ring.
struct Place {
  Point2 at;
  std::size_t ring;
  double along_mm, length_mm, width_mm;
};

std::vector<Place> places_along(const ScalarField& field, std::span<const Contour> contours, double z_mm) {
  std::vector<Place> places;
  for (std::size_t r = 0; r < contours.size(); ++r) {
    const auto v = contours[r].vertices();
    double length = 0;
    for (std::size_t i = 0; i < v.size(); ++i) length += distance_mm(v[i], v[i + 1 == v.size() ? 0 : i + 1]);
    double along = 0, next = 0;
    for (std::size_t i = 0; i < v.size(); ++i) {
      const Point2 a = v[i], b = v[i + 1 == v.size() ? 0 : i + 1];
      const double edge = distance_mm(a, b);
      const double width = field.kernel_width_mm({a.x_mm, a.y_mm, z_mm});
      for (; next <= along + edge; next += kPlaceKernels * width) {
        const double t = edge > 0 ? (next - along) / edge : 0;
        places.push_back({{a.x_mm + t * (b.x_mm - a.x_mm), a.y_mm + t * (b.y_mm - a.y_mm)}, r, next, length, width});
      }
      along += edge;
    }
  }
  return places;
}

}  // namespace

std::optional<Point2> contradicted_side(const CompletedScan& scan, const ScalarField& field,
                                        std::span<const Contour> contours, double z_mm, const SurfaceSamples& near) {
  const double width = typical_width(field, near);
  if (width <= 0) return std::nullopt;
  const double step = kStepKernels * width;
  std::vector<double> crossings;
  std::optional<std::int32_t> row;
  for (const Cell& c : cells_about(contours, near, step)) {
    const Point2 p{(c.column + 0.5) * step, (c.row + 0.5) * step};
    if (row != c.row) crossings_of(contours, p.y_mm, crossings);
    row = c.row;
    const auto left = std::lower_bound(crossings.begin(), crossings.end(), p.x_mm) - crossings.begin();
    const bool inside = left % 2 == 1;
    const Vec3 place{p.x_mm, p.y_mm, z_mm};
    const double winding = scan.winding_at(place);
    const bool contradicts = inside ? winding < 0.5 - kSure : winding > 0.5 + kSure;
    if (contradicts && scan.side_of(place).distance_mm >= kClearKernels * width) return p;
  }
  return std::nullopt;
}

std::optional<Point2> narrow_passage(const ScalarField& field, std::span<const Contour> contours, double z_mm) {
  const std::vector<Place> places = places_along(field, contours, z_mm);
  double widest = 0;
  for (const Place& p : places) widest = std::max(widest, p.width_mm);
  const auto cell = [&](double v) { return static_cast<std::int64_t>(std::floor(v / widest)); };
  const auto key = [](std::int64_t i, std::int64_t j) { return i * (std::int64_t{1} << 32U) + j; };
  std::unordered_map<std::int64_t, std::vector<std::size_t>> cells;
  for (std::size_t k = 0; k < places.size(); ++k)
    cells[key(cell(places[k].at.x_mm), cell(places[k].at.y_mm))].push_back(k);
  const auto passes = [&](const Place& p, const Place& q) {
    if (distance_mm(p.at, q.at) >= p.width_mm) return false;
    const double between = std::abs(p.along_mm - q.along_mm);
    return p.ring != q.ring || std::min(between, p.length_mm - between) >= kApartKernels * p.width_mm;
  };
  for (const Place& p : places)
    for (std::int64_t i = -1; i <= 1; ++i)
      for (std::int64_t j = -1; j <= 1; ++j)
        if (const auto found = cells.find(key(cell(p.at.x_mm) + i, cell(p.at.y_mm) + j)); found != cells.end())
          for (const std::size_t k : found->second)
            if (passes(p, places[k])) return p.at;
  return std::nullopt;
}

}  // namespace telefab::scan
