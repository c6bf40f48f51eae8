// SPDX-License-Identifier: GPL-3.0-or-later
#include "profile_values.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "motion_misfit.hpp"

namespace telefab {
namespace {

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

std::string number_text(double value) {
  std::string out = fmt::format("{}", value);
  return out.find_first_of(".e") == std::string::npos ? out + ".0" : out;
}

std::string numbers_text(const std::vector<double>& values) {
  std::vector<std::string> items;
  for (const double value : values) items.push_back(number_text(value));
  return fmt::format("[{}]", fmt::join(items, ", "));
}

}  // namespace

tl::unexpected<Error> refuse(std::string_view origin, const toml::source_region& at, std::string_view what) {
  return fail(ErrorCode::InvalidInput, fmt::format("{}, line {}: {}", origin, at.begin.line, what));
}

Result<void> read_value(const Key& key, const toml::node& node, MachineProfile& profile, std::string_view origin) {
  const std::string label = label_of(key);
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

Result<std::string> read_text(std::string_view key, const toml::node& node, std::string_view origin) {
  constexpr std::size_t kMost = 256;
  auto text = node.value_exact<std::string>();
  if (!text || text->size() > kMost) return refuse(origin, node.source(), fmt::format("{} must be text", key));
  return *std::move(text);
}

Result<std::vector<std::string>> read_keys(std::string_view name, const toml::node& node, std::string_view origin) {
  const toml::array* array = node.as_array();
  if (!array) return refuse(origin, node.source(), fmt::format("{} must be a list of keys", name));
  std::vector<std::string> keys;
  for (const toml::node& item : *array) {
    const std::string label = item.value_or(std::string{});
    const auto dot = label.find('.');
    if (dot == std::string::npos || !find_key(label.substr(0, dot), label.substr(dot + 1)))
      return refuse(origin, item.source(), fmt::format("{} names \"{}\", which is not a key", name, label));
    keys.push_back(label);
  }
  return keys;
}

std::string quoted_text(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      out += fmt::format("\\u{:04x}", static_cast<unsigned char>(c));
    else
      out += c;
  }
  return out + '"';
}

std::string list_text(const std::vector<std::string>& items) {
  std::vector<std::string> quoted;
  for (const std::string& item : items) quoted.push_back(quoted_text(item));
  return fmt::format("[{}]", fmt::join(quoted, ", "));
}

std::string value_text(const Key& key, const MachineProfile& of) {
  MachineProfile profile = of;  // the fields of the table are there to be written to
  if (const auto* n = std::get_if<NumberKey>(&key.kind)) return number_text(n->field(profile));
  if (const auto* c = std::get_if<CountKey>(&key.kind)) return fmt::format("{}", c->field(profile));
  if (const auto* w = std::get_if<WordKey>(&key.kind)) return quoted_text(std::string{w->name(profile)});
  if (const auto* c = std::get_if<CurveKey>(&key.kind)) return numbers_text(c->field(profile));
  if (const auto* g = std::get_if<GridKey>(&key.kind)) {
    std::vector<std::string> rows;
    for (const auto& row : g->field(profile)) rows.push_back("  " + numbers_text(row));
    return rows.empty() ? "[]" : fmt::format("[\n{},\n]", fmt::join(rows, ",\n"));
  }
  return quoted_text(std::get<TextKey>(key.kind).field(profile));
}

void copy_value(const Key& key, const MachineProfile& from, MachineProfile& to) {
  MachineProfile source = from;
  std::visit(
      [&](const auto& kind) {
        if constexpr (requires { kind.field(source); })
          kind.field(to) = kind.field(source);
        else
          kind.take(to, kind.name(from));
      },
      key.kind);
}

std::string label_of(const Key& key) { return fmt::format("{}.{}", key.section, key.name); }

const Key* find_key(std::string_view section, std::string_view name) {
  const auto& keys = profile_keys();
  const auto key =
      std::find_if(keys.begin(), keys.end(), [&](const Key& k) { return k.section == section && k.name == name; });
  return key == keys.end() ? nullptr : &*key;
}

bool is_section(std::string_view section) {
  const auto& keys = profile_keys();
  return std::any_of(keys.begin(), keys.end(), [&](const Key& k) { return k.section == section; });
}

bool is_profile_name(std::string_view text) {
  constexpr std::size_t kMost = 64;
  return !text.empty() && text.size() <= kMost && std::all_of(text.begin(), text.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
  });
}

