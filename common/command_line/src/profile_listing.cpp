// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/profile_listing.hpp>
#include <utility>

namespace telefab {
namespace {

using Json = nlohmann::ordered_json;

Result<ComposedProfile> compose(const ProfileCatalogue& catalogue, ProfileKind kind, const ProfileListing& listing,
                                const std::string& name) {
  switch (kind) {
    case ProfileKind::Machine:
      return catalogue.compose({name, listing.resin, listing.print});
    case ProfileKind::Resin:
      return catalogue.resin(name);
    case ProfileKind::Print:
      return catalogue.print(name);
  }
  return fail(ErrorCode::Internal, "a kind of profile that there is not");
}

const ComposedValue& value_of(const ComposedProfile& composed, std::string_view key) {
  return *std::ranges::find(composed.values, key, &ComposedValue::key);
}

/// "Ec 3.0 mJ/cm2 (assumed)"; "Ec not stated".
std::string figure(const ComposedProfile& composed, std::string_view title, std::string_view key,
                   std::string_view unit) {
  const ComposedValue& value = value_of(composed, key);
  if (value.origin == ValueOrigin::Default) return fmt::format("{} not stated", title);
  return fmt::format("{} {} {}{}", title, value.value, unit, value.is_assumed ? " (assumed)" : "");
}

/// "45 EUR a litre".
std::string price_text(const ResinPrice& price) {
  return fmt::format("{} {} a litre", price.per_litre, price.currency);
}

std::string line_of(const ComposedProfile& composed, const ProfilePart& part) {
  constexpr std::string_view kLine = "{:<28} {}: {}\n";
  const MachineProfile& p = composed.profile;
  switch (part.kind) {
    case ProfileKind::Machine:
      return fmt::format(kLine, part.name,
                         fmt::format("{} x {} px, layer {} mm", p.mask_size().width_px, p.mask_size().height_px,
                                     p.layers.thickness_mm),
                         part.description);
    case ProfileKind::Resin:
      return fmt::format(kLine, part.name,
                         fmt::format("{}, {}, {}{}", figure(composed, "Ec", "resin.critical_dose_mj_per_cm2", "mJ/cm2"),
                                     figure(composed, "Dp", "resin.penetration_mm", "mm"),
                                     figure(composed, "green", "resin.green_strength_mpa", "MPa"),
                                     composed.price ? ", " + price_text(*composed.price) : ""),
                         part.description);
    case ProfileKind::Print:
      return fmt::format(kLine, part.name, figure(composed, "layer", "layers.thickness_mm", "mm"), part.description);
  }
  return {};
}

/// "printing   j19a-1, layer 12 of 300, 14 min 20 s left, 2 wait: statue.ply"
std::string text_of(const MachineStatus& machine) {
  std::vector<std::string> parts;
  if (!machine.job.empty()) parts.push_back(machine.job);
  if (machine.layers > 0) parts.push_back(fmt::format("layer {} of {}", machine.layer, machine.layers));
  if (machine.seconds_left >= 0) parts.push_back(duration_text(machine.seconds_left) + " left");
  if (machine.waiting > 0) parts.push_back(fmt::format("{} wait", machine.waiting));
  parts.push_back(fmt::format("resin {}", machine.resin));
  std::string text = fmt::format("{:<9} {}", name_of(machine.state), fmt::join(parts, ", "));
  if (!machine.job_name.empty()) text += ": " + machine.job_name;
  if (!machine.message.empty()) text += fmt::format(" ({})", machine.message);
  return text;
}

/// A machine that stands in a fab, or a profile that stands for several of them.
std::string line_of(const ComposedProfile& composed, const ProfilePart& part, std::span<const MachineStatus> standing) {
  const auto found = std::ranges::find(standing, part.name, &MachineStatus::name);
  if (found != standing.end() && (found->state != MachineState::Idle || found->waiting > 0))
    return fmt::format("{:<28} {}\n", part.name, text_of(*found));
  std::vector<std::string_view> names;
  for (const MachineStatus& each : standing)
    if (each.profile == part.name && each.name != part.name) names.push_back(each.name);
  if (found == standing.end() && !names.empty())
    return fmt::format("{:<28} any of  {}\n", part.name, fmt::join(names, ", "));
  const std::string line = line_of(composed, part);
  if (found == standing.end()) return line;
  return fmt::format("{:<28} {:<9} resin {}, {}", part.name, name_of(found->state), found->resin,
                     line.substr(std::min<std::size_t>(line.size(), 29)));
}

Json price_json(const ResinPrice& price) { return {{"per_litre", price.per_litre}, {"currency", price.currency}}; }

/// A TOML value as JSON; what JSON does not read, a table of several lines, stays a text.
Json json_of(const std::string& value) {
  Json read = json_or_discarded(value);
  return read.is_discarded() ? Json(value) : read;
}

Json json_of(const ComposedProfile& composed, const ProfilePart& part, std::string_view origin) {
  const MachineProfile& p = composed.profile;
  Json object{{"name", part.name}, {"description", part.description}, {"source", part.source}};
  if (part.kind == ProfileKind::Machine)
    object.update({{"width_px", p.mask_size().width_px},
                   {"height_px", p.mask_size().height_px},
                   {"width_mm", p.platform.width_mm},
                   {"depth_mm", p.platform.depth_mm},
                   {"z_travel_mm", p.platform.z_travel_mm},
                   {"pixel_pitch_mm", p.projection.pixel_pitch_mm},
                   {"layer_mm", p.layers.thickness_mm},
                   {"exposure_s", p.layers.exposure_s},
                   {"resin", composed.resin}});
  if (part.kind != ProfileKind::Machine)
    for (const ComposedValue& value : composed.values)
      if (value.origin != ValueOrigin::Default) object[value.key] = json_of(value.value);
  if (composed.price) object["price"] = price_json(*composed.price);
  object["assumed"] = p.assumed;
  object["origin"] = origin;
  return object;
}

void add_standing(Json& object, std::string_view name, std::span<const MachineStatus> standing) {
  Json names = Json::array();
  for (const MachineStatus& each : standing) {
    if (each.profile == name && each.name != name) names.push_back(each.name);
    if (each.name == name) object["status"] = json_of(to_json(each));
  }
  if (!names.empty()) object["machines"] = std::move(names);
}

std::string words_of(const ComposedValue& value) {
  const std::string_view assumed = value.is_assumed ? ", assumed" : "";
  switch (value.origin) {
    case ValueOrigin::Stated:
      return fmt::format("stated in {}{}", value.file, assumed);
    case ValueOrigin::Inherited:
      return fmt::format("inherited from {}{}", value.file, assumed);
    case ValueOrigin::Derived:
      return value.is_assumed ? "derived from what is assumed" : "derived";
    case ValueOrigin::Default:
      return "assumed default";
  }
  return {};
}

std::string table_of(const ComposedProfile& composed) {
  std::size_t widest = 0;
  for (const ComposedValue& value : composed.values)
    if (value.value.find('\n') == std::string::npos)
      widest = std::max(widest, std::min<std::size_t>(value.value.size(), 24));
  std::string table;
  for (const ComposedValue& value : composed.values) {
    table += fmt::format("{:<38} {:<{}} {}\n", value.key, value.value, widest, words_of(value));
  }
  if (composed.price) table += fmt::format("{:<38} {}\n", "price of the resin", price_text(*composed.price));
  return table;
}

Json values_json(const ComposedProfile& composed) {
  Json values = Json::object();
  for (const ComposedValue& value : composed.values)
    values[value.key] = {{"value", json_of(value.value)},
                         {"origin", name_of(value.origin)},
                         {"file", value.file},
                         {"assumed", value.is_assumed}};
  if (composed.price) values["price"] = price_json(*composed.price);
  return values;
}

}  // namespace

void declare_profile_listing(VerbOptions& options, ProfileKind kind, ProfileListing& listing) {
  options.flag("--names", listing.names, "names alone, one a line");
  options.add("--show", listing.show, "one of them: every value, which file states it, and what is assumed");
  if (kind != ProfileKind::Machine) return;
  options.add("--resin", listing.resin, "with --show: together with this resin").names("RESIN");
  options.add("--print", listing.print, "with --show: together with this way to print").names("PRINT");
}

Result<std::string> text_of(const ProfileListing& listing, ProfileKind kind, const ProfileCatalogue& catalogue,
                            std::string_view origin, bool is_json, std::span<const MachineStatus> standing) {
  if (listing.show.empty() && !(listing.resin.empty() && listing.print.empty()))
    return fail(ErrorCode::InvalidInput, "--resin and --print go with --show NAME");
  if (!listing.show.empty()) {
    const auto composed = compose(catalogue, kind, listing, listing.show);
    if (!composed) return tl::unexpected{composed.error()};
    return is_json ? json_text(values_json(*composed), 2) + "\n" : table_of(*composed);
  }
  std::string lines;
  Json list = Json::array();
  for (const ProfilePart* part : catalogue.offered(kind)) {
    if (listing.names) {
      lines += part->name + "\n";
      continue;
    }
    const auto composed = compose(catalogue, kind, listing, part->name);
    if (!composed) return tl::unexpected{composed.error()};
    if (is_json) {
      list.push_back(json_of(*composed, *part, origin));
      add_standing(list.back(), part->name, standing);
    } else {
      lines += standing.empty() ? line_of(*composed, *part) : line_of(*composed, *part, standing);
    }
  }
  return is_json && !listing.names ? json_text(list, 2) + "\n" : lines;
}

}  // namespace telefab
