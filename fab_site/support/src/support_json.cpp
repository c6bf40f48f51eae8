// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::uint32_t kMostLayers = 1'000'000;

double rounded(double mm) { return std::round(mm * 1e6) / 1e6 + 0.0; }
Json point(const Point3& p) { return Json::array({rounded(p.x_mm), rounded(p.y_mm), rounded(p.z_mm)}); }

Result<double> number(const nlohmann::ordered_json& entry, const char* key) {
  const auto found = entry.find(key);
  if (found == entry.end() || !found->is_number())
    return fail(ErrorCode::InvalidInput, fmt::format("hand list: every entry needs a number \"{}\"", key));
  return found->get<double>();
}

Result<std::vector<std::vector<double>>> entries(const nlohmann::ordered_json& root, const char* list,
                                                 std::initializer_list<const char*> keys) {
  std::vector<std::vector<double>> rows;
  const auto found = root.find(list);
  if (found == root.end()) return rows;
  if (!found->is_array() || found->size() > 10'000)
    return fail(ErrorCode::InvalidInput, fmt::format("hand list: \"{}\" must be a list of at most 10000", list));
  for (const auto& entry : *found) {
    if (!entry.is_object() || entry.size() != keys.size())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("hand list: an entry of \"{}\" must have exactly {}", list, fmt::join(keys, ", ")));
    std::vector<double> row;
    for (const char* key : keys) {
      auto value = number(entry, key);
      if (!value) return tl::unexpected{value.error()};
      row.push_back(*value);
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace

Result<HandList> hand_list_from_json(std::string_view text) {
  const auto root = json_or_discarded(text);
  if (root.is_discarded() || !root.is_object())
    return fail(ErrorCode::InvalidInput, "hand list: not a JSON object with \"extra\", \"forbidden\" and \"removed\"");
  for (const auto& [key, value] : root.items())
    if (key != "extra" && key != "forbidden" && key != "removed")
      return fail(ErrorCode::InvalidInput, fmt::format("hand list: unknown key \"{}\"", key));
  HandList list;
  auto extra = entries(root, "extra", {"x_mm", "y_mm", "z_mm"});
  if (!extra) return tl::unexpected{extra.error()};
  for (const auto& row : *extra) list.extra.push_back({{row[0], row[1]}, row[2]});
  auto forbidden = entries(root, "forbidden", {"x_mm", "y_mm", "radius_mm", "from_z_mm", "to_z_mm"});
  if (!forbidden) return tl::unexpected{forbidden.error()};
  for (const auto& row : *forbidden) list.forbidden.push_back({{row[0], row[1]}, row[2], row[3], row[4]});
  auto removed = entries(root, "removed", {"x_mm", "y_mm", "part_layer"});
  if (!removed) return tl::unexpected{removed.error()};
  for (const auto& row : *removed) {
    if (!(row[2] >= 0 && row[2] <= kMostLayers && row[2] == std::floor(row[2])))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("hand list: \"part_layer\" of a removed anchor must be a whole number from 0 to {}",
                              kMostLayers));
    list.removed.push_back({{row[0], row[1]}, LayerIndex{static_cast<std::uint32_t>(row[2])}});
  }
  SupportOptions check;
  check.hand = list;
  if (auto ok = check.validate(); !ok) return tl::unexpected{ok.error()};
  return list;
}

std::string to_json(const HandList& list) {
  Json extra = Json::array(), forbidden = Json::array(), removed = Json::array();
  for (const auto& e : list.extra) extra.push_back({{"x_mm", e.place.x_mm}, {"y_mm", e.place.y_mm}, {"z_mm", e.z_mm}});
  for (const auto& f : list.forbidden)
    forbidden.push_back({{"x_mm", f.place.x_mm},
                         {"y_mm", f.place.y_mm},
                         {"radius_mm", f.radius_mm},
                         {"from_z_mm", f.from_z_mm},
                         {"to_z_mm", f.to_z_mm}});
  for (const auto& r : list.removed)
    removed.push_back({{"x_mm", r.place.x_mm}, {"y_mm", r.place.y_mm}, {"part_layer", r.layer.count()}});
  return json_text({{"extra", extra}, {"forbidden", forbidden}, {"removed", removed}});
}

std::string to_json(const SupportPlan& plan) {
  const SupportFigures& f = plan.figures();
  Json root;
  root["lift_layers"] = plan.elevation_layers();
  root["figures"] = {{"anchors", plan.anchors().size()},
                     {"layers_with_regions", f.layers_with_regions},
                     {"to_support_mm2", rounded(f.to_support_mm2)},
                     {"waived_mm2", rounded(f.waived_mm2)},
                     {"removed", f.removed},
                     {"feet_on_part", f.feet_on_part},
                     {"braces", f.braces},
                     {"needles", f.thin_pins},
                     {"may_buckle", f.may_buckle},
                     {"unreached", f.unreached},
                     {"part_mm3", rounded(f.part_mm3)},
                     {"support_mm3", rounded(f.support_mm3)},
                     {"floating", f.floating},
                     {"medium_tips", f.medium_tips},
                     {"heavy_tips", f.heavy_tips},
                     {"bearing", f.bearing},
                     {"bearing_demand", rounded(f.bearing_demand)},
                     {"steadying", f.stabilising},
                     {"stability_mm", rounded(f.stability_mm)},
                     {"least_stable_layer", f.least_stable.count()}};
  Json anchors = Json::array();
  for (const Anchor& a : plan.anchors())
    anchors.push_back({{"x_mm", rounded(a.place.x_mm)},
                       {"y_mm", rounded(a.place.y_mm)},
                       {"part_layer", a.layer.count()},
                       {"by_hand", a.by_hand},
                       {"on_part", a.on_part},
                       {"tip", name_of(a.tip)},
                       {"demand", rounded(a.demand)}});
  root["anchors"] = std::move(anchors);
  Json elements = Json::array();
  for (const SupportElement& s : plan.structure().elements)
    elements.push_back({{"kind", name_of(s.kind)},
                        {"bottom_mm", point(s.bottom)},
                        {"top_mm", point(s.top)},
                        {"bottom_radius_mm", rounded(s.bottom_radius_mm)},
                        {"top_radius_mm", rounded(s.top_radius_mm)}});
  root["sticks"] = std::move(elements);
  Json plates = Json::array();
  for (const Plate& p : plan.structure().plates) {
    Json corners = Json::array();
    for (const Point2 c : p.corners) corners.push_back({rounded(c.x_mm), rounded(c.y_mm)});
    plates.push_back({{"corners_mm", std::move(corners)},
                      {"radius_mm", rounded(p.radius_mm)},
                      {"height_mm", rounded(p.height_mm)},
                      {"lip", rounded(p.lip)}});
  }
  root["plates"] = std::move(plates);
  return json_text(root, 1) + "\n";
}

}  // namespace telefab::fab
