// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <telefab/machine/machine_profile.hpp>

#include "motion_misfit.hpp"
#include "profile_keys.hpp"

namespace telefab {
namespace {

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
    const bool known =
        std::any_of(profile_keys().begin(), profile_keys().end(), [&](const Key& k) { return k.section == section; });
    if (!known || !section_node.is_table())
      return refuse(origin, section_node.source(), fmt::format("unknown key \"{}\"", section));
    for (const auto& [name, node] : *section_node.as_table()) {
      const auto key = std::find_if(profile_keys().begin(), profile_keys().end(),
                                    [&, n = name.str()](const Key& k) { return k.section == section && k.name == n; });
      if (key == profile_keys().end())
        return refuse(origin, node.source(), fmt::format("unknown key \"{}.{}\"", section, name.str()));
      if (auto ok = read_value(*key, node, profile, origin); !ok) return tl::unexpected{ok.error()};
      seen.insert(fmt::format("{}.{}", section, name.str()));
    }
  }
  if (!is_name(profile.name)) return refuse(origin, root.source(), "name must be 1 to 64 of a-z, 0-9 and -");
  for (const Key& key : profile_keys())
    if (key.required && !seen.count(fmt::format("{}.{}", key.section, key.name)))
      return refuse(origin, root.source(),
                    fmt::format("{}.{} is missing ({}; {})", key.section, key.name, key.reason, range_of(key)));
  const auto* resin = root.get("resin");
  if (auto ok = check_calibration(profile.resin, origin, resin ? resin->source() : root.source()); !ok)
    return tl::unexpected{ok.error()};
  if (const auto misfit = misfit_of(profile.motion)) {
    const auto* motion = root.get("motion");
    return refuse(origin, motion ? motion->source() : root.source(), *misfit);
  }
  const PixelSize size = profile.mask_size();
  if (size.width_px > 65535 || size.height_px > 65535)
    return refuse(origin, root.source(), "more than 65535 pixels a side");
  return profile;
}

std::string quoted_text(const std::string& text) {
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

std::string number_text(double value) {
  std::string out = fmt::format("{}", value);
  return out.find_first_of(".e") == std::string::npos ? out + ".0" : out;
}

std::string list_text(const std::vector<double>& values) {
  std::vector<std::string> items;
  for (const double value : values) items.push_back(number_text(value));
  return fmt::format("[{}]", fmt::join(items, ", "));
}

/// A key's value as TOML writes it. `profile` is not changed.
std::string value_text(const Key& key, MachineProfile& profile) {
  if (const auto* n = std::get_if<NumberKey>(&key.kind)) return number_text(n->field(profile));
  if (const auto* c = std::get_if<CountKey>(&key.kind)) return fmt::format("{}", c->field(profile));
  if (const auto* w = std::get_if<WordKey>(&key.kind)) return quoted_text(std::string{w->name(profile)});
  if (const auto* c = std::get_if<CurveKey>(&key.kind)) return list_text(c->field(profile));
  if (const auto* g = std::get_if<GridKey>(&key.kind)) {
    std::vector<std::string> rows;
    for (const auto& row : g->field(profile)) rows.push_back("  " + list_text(row));
    return rows.empty() ? "[]" : fmt::format("[\n{},\n]", fmt::join(rows, ",\n"));
  }
  return quoted_text(std::get<TextKey>(key.kind).field(profile));
}

}  // namespace

Result<MachineProfile> machine_profile_from_toml(std::string_view text, std::string_view origin) {
  try {
    return read_table(toml::parse(text, origin), origin);
  } catch (const toml::parse_error& error) {
    return refuse(origin, error.source(), std::string{error.description()});
  }
}

std::string to_toml(const MachineProfile& profile) {
  MachineProfile copy = profile;
  MachineProfile untouched;
  std::string text =
      fmt::format("name = {}\ndescription = {}\n", quoted_text(copy.name), quoted_text(copy.description));
  std::string_view section;
  for (const Key& key : profile_keys()) {
    if (key.section != section) text += fmt::format("\n[{}]\n", section = key.section);
    const std::string value = value_text(key, copy);
    if (key.written == Written::Always || value != value_text(key, untouched))
      text += fmt::format("{} = {}\n", key.name, value);
  }
  return text;
}

}  // namespace telefab
