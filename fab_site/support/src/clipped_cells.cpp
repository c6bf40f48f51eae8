// SPDX-License-Identifier: GPL-3.0-or-later
#include "clipped_cells.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace telefab::fab {
namespace {

double cross(Flat o, Flat a, Flat b) { return (a.x - o.x) * (b.y - o.y) - (a.y - o.y) * (b.x - o.x); }
double distance(Flat a, Flat b) { return std::sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y)); }
Flat between(Flat a, Flat b, double t) { return {a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)}; }

/// Keeps the part of a convex ring that is nearer to `site` than to `other`.
void keep_nearer(std::vector<Flat>& ring, Flat site, Flat other, std::vector<Flat>& scratch) {
  const double nx = other.x - site.x, ny = other.y - site.y;
  if (nx == 0 && ny == 0) return;
  const double limit = (other.x * other.x + other.y * other.y - site.x * site.x - site.y * site.y) / 2;
  scratch.clear();
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const Flat a = ring[i], b = ring[i + 1 < ring.size() ? i + 1 : 0];
    const double da = nx * a.x + ny * a.y - limit, db = nx * b.x + ny * b.y - limit;
    if (da <= 0) scratch.push_back(a);
    if ((da < 0 && db > 0) || (da > 0 && db < 0)) scratch.push_back(between(a, b, da / (da - db)));
  }
  ring.swap(scratch);
}

/// The line integrals of area and first moments along one directed segment.
struct Moments {
  double area2 = 0, x6 = 0, y6 = 0;
  void add(Flat a, Flat b, Flat origin) {
    const double ax = a.x - origin.x, ay = a.y - origin.y, bx = b.x - origin.x, by = b.y - origin.y;
    const double c = ax * by - ay * bx;
    area2 += c;
    x6 += (ax + bx) * c;
    y6 += (ay + by) * c;
  }
};

/// Where segment a-b crosses edge p-q as a parameter of a-b; half-open so that a shared vertex counts once.
bool crosses(Flat a, Flat b, Flat p, Flat q, double& t) {
  const double sp = cross(a, b, p), sq = cross(a, b, q);
  if ((sp > 0) == (sq > 0)) return false;
  const double sa = cross(p, q, a), sb = cross(p, q, b);
  if ((sa > 0) == (sb > 0)) return false;
  t = sa / (sa - sb);
  return true;
}

Flat circle_of(Flat a, Flat b, Flat c, double& radius) {
  const double bx = b.x - a.x, by = b.y - a.y, cx = c.x - a.x, cy = c.y - a.y;
  const double d = 2 * (bx * cy - by * cx);
  if (std::abs(d) < 1e-14) {
    radius = std::numeric_limits<double>::infinity();
    return a;
  }
  const double bb = bx * bx + by * by, cc = cx * cx + cy * cy;
  const Flat centre{a.x + (cy * bb - by * cc) / d, a.y + (bx * cc - cx * bb) / d};
  radius = distance(centre, a);
  return centre;
}

}  // namespace

std::pair<Flat, double> smallest_circle(const std::vector<Flat>& points) {
  // Grows a set of at most four boundary points by the farthest point outside until nothing lies outside.
  const auto of_few = [](const Flat* p, std::size_t n) {
    Flat centre = p[0];
    double radius = 0;
    const auto holds = [&](Flat q) { return distance(centre, q) <= radius * (1 + 1e-12) + 1e-13; };
    for (std::size_t i = 1; i < n; ++i) {
      if (holds(p[i])) continue;
      centre = p[i], radius = 0;
      for (std::size_t j = 0; j < i; ++j) {
        if (holds(p[j])) continue;
        centre = between(p[i], p[j], 0.5), radius = distance(centre, p[i]);
        for (std::size_t k = 0; k < j; ++k) {
          if (holds(p[k])) continue;
          double r = 0;
          const Flat c = circle_of(p[i], p[j], p[k], r);
          if (std::isfinite(r)) centre = c, radius = r;
        }
      }
    }
    return std::pair{centre, radius};
  };
  Flat basis[4] = {points.front()};
  std::size_t count = 1;
  std::pair<Flat, double> circle{points.front(), 0};
  for (int round = 0; round < 64; ++round) {
    const Flat* worst = nullptr;
    double reach = circle.second * (1 + 1e-9) + 1e-12;
    for (const Flat& p : points)
      if (const double d = distance(circle.first, p); d > reach) reach = d, worst = &p;
    if (worst == nullptr) break;
    basis[count++] = *worst;
    circle = of_few(basis, count);
    if (count == 4) {
      // Four on the way in, three carry the circle: drop the one deepest inside.
      std::size_t deepest = 0;
      for (std::size_t i = 1; i < 4; ++i)
        if (distance(basis[i], circle.first) < distance(basis[deepest], circle.first)) deepest = i;
      basis[deepest] = basis[3];
      count = 3;
    }
  }
  double reach = 0;
  for (const Flat& p : points) reach = std::max(reach, distance(circle.first, p));
  return {circle.first, reach};
}

