// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/support/pictures.hpp>
#include <telefab/geometry/limits.hpp>

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

tl::unexpected<Error> refuse(std::string what) { return fail(ErrorCode::InvalidInput, "GeoJSON: " + std::move(what)); }

Result<GridRing> ring_of(const Json& points) {
  if (!points.is_array() || points.size() < 4)
    return refuse("a ring needs at least four points, the last equal to the first");
  if (points.size() > kMaxVerticesPerLayer) return refuse("too many points in a ring");
  GridRing ring;
  for (const Json& point : points) {
    if (!point.is_array() || point.size() < 2 || !point[0].is_number() || !point[1].is_number())
      return refuse("a point must be [x, y] in millimetres");
    const double x = point[0].get<double>(), y = point[1].get<double>();
    if (!(std::abs(x) <= kMaxCoordinateMm && std::abs(y) <= kMaxCoordinateMm))
      return refuse(fmt::format("a coordinate lies beyond {} mm", kMaxCoordinateMm));
    ring.push_back(to_grid({x, y}));
  }
  if (ring.front() == ring.back()) ring.pop_back();
  return ring;
}

/// One polygon: outer ring first, holes after it, in either direction.
Result<Region> polygon_of(const Json& rings) {
  if (!rings.is_array() || rings.empty()) return refuse("a Polygon needs a list of rings");
  std::vector<GridRing> all;
  for (const Json& points : rings) {
    auto ring = ring_of(points);
    if (!ring) return tl::unexpected{ring.error()};
    all.push_back(std::move(*ring));
  }
  return Region::from_rings(all, true);
}

Result<void> gather(const Json& node, std::vector<Region>& found, int depth) {
  if (depth > 8) return refuse("nested too deeply");
  if (!node.is_object() || !node.contains("type") || !node["type"].is_string())
    return refuse("an object without a \"type\"");
  const std::string type = node["type"];
  const auto list = [&](const char* key) -> Result<const Json*> {
    if (!node.contains(key) || !node[key].is_array()) return refuse(fmt::format("{} without \"{}\"", type, key));
    return &node[key];
  };
  if (type == "Polygon" || type == "MultiPolygon") {
    const auto coordinates = list("coordinates");
    if (!coordinates) return tl::unexpected{coordinates.error()};
    const Json one = Json::array({**coordinates});
    for (const Json& rings : type == "Polygon" ? one : **coordinates) {
      auto polygon = polygon_of(rings);
      if (!polygon) return tl::unexpected{polygon.error()};
      found.push_back(std::move(*polygon));
    }
    return {};
  }
  if (type == "Feature") {
    if (!node.contains("geometry")) return refuse("Feature without \"geometry\"");
    return gather(node["geometry"], found, depth + 1);
  }
  if (type == "FeatureCollection" || type == "GeometryCollection") {
    const auto members = list(type == "FeatureCollection" ? "features" : "geometries");
    if (!members) return tl::unexpected{members.error()};
    for (const Json& member : **members)
      if (auto ok = gather(member, found, depth + 1); !ok) return ok;
    return {};
  }
  return refuse(fmt::format("\"{}\" is not a polygon", type));
}

}  // namespace

Result<Region> region_from_geojson(std::string_view text) {
  const Json root = json_or_discarded(text);
  if (root.is_discarded()) return refuse("not JSON");
  std::vector<Region> found;
  if (auto ok = gather(root, found, 0); !ok) return tl::unexpected{ok.error()};
  return unite(found);
}

}  // namespace telefab::fab
