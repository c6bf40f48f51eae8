// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/profile_listing.hpp>

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
                         fmt::format("{}, {}, {}", figure(composed, "Ec", "resin.critical_dose_mj_per_cm2", "mJ/cm2"),
                                     figure(composed, "Dp", "resin.penetration_mm", "mm"),
                                     figure(composed, "green", "resin.green_strength_mpa", "MPa")),
                         part.description);
    case ProfileKind::Print:
      return fmt::format(kLine, part.name, figure(composed, "layer", "layers.thickness_mm", "mm"), part.description);
  }
  return {};
}

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
  object["assumed"] = p.assumed;
  object["origin"] = origin;
  return object;
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
  return table;
}

Json values_json(const ComposedProfile& composed) {
  Json values = Json::object();
  for (const ComposedValue& value : composed.values)
    values[value.key] = {{"value", json_of(value.value)},
                         {"origin", name_of(value.origin)},
                         {"file", value.file},
                         {"assumed", value.is_assumed}};
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
                            std::string_view origin, bool is_json) {
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
    if (is_json)
      list.push_back(json_of(*composed, *part, origin));
    else
      lines += line_of(*composed, *part);
  }
  return is_json && !listing.names ? json_text(list, 2) + "\n" : lines;
}

}  // namespace telefab
