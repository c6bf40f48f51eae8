// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/carry/carry_watch.hpp>

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;
constexpr std::size_t kMostListed = 200;

Json json_of(const CarryPlace& p) {
  return {{"check", name_of(p.check)},
          {"demand", p.demand},
          {"moment", p.moment.count()},
          {"layer", p.layer.count()},
          {"place", {p.place.x_mm, p.place.y_mm}},
          {"section_mm2", p.section_mm2},
          {"held_mm2", p.held_mm2},
          {"pulled_at", {p.pulled_at.x_mm, p.pulled_at.y_mm}}};
}

Json json_of(const std::optional<CarryPlace>& place) { return place ? json_of(*place) : Json{}; }

Json json_of(const std::vector<CarryPlace>& places) {
  Json list = Json::array();
  for (std::size_t i = 0; i < std::min(kMostListed, places.size()); ++i) list.push_back(json_of(places[i]));
  return {{"count", places.size()}, {"places", std::move(list)}};
}

}  // namespace

std::string_view name_of(CarryPlace::Check check) {
  switch (check) {
    case CarryPlace::Check::Cut:
      return "cut";
    case CarryPlace::Check::Lever:
      return "lever";
    case CarryPlace::Check::Bending:
      return "bending";
  }
  return "cut";
}

const CarryPlace* CarryReport::worst() const {
  const CarryPlace* most = nullptr;
  for (const auto* place : {&cut, &lever, &bending})
    if (*place && (!most || (*place)->demand > most->demand)) most = &**place;
  return most;
}

std::string to_json(const CarryReport& r) {
  const Json value{{"layers", r.layers},
                   {"base_mm2", r.base_mm2},
                   {"afloat_mm2", r.afloat_mm2},
                   {"cut", json_of(r.cut)},
                   {"lever", json_of(r.lever)},
                   {"bending", json_of(r.bending)},
                   {"small", json_of(r.small)},
                   {"weak", json_of(r.weak)},
                   {"weak_small", json_of(r.weak_small)},
                   {"without_weak", json_of(r.without_weak)}};
  return json_text(value);
}

}  // namespace telefab::fab