CellRegion::CellRegion(const Region& region, double unit_mm) : unit_mm_{unit_mm} {
  const Bounds2 box = region.bounds();
  origin_mm_ = box.min;
  const auto scaled = [&](GridPoint p) {
    const Point2 mm = telefab::fab::to_mm(p);
    return Flat{(mm.x_mm - origin_mm_.x_mm) / unit_mm, (mm.y_mm - origin_mm_.y_mm) / unit_mm};
  };
  for (const GridRing& ring : region.rings())
    for (std::size_t i = 0; i < ring.size(); ++i)
      edges_.push_back({scaled(ring[i]), scaled(ring[i + 1 < ring.size() ? i + 1 : 0])});
  least_ = {0, 0};
  most_ = {(box.max.x_mm - box.min.x_mm) / unit_mm, (box.max.y_mm - box.min.y_mm) / unit_mm};
  area_ = region.area_mm2() / (unit_mm * unit_mm);
  bucket_ = std::max({0.5, most_.x / 512, most_.y / 512});
  columns_ = static_cast<int>(most_.x / bucket_) + 1;
  rows_ = static_cast<int>(most_.y / bucket_) + 1;
  buckets_.resize(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_));
  for (std::uint32_t e = 0; e < edges_.size(); ++e) {
    const auto& [a, b] = edges_[e];
    const int c0 = std::clamp(static_cast<int>(std::min(a.x, b.x) / bucket_), 0, columns_ - 1);
    const int c1 = std::clamp(static_cast<int>(std::max(a.x, b.x) / bucket_), 0, columns_ - 1);
    const int r0 = std::clamp(static_cast<int>(std::min(a.y, b.y) / bucket_), 0, rows_ - 1);
    const int r1 = std::clamp(static_cast<int>(std::max(a.y, b.y) / bucket_), 0, rows_ - 1);
    for (int r = r0; r <= r1; ++r)
      for (int c = c0; c <= c1; ++c) buckets_[static_cast<std::size_t>(r * columns_ + c)].push_back(e);
  }
}

Point2 CellRegion::to_mm(Flat p) const { return {origin_mm_.x_mm + p.x * unit_mm_, origin_mm_.y_mm + p.y * unit_mm_}; }

Flat CellRegion::from_mm(Point2 p) const {
  return {(p.x_mm - origin_mm_.x_mm) / unit_mm_, (p.y_mm - origin_mm_.y_mm) / unit_mm_};
}

bool CellRegion::inside(Flat p) const {
  if (p.x < least_.x || p.x > most_.x || p.y < least_.y || p.y > most_.y) return false;
  const int row = std::clamp(static_cast<int>(p.y / bucket_), 0, rows_ - 1);
  const int column = std::clamp(static_cast<int>(p.x / bucket_), 0, columns_ - 1);
  // A ray to the right; an edge that lies in several buckets is counted in the one that holds its crossing.
  int winding = 0;
  for (int c = column; c < columns_; ++c)
    for (const std::uint32_t e : buckets_[static_cast<std::size_t>(row * columns_ + c)]) {
      const auto& [a, b] = edges_[e];
      if ((a.y <= p.y) == (b.y <= p.y)) continue;
      // Rounding must not carry it out of the buckets the edge lies in.
      const double x =
          std::clamp(a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x), std::min(a.x, b.x), std::max(a.x, b.x));
      if (x <= p.x) continue;
      if (std::clamp(static_cast<int>(x / bucket_), 0, columns_ - 1) != c) continue;
      winding += b.y > a.y ? 1 : -1;
    }
  return winding > 0;
}

Flat CellRegion::last_inside(Flat from, Flat to) const {
  double first = 2;
  for (const auto& [a, b] : edges_)
    if (double t = 0; crosses(from, to, a, b, t)) first = std::min(first, t);
  return first > 1 ? to : between(from, to, std::max(0.0, first - 1e-3));
}

Flat CellRegion::nearest_boundary(Flat p) const {
  double best = std::numeric_limits<double>::infinity();
  Flat found = p;
  for (const auto& [a, b] : edges_) {
    const double vx = b.x - a.x, vy = b.y - a.y, l = vx * vx + vy * vy;
    const double t = l > 0 ? std::clamp(((p.x - a.x) * vx + (p.y - a.y) * vy) / l, 0.0, 1.0) : 0.0;
    const Flat q = between(a, b, t);
    if (const double d = distance(p, q); d < best) best = d, found = q;
  }
  return found;
}

Flat CellRegion::nudged_inside(Flat p) const {
  for (const double step : {1e-2, 1e-3, 1e-4, 1e-5, 1e-6})
    for (int i = 0; i < 16; ++i) {
      const double angle = i * 0.39269908169872414;
      const Flat q{p.x + step * std::cos(angle), p.y + step * std::sin(angle)};
      if (inside(q)) return q;
    }
  return p;
}

