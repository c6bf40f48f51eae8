// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <toml++/toml.h>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <span>
#include <telefab/base/file.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <variant>

#include "builtin_profiles.hpp"

namespace telefab {
namespace {

struct NumberKey {
  std::function<double&(MachineProfile&)> field;
  double least;
  double most;
};
struct CountKey {
  std::function<std::uint32_t&(MachineProfile&)> field;
  std::uint32_t least;
  std::uint32_t most;
};
struct TextKey {
  std::function<std::string&(MachineProfile&)> field;
};
struct WordKey {
  std::function<std::string_view(const MachineProfile&)> name;
  std::function<bool(MachineProfile&, std::string_view)> take;  ///< false: not one of them
  std::span<const std::string_view> all;
};
/// Numbers from 0 to 1 that never fall, or none.
struct CurveKey {
  std::function<std::vector<double>&(MachineProfile&)> field;
};
/// Rows of equal length, or none.
struct GridKey {
  std::function<std::vector<std::vector<double>>&(MachineProfile&)> field;
  double least;
  double most;
};
constexpr std::size_t kMostCurve = 256;
constexpr std::size_t kMostGridSide = 64;

struct Key {
  std::string_view section;
  std::string_view name;
  bool required;
  std::string_view reason;
  std::variant<NumberKey, CountKey, TextKey, WordKey, CurveKey, GridKey> kind;
};

using P = MachineProfile;

template <class Section, class Value>
std::function<Value&(P&)> at(Section P::*section, Value Section::*value) {
  return [=](P& profile) -> Value& { return profile.*section.*value; };
}

template <class Section, MachineWord Word>
WordKey words(Section P::*section, Word Section::*value) {
  return {[=](const P& profile) { return name_of(profile.*section.*value); },
          [=](P& profile, std::string_view name) {
            const auto word = machine_word_from<Word>(name);
            if (word) profile.*section.*value = *word;
            return word.has_value();
          },
          kMachineWords<Word>};
}

const std::vector<Key>& keys() {
  static const std::vector<Key> table{
      {"platform", "width_mm", true, "along x, the mask's columns",
       NumberKey{at(&P::platform, &P::Platform::width_mm), 0.1, 2000}},
      {"platform", "depth_mm", true, "along y, the mask's rows",
       NumberKey{at(&P::platform, &P::Platform::depth_mm), 0.1, 2000}},
      {"platform", "z_travel_mm", true, "tallest part with its base",
       NumberKey{at(&P::platform, &P::Platform::z_travel_mm), 0.1, 2000}},
      {"platform", "most_peel_mm2", false,
       "largest layer that its lift can pull off the vat; more holds the job; 0: not stated",
       NumberKey{at(&P::platform, &P::Platform::most_peel_mm2), 0, 1e7}},
      {"projection", "pixel_pitch_mm", true, "one pixel on the vat",
       NumberKey{at(&P::projection, &P::Projection::pixel_pitch_mm), 0.001, 1}},
      {"projection", "orientation", false, "what the optics do to a mask",
       words(&P::projection, &P::Projection::orientation)},
      {"projection", "controllers", false, "who drives which half of the mirrors",
       words(&P::projection, &P::Projection::controllers)},
      {"projection", "spread_px", false, "sigma of one pixel's Gaussian light spot",
       NumberKey{at(&P::projection, &P::Projection::spread_px), 0.05, 5}},
      {"projection", "gamma", false, "relative irradiance = (grey/255)^gamma, unless there is a curve",
       NumberKey{at(&P::projection, &P::Projection::gamma), 0.3, 4}},
      {"projection", "curve", false, "measured relative irradiance at equally spaced greys, instead of gamma",
       CurveKey{at(&P::projection, &P::Projection::curve)}},
      {"projection", "leak", false, "share of full irradiance that black leaks",
       NumberKey{at(&P::projection, &P::Projection::leak), 0, 0.1}},
      // Below a twentieth an edge has no light to speak of: that is a broken lens, not a field.
      {"projection", "field", false, "share of the irradiance at the middles of equal cells, rows from back to front",
       GridKey{at(&P::projection, &P::Projection::field), 0.05, 1}},
      {"projection", "irradiance_mw_per_cm2", true, "of a white area on the vat",
       NumberKey{at(&P::projection, &P::Projection::irradiance_mw_per_cm2), 0.01, 1000}},
      {"layers", "thickness_mm", true, "height of one layer",
       NumberKey{at(&P::layers, &P::Layers::thickness_mm), 0.001, 1}},
      {"layers", "exposure_s", true, "of a normal layer",
       NumberKey{at(&P::layers, &P::Layers::exposure_s), 0.001, 300}},
      {"layers", "bottom_count", false, "layers with the longer exposure",
       CountKey{at(&P::layers, &P::Layers::bottom_count), 0, 100}},
      {"layers", "bottom_exposure_s", true, "of a bottom layer",
       NumberKey{at(&P::layers, &P::Layers::bottom_exposure_s), 0.001, 600}},
      {"resin", "name", false, "for people", TextKey{at(&P::resin, &P::Resin::name)}},
      {"resin", "critical_dose_mj_per_cm2", false, "Ec",
       NumberKey{at(&P::resin, &P::Resin::critical_dose_mj_per_cm2), 0.01, 10000}},
      {"resin", "penetration_mm", false, "Dp", NumberKey{at(&P::resin, &P::Resin::penetration_mm), 0.001, 10}},
      {"resin", "critical_dose_least_mj_per_cm2", false,
       "Ec is this or more, with 95 % confidence: `calibrate fit` says so; 0: not measured",
       NumberKey{at(&P::resin, &P::Resin::critical_dose_least_mj_per_cm2), 0, 10000}},
      {"resin", "critical_dose_most_mj_per_cm2", false, "and this or less",
       NumberKey{at(&P::resin, &P::Resin::critical_dose_most_mj_per_cm2), 0, 10000}},
      {"resin", "penetration_least_mm", false,
       "Dp is this or more, with 95 % confidence: `calibrate fit` says so; 0: not measured",
       NumberKey{at(&P::resin, &P::Resin::penetration_least_mm), 0, 10}},
      {"resin", "penetration_most_mm", false, "and this or less",
       NumberKey{at(&P::resin, &P::Resin::penetration_most_mm), 0, 10}},
      {"resin", "calibration_correlation", false, "of the errors of Dp and of the logarithm of Ec, which one fit found",
       NumberKey{at(&P::resin, &P::Resin::calibration_correlation), -1, 1}},
      {"resin", "vat_ml", false, "resin that the vat holds; a job that needs more is held; 0: not stated",
       NumberKey{at(&P::resin, &P::Resin::vat_ml), 0, 1e6}},
      {"resin", "green_strength_mpa", false,
       "strength of printed resin before it is washed and cured; 0: not stated, then 10 is assumed, about half of the "
       "softest figure found (18.6, Formlabs sheet of Durable, green); flexible resins: a quarter, assumed",
       NumberKey{at(&P::resin, &P::Resin::green_strength_mpa), 0, 1000}},
      {"supports", "self_support_mm", false,
       "overhang per layer that a small attached region holds; less: more anchors",
       NumberKey{at(&P::supports, &P::Supports::self_support_mm), 0, 10}},
      {"supports", "self_support_growth_per_mm", false, "growth of that per sqrt of the attached area",
       NumberKey{at(&P::supports, &P::Supports::self_support_growth_per_mm), 0, 1000}},
      {"supports", "self_support_most_mm", false, "no attached region holds an overhang beyond this in one layer",
       NumberKey{at(&P::supports, &P::Supports::self_support_most_mm), 0, 50}},
      {"supports", "anchor_distance_mm", false, "every point to be supported lies this near an anchor",
       NumberKey{at(&P::supports, &P::Supports::anchor_distance_mm), 0.05, 50}},
      {"supports", "tip_radius_mm", false, "contact disc; smaller breaks off cleaner, below a pixel it may not cure",
       NumberKey{at(&P::supports, &P::Supports::tip_radius_mm), 0.005, 5}},
      {"supports", "pin_radius_mm", false, "shaft of a pin; thinner saves resin and gets more braces",
       NumberKey{at(&P::supports, &P::Supports::pin_radius_mm), 0.01, 10}},
      {"supports", "foot_radius_mm", false, "footing of a pin on the platform; wider holds against the peel",
       NumberKey{at(&P::supports, &P::Supports::foot_radius_mm), 0.01, 20}},
      {"supports", "clearance_mm", false, "between supports and part except at tips and feet",
       NumberKey{at(&P::supports, &P::Supports::clearance_mm), 0, 10}},
      {"supports", "brace_pitch_mm", false,
       "vertical distance of slanted struts between pins that are too slender alone",
       NumberKey{at(&P::supports, &P::Supports::brace_pitch_mm), 0.1, 200}},
      {"supports", "slenderness", false, "free pin length over diameter at most",
       NumberKey{at(&P::supports, &P::Supports::slenderness), 2, 500}},
      {"supports", "base_thickness_mm", false,
       "plate that joins the feet of a group, so that the peel does not lift one",
       NumberKey{at(&P::supports, &P::Supports::base_thickness_mm), 0, 10}},
      {"supports", "stand_area_share", false, "a first layer of at least this share of the largest needs no lift",
       NumberKey{at(&P::supports, &P::Supports::stand_area_share), 0, 1}},
      {"supports", "lift_off_mm", false, "height of a supported part above the platform: room for tips and a blade",
       NumberKey{at(&P::supports, &P::Supports::lift_off_mm), 0, 50}},
      {"supports", "safety", false, "strength over the stress that a plan may ask for; 2 is assumed",
       NumberKey{at(&P::supports, &P::Supports::safety), 1, 100}},
      {"supports", "fresh_share", false,
       "strength of a tip some seconds after its exposure as share of the green strength; 0.5 is assumed: with it a "
       "plan may ask for what PrusaSlicer's plans ask for",
       NumberKey{at(&P::supports, &P::Supports::fresh_share), 0.01, 1}},
      {"motion", "lift_mm", false, "peel: up by this after each exposure",
       NumberKey{at(&P::motion, &P::Motion::lift_mm), 0, 100}},
      {"motion", "lift_speed_mm_per_s", false, "while peeling",
       NumberKey{at(&P::motion, &P::Motion::lift_speed_mm_per_s), 0.01, 100}},
      {"motion", "lower_speed_mm_per_s", false, "back to the vat",
       NumberKey{at(&P::motion, &P::Motion::lower_speed_mm_per_s), 0.01, 100}},
      {"motion", "settle_s", false, "resin comes to rest", NumberKey{at(&P::motion, &P::Motion::settle_s), 0, 120}},
      {"motion", "pull_kpa", false,
       "pull of the film on the layer just exposed, over its area; measured elsewhere: ACF 12, FEP 12 to 18 "
       "(AmeraLabs), PDMS 16 to 20 (Pan 2017); 0: not stated, then 20 is assumed; 10 where a gentle film or a tilt was "
       "measured to be so, 50 for a worn or rigid window; printed from above: 1, assumed",
       NumberKey{at(&P::motion, &P::Motion::pull_kpa), 0, 1000}},
      {"motion", "push_kpa", false,
       "sideways push on the layer just exposed, over its area, in any direction; 0 where a film is peeled; printed "
       "from above with a blade or a dip: 0.5, assumed",
       NumberKey{at(&P::motion, &P::Motion::push_kpa), 0, 1000}},
      {"devices", "projector", false, "light engine", words(&P::devices, &P::Devices::projector)},
      {"devices", "stage", false, "Z stage", words(&P::devices, &P::Devices::stage)},
      {"devices", "speed_up", false, "virtual devices: simulated seconds per real second",
       NumberKey{at(&P::devices, &P::Devices::speed_up), 1, 1e6}},
      {"devices", "allowed_slowdown", false, "a job whose uploads stretch it beyond this is refused",
       NumberKey{at(&P::devices, &P::Devices::allowed_slowdown), 1, 100}},
      {"devices", "led_current", false, "dlpc900: never sent above",
       CountKey{at(&P::devices, &P::Devices::led_current), 0, 255}},
      {"devices", "led_colour", false, "dlpc900", words(&P::devices, &P::Devices::led_colour)},
      {"devices", "led_polarity", false, "dlpc900: PWM polarity under which more current is more light on this board",
       words(&P::devices, &P::Devices::led_polarity)},
      {"devices", "led_off", false, "dlpc900: what darkens the LEDs of this board",
       words(&P::devices, &P::Devices::led_off)},
      {"devices", "led_cutoff", false,
       "dlpc900 with led_off = \"enable-and-current\": what darkens the LEDs where this computer dies",
       words(&P::devices, &P::Devices::led_cutoff)},
      {"devices", "thermometer", false, "marlin: the sensor that is in the resin",
       words(&P::devices, &P::Devices::thermometer)},
      {"devices", "hottest_celsius", false, "resin above this stops the print, dark; 0: no limit",
       NumberKey{at(&P::devices, &P::Devices::hottest_celsius), 0, 150}},
      {"devices", "coldest_celsius", false, "resin below this stops the print, dark; 0: no limit",
       NumberKey{at(&P::devices, &P::Devices::coldest_celsius), 0, 150}},
      {"devices", "projector_serial", false, "dlpc900: its USB serial number",
       TextKey{at(&P::devices, &P::Devices::projector_serial)}},
      {"devices", "stage_serial", false, "USB serial number of the stage's tty",
       TextKey{at(&P::devices, &P::Devices::stage_serial)}},
  };
  return table;
}

std::string range_of(const Key& key) {
  if (const auto* n = std::get_if<NumberKey>(&key.kind)) return fmt::format("{} to {}", n->least, n->most);
  if (const auto* c = std::get_if<CountKey>(&key.kind)) return fmt::format("{} to {}, whole", c->least, c->most);
  if (std::holds_alternative<CurveKey>(key.kind))
    return fmt::format("2 to {} numbers that never fall, the first 0, the last 1; or none", kMostCurve);
  if (const auto* g = std::get_if<GridKey>(&key.kind))
    return fmt::format("up to {0} rows of equal length up to {0}, numbers {1} to {2}; or none", kMostGridSide, g->least,
                       g->most);
  if (const auto* w = std::get_if<WordKey>(&key.kind)) return fmt::format("{}", fmt::join(w->all, " | "));
  return "text";
}

tl::unexpected<Error> refuse(std::string_view origin, const toml::source_region& at, std::string what) {
  return fail(ErrorCode::InvalidInput, fmt::format("machine profile {}, line {}: {}", origin, at.begin.line, what));
}

/// Nothing where the node is no array of finite numbers within the range.
std::optional<std::vector<double>> numbers_of(const toml::node& node, double least, double most, std::size_t count) {
  const toml::array* array = node.as_array();
  if (!array || array->size() > count) return std::nullopt;
  std::vector<double> numbers;
  for (const toml::node& item : *array) {
    const auto value = item.value<double>();
    if (!item.is_number() || !value || !std::isfinite(*value) || *value < least || *value > most) return std::nullopt;
    numbers.push_back(*value);
  }
  return numbers;
}

std::optional<std::vector<double>> curve_of(const toml::node& node) {
  auto curve = numbers_of(node, 0, 1, kMostCurve);
  if (!curve || curve->empty()) return curve;
  const bool fits =
      curve->size() >= 2 && curve->front() == 0 && curve->back() == 1 && std::is_sorted(curve->begin(), curve->end());
  return fits ? std::move(curve) : std::nullopt;
}

std::optional<std::vector<std::vector<double>>> grid_of(const toml::node& node, const GridKey& key) {
  const toml::array* array = node.as_array();
  if (!array || array->size() > kMostGridSide) return std::nullopt;
  std::vector<std::vector<double>> rows;
  for (const toml::node& item : *array) {
    auto row = numbers_of(item, key.least, key.most, kMostGridSide);
    if (!row || row->empty() || (!rows.empty() && row->size() != rows.front().size())) return std::nullopt;
    rows.push_back(std::move(*row));
  }
  return rows;
}

Result<void> read_value(const Key& key, const toml::node& node, MachineProfile& profile, std::string_view origin) {
  const std::string label = fmt::format("{}.{}", key.section, key.name);
  const auto out_of_range = [&] {
    return refuse(origin, node.source(), fmt::format("{} must be {}", label, range_of(key)));
  };
  if (const auto* number = std::get_if<NumberKey>(&key.kind)) {
    const auto value = node.value<double>();
    if (!node.is_number() || !value || !std::isfinite(*value) || *value < number->least || *value > number->most)
      return out_of_range();
    number->field(profile) = *value;
  } else if (const auto* count = std::get_if<CountKey>(&key.kind)) {
    const auto value = node.value_exact<std::int64_t>();
    if (!value || *value < count->least || *value > count->most) return out_of_range();
    count->field(profile) = static_cast<std::uint32_t>(*value);
  } else if (const auto* curve = std::get_if<CurveKey>(&key.kind)) {
    auto values = curve_of(node);
    if (!values) return out_of_range();
    curve->field(profile) = std::move(*values);
  } else if (const auto* grid = std::get_if<GridKey>(&key.kind)) {
    auto rows = grid_of(node, *grid);
    if (!rows) return out_of_range();
    grid->field(profile) = std::move(*rows);
  } else {
    const auto value = node.value_exact<std::string>();
    if (!value || value->size() > 256) return out_of_range();
    if (const auto* word = std::get_if<WordKey>(&key.kind)) {
      if (!word->take(profile, *value)) return out_of_range();
    } else {
      std::get<TextKey>(key.kind).field(profile) = *value;
    }
  }
  return {};
}

/// The intervals of a calibration are whole, and hold the figures they are about.
Result<void> check_calibration(const MachineProfile::Resin& resin, std::string_view origin,
                               const toml::source_region& where) {
  const auto holds = [](double least, double value, double most) {
    return (least == 0 && most == 0) || (least > 0 && least <= value && value <= most);
  };
  if (!holds(resin.critical_dose_least_mj_per_cm2, resin.critical_dose_mj_per_cm2, resin.critical_dose_most_mj_per_cm2))
    return refuse(origin, where,
                  "resin.critical_dose_mj_per_cm2 must lie in its own interval, from critical_dose_least_mj_per_cm2 to "
                  "critical_dose_most_mj_per_cm2; leave both out where nobody measured");
  if (!holds(resin.penetration_least_mm, resin.penetration_mm, resin.penetration_most_mm))
    return refuse(
        origin, where,
        "resin.penetration_mm must lie in its own interval, from penetration_least_mm to penetration_most_mm; "
        "leave both out where nobody measured");
  return {};
}

bool is_name(std::string_view text) {
  return !text.empty() && text.size() <= 64 && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

Result<MachineProfile> read_table(const toml::table& root, std::string_view origin) {
  MachineProfile profile;
  std::set<std::string> seen;
  for (const auto& [section_key, section_node] : root) {
    const std::string_view section = section_key.str();
    if (section == "name" || section == "description") {
      const auto text = section_node.value_exact<std::string>();
      if (!text || text->size() > 256)
        return refuse(origin, section_node.source(), fmt::format("{} must be text", section));
      (section == "name" ? profile.name : profile.description) = *text;
      continue;
    }
    const bool known = std::any_of(keys().begin(), keys().end(), [&](const Key& k) { return k.section == section; });
    if (!known || !section_node.is_table())
      return refuse(origin, section_node.source(), fmt::format("unknown key \"{}\"", section));
    for (const auto& [name, node] : *section_node.as_table()) {
      const auto key = std::find_if(keys().begin(), keys().end(),
                                    [&, n = name.str()](const Key& k) { return k.section == section && k.name == n; });
      if (key == keys().end())
        return refuse(origin, node.source(), fmt::format("unknown key \"{}.{}\"", section, name.str()));
      if (auto ok = read_value(*key, node, profile, origin); !ok) return tl::unexpected{ok.error()};
      seen.insert(fmt::format("{}.{}", section, name.str()));
    }
  }
  if (!is_name(profile.name)) return refuse(origin, root.source(), "name must be 1 to 64 of a-z, 0-9 and -");
  for (const Key& key : keys())
    if (key.required && !seen.count(fmt::format("{}.{}", key.section, key.name)))
      return refuse(origin, root.source(),
                    fmt::format("{}.{} is missing ({}; {})", key.section, key.name, key.reason, range_of(key)));
  const auto* resin = root.get("resin");
  if (auto ok = check_calibration(profile.resin, origin, resin ? resin->source() : root.source()); !ok)
    return tl::unexpected{ok.error()};
  const PixelSize size = profile.mask_size();
  if (size.width_px > 65535 || size.height_px > 65535)
    return refuse(origin, root.source(), "more than 65535 pixels a side");
  return profile;
}

}  // namespace

double MachineProfile::pull_of_film_kpa() const {
  constexpr double kAssumedKpa = 20;
  return motion.pull_kpa > 0 ? motion.pull_kpa : kAssumedKpa;
}

double MachineProfile::carried_demand() const {
  constexpr double kKilo = 1000;
  constexpr double kAssumedMpa = 10;
  const double strength_mpa = resin.green_strength_mpa > 0 ? resin.green_strength_mpa : kAssumedMpa;
  return kKilo * strength_mpa * supports.fresh_share / (supports.safety * pull_of_film_kpa());
}

bool MachineProfile::states_calibration_band() const {
  return resin.critical_dose_least_mj_per_cm2 > 0 && resin.penetration_least_mm > 0;
}

bool MachineProfile::states_what_carries() const { return motion.pull_kpa > 0 && resin.green_strength_mpa > 0; }

PixelSize MachineProfile::mask_size() const {
  // 260 / 0.14 is 1857.14; a ratio that is whole but for rounding counts as whole.
  const auto pixels = [&](double side) {
    return static_cast<std::uint32_t>(std::max(1.0, std::floor(side / projection.pixel_pitch_mm + 1e-9)));
  };
  return {pixels(platform.width_mm), pixels(platform.depth_mm)};
}

Result<MachineProfile> machine_profile_from_toml(std::string_view text, std::string_view origin) {
  try {
    return read_table(toml::parse(text, origin), origin);
  } catch (const toml::parse_error& error) {
    return refuse(origin, error.source(), std::string{error.description()});
  }
}

std::string to_toml(const MachineProfile& profile) {
  MachineProfile copy = profile;
  const auto quoted = [](const std::string& text) {
    std::string out = "\"";
    for (const char c : text) {
      if (c == '"' || c == '\\') out += '\\';
      if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
        out += fmt::format("\\u{:04x}", static_cast<unsigned char>(c));
      else
        out += c;
    }
    return out + '"';
  };
  const auto number = [](double value) {
    std::string out = fmt::format("{}", value);
    return out.find_first_of(".e") == std::string::npos ? out + ".0" : out;
  };
  const auto list = [&](const std::vector<double>& values) {
    std::vector<std::string> items;
    for (const double value : values) items.push_back(number(value));
    return fmt::format("[{}]", fmt::join(items, ", "));
  };
  std::string text = fmt::format("name = {}\ndescription = {}\n", quoted(copy.name), quoted(copy.description));
  std::string_view section;
  for (const Key& key : keys()) {
    if (key.section != section) text += fmt::format("\n[{}]\n", section = key.section);
    if (const auto* n = std::get_if<NumberKey>(&key.kind))
      text += fmt::format("{} = {}\n", key.name, number(n->field(copy)));
    if (const auto* c = std::get_if<CountKey>(&key.kind)) text += fmt::format("{} = {}\n", key.name, c->field(copy));
    if (const auto* t = std::get_if<TextKey>(&key.kind))
      text += fmt::format("{} = {}\n", key.name, quoted(t->field(copy)));
    if (const auto* w = std::get_if<WordKey>(&key.kind))
      text += fmt::format("{} = {}\n", key.name, quoted(std::string{w->name(copy)}));
    if (const auto* c = std::get_if<CurveKey>(&key.kind))
      text += fmt::format("{} = {}\n", key.name, list(c->field(copy)));
    if (const auto* g = std::get_if<GridKey>(&key.kind)) {
      std::vector<std::string> rows;
      for (const auto& row : g->field(copy)) rows.push_back("  " + list(row));
      text += fmt::format("{} = [{}]\n", key.name, rows.empty() ? "" : fmt::format("\n{},\n", fmt::join(rows, ",\n")));
    }
  }
  return text;
}

Digest digest_of_profile(MachineProfile profile) {
  profile.devices = {};
  Hasher hasher;
  hasher.feed(to_toml(profile));
  return hasher.digest();
}

std::string describe_keys() {
  std::string text;
  for (const Key& key : keys())
    text += fmt::format("{}.{}{}: {} ({})\n", key.section, key.name, key.required ? " (required)" : "", key.reason,
                        range_of(key));
  return text;
}

Result<std::vector<MachineProfile>> load_machine_profiles(const std::string& folder) {
  std::error_code error;
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator{folder, error})
    if (entry.path().extension() == ".toml") paths.push_back(entry.path());
  if (error)
    return fail(ErrorCode::NotFound, fmt::format("cannot list machine profiles in {}: {}", folder, error.message()));
  std::sort(paths.begin(), paths.end());
  std::vector<MachineProfile> machines;
  for (const auto& path : paths) {
    auto bytes = read_file(path, 1U << 20U);
    if (!bytes) return tl::unexpected{bytes.error()};
    auto profile =
        machine_profile_from_toml({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, path.string());
    if (!profile) return tl::unexpected{profile.error()};
    if (std::any_of(machines.begin(), machines.end(), [&](const auto& m) { return m.name == profile->name; }))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("machine profile {}: a second machine is named {}", path.string(), profile->name));
    machines.push_back(std::move(*profile));
  }
  if (machines.empty()) return fail(ErrorCode::NotFound, fmt::format("no machine profile (*.toml) in {}", folder));
  return machines;
}

bool holds_machine_profiles(const std::filesystem::path& folder) {
  std::error_code error;
  const bool is_reached = std::filesystem::exists(folder, error);
  if (is_reached)
    for (const auto& entry : std::filesystem::directory_iterator{folder, error})
      if (entry.path().extension() == ".toml") return true;
  // What lies in a home that is another user's is nothing of ours: a service may have kept HOME of who started it.
  if (!is_reached && error == std::errc::permission_denied) return false;
  return error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory;
}

Result<std::vector<MachineProfile>> builtin_machine_profiles() {
  std::vector<MachineProfile> machines;
  for (const auto& [name, text] : builtin_profile_texts()) {
    auto profile = machine_profile_from_toml(text, fmt::format("built-in {}", name));
    if (!profile) return tl::unexpected{profile.error()};
    machines.push_back(std::move(*profile));
  }
  return machines;
}

Result<MachineProfile> find_machine(const std::vector<MachineProfile>& machines, std::string_view name) {
  const auto found = std::find_if(machines.begin(), machines.end(), [&](const auto& m) { return m.name == name; });
  if (found != machines.end()) return *found;
  std::vector<std::string_view> names;
  for (const auto& machine : machines) names.push_back(machine.name);
  return fail(ErrorCode::InvalidInput, fmt::format("no machine named {}; there are: {}", name, fmt::join(names, ", ")));
}

}  // namespace telefab
