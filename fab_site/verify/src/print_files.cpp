// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/verify/print_files.hpp>

namespace telefab::fab {
namespace {

constexpr int kCorners = 48;

std::optional<Contour> ring_of(std::vector<Point2> vertices) {
  auto contour = Contour::from_vertices(std::move(vertices));
  return contour ? std::optional{std::move(*contour)} : std::nullopt;
}

std::optional<Contour> around(Point2 a, Point2 b, double radius) {
  if (!(radius > 0)) return std::nullopt;
  const double along = std::atan2(b.y_mm - a.y_mm, b.x_mm - a.x_mm);
  std::vector<Point2> ring;
  for (int i = 0; i < kCorners; ++i) {
    const Point2 c = i < kCorners / 2 ? b : a;
    const double angle = along - std::numbers::pi / 2 + 2 * std::numbers::pi * (i + 0.5) / kCorners;
    ring.push_back({c.x_mm + radius * std::cos(angle), c.y_mm + radius * std::sin(angle)});
  }
  return ring_of(std::move(ring));
}

}  // namespace

Result<WrittenSupports> WrittenSupports::from_json(std::string_view text) {
  WrittenSupports out;
  try {
    const auto root = parsed_json(text);
    const auto finite = [](const nlohmann::ordered_json& value) {
      const double v = value.get<double>();
      if (!(std::abs(v) <= 1e5)) throw std::out_of_range{"a number beyond 100 m"};
      return v;
    };
    const auto layer = [](const nlohmann::ordered_json& value) {
      return whole_number<std::uint32_t>(value, 0, 10'000'000);
    };
    out.elevation_layers_ = layer(root.at("lift_layers"));
    for (const auto& a : root.at("anchors"))
      out.anchors_.emplace_back(Point2{finite(a.at("x_mm")), finite(a.at("y_mm"))},
                                LayerIndex{layer(a.at("part_layer"))});
    for (const auto& s : root.at("sticks")) {
      const auto &p = s.at("bottom_mm"), &q = s.at("top_mm");
      out.cones_.push_back({finite(p.at(0)), finite(p.at(1)), finite(p.at(2)), finite(s.at("bottom_radius_mm")),
                            finite(q.at(0)), finite(q.at(1)), finite(q.at(2)), finite(s.at("top_radius_mm"))});
    }
    for (const auto& p : root.at("plates")) {
      Slab slab{{}, finite(p.at("radius_mm")), finite(p.at("height_mm")), 0};
      const auto corner = [&](const nlohmann::ordered_json& c) {
        slab.corners.push_back({finite(c.at(0)), finite(c.at(1))});
      };
      // Plans of before rafts: bars, with upright lower edges.
      if (p.contains("a_mm")) {
        corner(p.at("a_mm")), corner(p.at("b_mm"));
      } else {
        for (const auto& c : p.at("corners_mm")) corner(c);
        if (slab.corners.empty()) throw std::out_of_range{"a plate without corners"};
        slab.lip = finite(p.at("lip"));
      }
      out.slabs_.push_back(std::move(slab));
    }
  } catch (const std::exception& error) {
    return fail(ErrorCode::InvalidInput, std::string{"supports.json: "} + error.what());
  }
  return out;
}

std::vector<Contour> WrittenSupports::section(LayerIndex print_layer, double thickness_mm) const {
  const double z = (print_layer.count() + 0.5) * thickness_mm;
  std::vector<Contour> rings;
  for (const Cone& c : cones_) {
    if (z < c.z0 || z >= c.z1) continue;
    const double s = (z - c.z0) / (c.z1 - c.z0);
    const Point2 centre{c.x0 + s * (c.x1 - c.x0), c.y0 + s * (c.y1 - c.y0)};
    if (auto ring = around(centre, centre, c.r0 + s * (c.r1 - c.r0))) rings.push_back(std::move(*ring));
  }
  for (const Slab& slab : slabs_) {
    if (z >= slab.height) continue;
    const double radius =
        slab.radius - std::max(0.0, z - slab.height / 2) - slab.lip * std::max(0.0, slab.height / 2 - z);
    // What lies within some distance of a convex ring: the ring, and a bar along each of its edges.
    if (auto inner = slab.corners.size() < 3 ? std::nullopt : ring_of(slab.corners)) rings.push_back(std::move(*inner));
    for (std::size_t i = 0; i < slab.corners.size(); ++i)
      if (auto ring = around(slab.corners[i], slab.corners[(i + 1) % slab.corners.size()], radius))
        rings.push_back(std::move(*ring));
  }
  return rings;
}

}  // namespace telefab::fab