void CellRegion::gather(Flat low, Flat high, std::vector<std::uint32_t>& found, std::vector<std::uint32_t>& stamp,
                        std::uint32_t mark) const {
  found.clear();
  const int c0 = std::clamp(static_cast<int>(low.x / bucket_), 0, columns_ - 1);
  const int c1 = std::clamp(static_cast<int>(high.x / bucket_), 0, columns_ - 1);
  const int r0 = std::clamp(static_cast<int>(low.y / bucket_), 0, rows_ - 1);
  const int r1 = std::clamp(static_cast<int>(high.y / bucket_), 0, rows_ - 1);
  for (int r = r0; r <= r1; ++r)
    for (int c = c0; c <= c1; ++c)
      for (const std::uint32_t e : buckets_[static_cast<std::size_t>(r * columns_ + c)]) {
        if (stamp[e] == mark) continue;
        stamp[e] = mark;
        const auto& [a, b] = edges_[e];
        if (std::min(a.x, b.x) <= high.x && std::max(a.x, b.x) >= low.x && std::min(a.y, b.y) <= high.y &&
            std::max(a.y, b.y) >= low.y)
          found.push_back(e);
      }
  std::sort(found.begin(), found.end());
}

ClippedCell CellRegion::cut(Flat site, const std::vector<Flat>& cell, const std::vector<std::uint32_t>& near) const {
  ClippedCell out;
  Moments moments;
  std::vector<Flat> corners;
  const auto take = [&](Flat a, Flat b) {
    moments.add(a, b, site);
    corners.push_back(a);
    corners.push_back(b);
  };
  // The region's edges inside the cell.
  for (const std::uint32_t e : near) {
    const auto& [a, b] = edges_[e];
    double from = 0, to = 1;
    for (std::size_t i = 0; i < cell.size() && from < to; ++i) {
      const Flat p = cell[i], q = cell[i + 1 < cell.size() ? i + 1 : 0];
      const double da = cross(p, q, a), db = cross(p, q, b);
      if (da < 0 && db < 0)
        from = 1, to = 0;
      else if (da < 0)
        from = std::max(from, da / (da - db));
      else if (db < 0)
        to = std::min(to, da / (da - db));
    }
    if (from < to) take(between(a, b, from), between(a, b, to));
  }
  // The cell's edges inside the region: inside or not is known at its first corner and flips at every crossing on the
  // way. Where that does not come out even, a corner lies on the region's edge, and every stretch is asked for.
  std::vector<std::pair<Flat, Flat>> stretches;
  std::vector<double> cuts;
  double t = 0;
  const bool starts_inside = inside(cell.front());
  bool in = starts_inside;
  const auto walk = [&](bool ask) {
    stretches.clear();
    for (std::size_t i = 0; i < cell.size(); ++i) {
      const Flat p = cell[i], q = cell[i + 1 < cell.size() ? i + 1 : 0];
      cuts.clear();
      for (const std::uint32_t e : near)
        if (crosses(p, q, edges_[e].a, edges_[e].b, t)) cuts.push_back(t);
      std::sort(cuts.begin(), cuts.end());
      cuts.push_back(1);
      double last = 0;
      for (std::size_t c = 0; c < cuts.size(); ++c) {
        if (ask ? inside(between(p, q, (last + cuts[c]) / 2)) : in)
          stretches.emplace_back(between(p, q, last), c + 1 < cuts.size() ? between(p, q, cuts[c]) : q);
        last = cuts[c];
        if (c + 1 < cuts.size()) in = !in;
      }
    }
  };
  walk(false);
  if (in != starts_inside) walk(true);
  for (const auto& [a, b] : stretches) take(a, b);
  if (corners.empty()) return out;
  out.area = moments.area2 / 2;
  out.centroid = moments.area2 > 1e-12
                     ? Flat{site.x + moments.x6 / (3 * moments.area2), site.y + moments.y6 / (3 * moments.area2)}
                     : corners.front();
  out.farthest = site;
  for (const Flat& p : corners)
    if (const double d = distance(site, p); d > out.farthest_distance) out.farthest_distance = d, out.farthest = p;
  std::tie(out.circle_centre, out.circle_radius) = smallest_circle(corners);
  return out;
}

std::vector<ClippedCell> CellRegion::cells(const std::vector<Flat>& sites, const std::vector<char>& wanted) const {
  const auto neighbours = delaunay_neighbours(sites);
  std::vector<ClippedCell> out(sites.size());
  std::vector<std::uint32_t> near, stamp(edges_.size(), 0);
  std::vector<Flat> cell, scratch;
  const double margin = 1e-3;
  for (std::uint32_t i = 0; i < sites.size(); ++i) {
    if (!wanted.empty() && !wanted[i]) continue;
    cell = {{least_.x - margin, least_.y - margin},
            {most_.x + margin, least_.y - margin},
            {most_.x + margin, most_.y + margin},
            {least_.x - margin, most_.y + margin}};
    for (const std::uint32_t j : neighbours[i]) keep_nearer(cell, sites[i], sites[j], scratch);
    if (cell.size() < 3) continue;
    Flat low = sites[i], high = sites[i];
    for (const Flat& p : cell) {
      low = {std::min(low.x, p.x), std::min(low.y, p.y)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y)};
    }
    gather(low, high, near, stamp, i + 1);
    out[i] = cut(sites[i], cell, near);
  }
  return out;
}

}  // namespace telefab::fab
