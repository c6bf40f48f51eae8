// SPDX-License-Identifier: GPL-3.0-or-later
#include "section.hpp"

#include <algorithm>
#include <cmath>

namespace telefab::campaign {
namespace {

/// Where the line y crosses outlines, rising.
void crossings(std::span<const Segment> outlines, double y, std::vector<double>& at) {
  at.clear();
  for (const auto& [a, b] : outlines)
    if ((a.y_mm > y) != (b.y_mm > y)) at.push_back(a.x_mm + (y - a.y_mm) / (b.y_mm - a.y_mm) * (b.x_mm - a.x_mm));
  std::sort(at.begin(), at.end());
}

}  // namespace

std::vector<Segment> segments_of(std::span<const Contour> contours) {
  std::vector<Segment> segments;
  for (const Contour& ring : contours) {
    const auto v = ring.vertices();
    for (std::size_t i = 0; i < v.size(); ++i) segments.push_back({v[i], v[(i + 1) % v.size()]});
  }
  return segments;
}

SectionAreas compare_sections(std::span<const Segment> found, std::span<const Segment> truth, double pitch_mm) {
  double low = 1e300, high = -1e300;
  for (const auto& outlines : {found, truth})
    for (const Segment& s : outlines)
      for (const Point2& p : s) low = std::min(low, p.y_mm), high = std::max(high, p.y_mm);
  SectionAreas areas;
  std::vector<double> a, b, both;
  for (double y = low + pitch_mm / 2; y < high; y += pitch_mm) {
    crossings(found, y, a);
    crossings(truth, y, b);
    for (std::size_t i = 0; i + 1 < b.size(); i += 2) areas.truth_mm2 += pitch_mm * (b[i + 1] - b[i]);
    both.resize(a.size() + b.size());
    std::merge(a.begin(), a.end(), b.begin(), b.end(), both.begin());
    for (std::size_t i = 0; i + 1 < both.size(); i += 2) areas.wrong_mm2 += pitch_mm * (both[i + 1] - both[i]);
  }
  return areas;
}

std::vector<Point2> along(std::span<const Segment> outlines, double step_mm) {
  std::vector<Point2> places;
  double owed = 0;
  for (const auto& [a, b] : outlines) {
    const double length = distance_mm(a, b);
    for (; owed < length; owed += step_mm) {
      const double t = owed / length;
      places.push_back({a.x_mm + t * (b.x_mm - a.x_mm), a.y_mm + t * (b.y_mm - a.y_mm)});
    }
    owed -= length;
  }
  return places;
}

}  // namespace telefab::campaign