std::optional<Misfit> misfit_of(const MachineProfile& profile) {
  const auto holds = [](double least, double value, double most) {
    return (least == 0 && most == 0) || (least > 0 && least <= value && value <= most);
  };
  const auto& resin = profile.resin;
  if (!holds(resin.critical_dose_least_mj_per_cm2, resin.critical_dose_mj_per_cm2, resin.critical_dose_most_mj_per_cm2))
    return Misfit{"resin",
                  "resin.critical_dose_mj_per_cm2 must lie in its own interval, from critical_dose_least_mj_per_cm2 to "
                  "critical_dose_most_mj_per_cm2; leave both out where nobody measured"};
  if (!holds(resin.penetration_least_mm, resin.penetration_mm, resin.penetration_most_mm))
    return Misfit{"resin",
                  "resin.penetration_mm must lie in its own interval, from penetration_least_mm to "
                  "penetration_most_mm; leave both out where nobody measured"};
  if (resin.temperature_most_celsius > 0 && resin.temperature_least_celsius > resin.temperature_most_celsius)
    return Misfit{"resin", fmt::format("resin.temperature_least_celsius {} is above temperature_most_celsius {}",
                                       resin.temperature_least_celsius, resin.temperature_most_celsius)};
  const double thickness = profile.layers.thickness_mm;
  if (thickness < profile.platform.least_layer_mm ||
      (profile.platform.most_layer_mm > 0 && thickness > profile.platform.most_layer_mm))
    return Misfit{"layers", fmt::format("layers.thickness_mm {} is beyond what {} prints, {} to {} mm", thickness,
                                        profile.name, profile.platform.least_layer_mm, profile.platform.most_layer_mm)};
  if (auto what = misfit_of(profile.motion)) return Misfit{"motion", std::move(*what)};
  if (const double most = profile.motion.most_speed_mm_per_s; most > 0)
    for (const auto& [is_bottom, is_large] : {std::pair{false, false}, {false, true}, {true, false}}) {
      const MachineProfile::Stroke s = profile.motion.stroke_of(is_bottom, is_large);
      for (const auto& [name, speed] : {std::pair{"lift_speed_mm_per_s", s.lift_speed_mm_per_s},
                                        {"lower_speed_mm_per_s", s.lower_speed_mm_per_s},
                                        {"peel_speed_mm_per_s", s.peel_speed_mm_per_s},
                                        {"approach_speed_mm_per_s", s.approach_speed_mm_per_s}})
        if (speed > most)
          return Misfit{"motion", fmt::format("motion.{}{} {} is above what {} moves at, {}",
                                              is_bottom  ? "bottom_"
                                              : is_large ? "large_"
                                                         : "",
                                              name, speed, profile.name, most)};
    }
  if (profile.devices.printer == PrinterKind::Sdcp && profile.file.kind != PrinterFile::Goo)
    return Misfit{"file", "devices.printer \"sdcp\" takes GOO files: state file.kind = \"goo\""};
  constexpr std::uint32_t kMostPixels = 65535;
  const PixelSize size = profile.mask_size();
  if (size.width_px > kMostPixels || size.height_px > kMostPixels)
    return Misfit{{}, fmt::format("more than {} pixels a side", kMostPixels)};
  const auto& stated = profile.projection;
  if ((stated.width_px != 0 && stated.width_px != size.width_px) ||
      (stated.height_px != 0 && stated.height_px != size.height_px))
    return Misfit{"projection", fmt::format("projection states {} x {} pixels, but platform and pitch give {} x {}",
                                            stated.width_px, stated.height_px, size.width_px, size.height_px)};
  return std::nullopt;
}

}  // namespace telefab
