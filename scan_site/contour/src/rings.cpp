// SPDX-License-Identifier: GPL-3.0-or-later
#include "rings.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <telefab/geometry/layer.hpp>
#include <telefab/geometry/limits.hpp>
#include <telefab/scan/contour/layer_checks.hpp>

namespace telefab::scan {
namespace {

constexpr int kDeepest = 8;

/// How far an arc with these end normals bulges over its chord: L sin(angle) / 4 by the worse end.
double sagitta_mm(const PlaneSample& a, const PlaneSample& b) {
  const double dx = b.at.x_mm - a.at.x_mm;
  const double dy = b.at.y_mm - a.at.y_mm;
  const Point2 na = a.normal();
  const Point2 nb = b.normal();
  return std::max(std::abs(na.x_mm * dx + na.y_mm * dy), std::abs(nb.x_mm * dx + nb.y_mm * dy)) / 4;
}

void refine_chord(const PlaneSample& a, const PlaneSample& b, PlaneCursor& plane, double chord_mm, int depth,
                  std::vector<PlaneSample>& out) {
  const double length = distance_mm(a.at, b.at);
  if (depth == kDeepest || length < 2 * chord_mm || sagitta_mm(a, b) <= 0.9 * chord_mm) return;
  const Point2 middle{(a.at.x_mm + b.at.x_mm) / 2, (a.at.y_mm + b.at.y_mm) / 2};
  const auto found = plane.project_in_plane(middle, 0.5 * length, 0.01 * chord_mm);
  if (!found) return;
  refine_chord(a, *found, plane, chord_mm, depth + 1, out);
  out.push_back(*found);
  refine_chord(*found, b, plane, chord_mm, depth + 1, out);
}

}  // namespace

void refine(std::vector<PlaneSample>& ring, PlaneCursor& plane, double chord_mm) {
  std::vector<PlaneSample> out;
  out.reserve(ring.size() * 3 / 2);
  for (std::size_t i = 0; i < ring.size(); ++i) {
    out.push_back(ring[i]);
    refine_chord(ring[i], ring[(i + 1) % ring.size()], plane, chord_mm, 0, out);
  }
  ring.swap(out);
}

void keep_ring(const std::vector<PlaneSample>& ring, const ScalarField& field, double z_mm,
               std::vector<Contour>& rings) {
  if (ring.size() < 3) return;
  double off = 0;
  double width = 0;
  std::vector<Point2> vertices;
  vertices.reserve(ring.size());
  for (const PlaneSample& s : ring) {
    off += std::abs(s.closeness_mm);
    width += field.kernel_width_mm({s.at.x_mm, s.at.y_mm, z_mm});
    if (vertices.empty() || !(vertices.back() == s.at)) vertices.push_back(s.at);
  }
  if (off > 0.5 * width) return;
  while (vertices.size() > 1 && vertices.front() == vertices.back()) vertices.pop_back();
  // A ring without area is a touching point or a rounding error: nothing is exposed there.
  if (auto contour = Contour::from_vertices(std::move(vertices))) rings.push_back(std::move(*contour));
}

void finish_trace(LayerTrace& trace) {
  trace.contours = sorted_canonically(std::move(trace.contours));
  if (const auto place = find_crossing(trace.contours)) {
    trace.faults.push_back({DoubtReason::ContoursCross, *place});
  } else if (const auto nest = find_bad_nesting(trace.contours)) {
    trace.faults.push_back({DoubtReason::NestingWrong, *nest});
  }
}

std::int32_t LayerTrace::euler() const {
  std::int32_t sum = 0;
  for (const Contour& c : contours) sum += c.is_hole() ? -1 : 1;
  return sum;
}

Result<void> GridOptions::validate() const {
  if (!(chord_mm > 0 && chord_mm <= 1))
    return fail(ErrorCode::InvalidInput, fmt::format("chord tolerance {} mm is not in (0, 1]", chord_mm));
  if (!(pitch_kernels > 0 && pitch_kernels <= 1))
    return fail(ErrorCode::InvalidInput, fmt::format("grid pitch {} kernel widths is not in (0, 1]", pitch_kernels));
  return {};
}

}  // namespace telefab::scan
