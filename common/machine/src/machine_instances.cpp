// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <telefab/machine/machine_instances.hpp>

#include "profile_values.hpp"

namespace telefab {
namespace {

constexpr std::string_view kTable = "machine";
/// What differs between machines of one profile: what they are connected to.
constexpr std::array<std::string_view, 3> kSections{"devices", "screen", "light"};

/// A text of a [[machine]], and where it stands in a machine's file that inherits from the profile.
struct Text {
  std::string_view key;
  std::string ProfilePart::*field;
  std::string_view heading;
  bool is_name;
  bool is_required;
};
constexpr std::array kTexts{
    Text{"name", &ProfilePart::name, "name", true, true},
    Text{"profile", &ProfilePart::inherits, "inherits", true, true},
    Text{"resin", &ProfilePart::loaded_resin, "loaded_resin", true, false},
    Text{"print", &ProfilePart::default_print, "default_print", true, false},
    Text{"description", &ProfilePart::description, "description", false, false},
};

int line_of(const ProfilePart& part, std::string_view heading) {
  const auto line = part.headings.find(std::string{heading});
  return line == part.headings.end() ? part.headings.at("name") : line->second;
}

tl::unexpected<Error> refuse_instance(const MachineInstance& instance, std::string_view heading, std::string what) {
  return fail(ErrorCode::InvalidInput, fmt::format("{}, line {}: machine {} {}", instance.part.origin,
                                                   line_of(instance.part, heading), instance.name, what));
}

class InstanceReader {
 public:
  explicit InstanceReader(std::string_view file) {
    part_.kind = ProfileKind::Machine;
    part_.is_instance = true;
    part_.file = file;
    part_.origin = fmt::format("list of machines {}", file);
  }

  Result<MachineInstance> read(const toml::table& table) && {
    for (const auto& [key, node] : table)
      if (auto read = read_entry(key.str(), node); !read) return tl::unexpected{read.error()};
    for (const Text& text : kTexts)
      if (text.is_required && (part_.*text.field).empty())
        return refuse(part_.origin, table.source(), fmt::format("a [[machine]] needs {}", text.key));
    return MachineInstance{part_.name, part_.inherits, std::move(part_), true};
  }

 private:
  Result<void> read_entry(std::string_view key, const toml::node& node) {
    if (std::ranges::find(kSections, key) != kSections.end() && node.is_table())
      return read_section(key, *node.as_table());
    const auto text = std::ranges::find(kTexts, key, &Text::key);
    if (text == kTexts.end())
      return refuse(part_.origin, node.source(),
                    fmt::format("unknown key \"{}\"; a [[machine]] has name, profile, resin, print, description and "
                                "[machine.devices], [machine.screen] and [machine.light]; the rest is its profile's",
                                key));
    auto value = read_text(key, node, part_.origin);
    if (!value) return tl::unexpected{value.error()};
    if (text->is_name && !is_profile_name(*value))
      return refuse(part_.origin, node.source(), fmt::format("{} must be 1 to 64 of a-z, 0-9 and -", key));
    part_.*text->field = std::move(*value);
    part_.headings[std::string{text->heading}] = static_cast<int>(node.source().begin.line);
    return {};
  }

  Result<void> read_section(std::string_view section, const toml::table& table) {
    for (const auto& [name, node] : table) {
      const Key* key = find_key(section, name.str());
      if (!key)
        return refuse(part_.origin, node.source(), fmt::format("unknown key \"machine.{}.{}\"", section, name.str()));
      if (auto read = read_value(*key, node, part_.values, part_.origin); !read) return read;
      part_.lines[label_of(*key)] = static_cast<int>(node.source().begin.line);
    }
    return {};
  }

  ProfilePart part_;
};

Result<std::vector<MachineInstance>> read_list(const toml::table& root, std::string_view file) {
  const std::string origin = fmt::format("list of machines {}", file);
  for (const auto& [key, node] : root)
    if (key.str() != kTable || !node.is_array_of_tables())
      return refuse(origin, node.source(), fmt::format("\"{}\" is not a [[machine]] table", key.str()));
  const toml::array* tables = root[kTable].as_array();
  if (!tables || tables->empty())
    return fail(ErrorCode::InvalidInput, fmt::format("{} has no [[machine]]: name at least one", origin));
  if (tables->size() > kMaxInstances)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} has {} machines; a fab may have {}", origin, tables->size(), kMaxInstances));
  std::vector<MachineInstance> instances;
  for (const toml::node& node : *tables) {
    auto instance = InstanceReader{file}.read(*node.as_table());
    if (!instance) return tl::unexpected{instance.error()};
    if (std::ranges::find(instances, instance->name, &MachineInstance::name) != instances.end())
      return refuse(origin, node.source(), fmt::format("a second machine is named {}", instance->name));
    instances.push_back(std::move(*instance));
  }
  return instances;
}

bool states_anything(const ProfilePart& part) {
  return !part.loaded_resin.empty() || !part.default_print.empty() || !part.description.empty() || !part.lines.empty();
}

/// What decides with the plan's exposures how much light there is.
bool is_same_light(const MachineProfile& a, const MachineProfile& b) {
  return a.devices.led_current == b.devices.led_current && a.devices.led_colour == b.devices.led_colour &&
         a.devices.light == b.devices.light && a.light.power == b.light.power && a.light.steps == b.light.steps &&
         a.exposure_step_s() == b.exposure_step_s() && a.screen.rotation == b.screen.rotation &&
         a.screen.packing == b.screen.packing;
}

}  // namespace

Result<std::vector<MachineInstance>> machine_instances_from_toml(std::string_view text, std::string_view file) {
  try {
    return read_list(toml::parse(text, file), file);
  } catch (const toml::parse_error& error) {
    return refuse(fmt::format("list of machines {}", file), error.source(), error.description());
  }
}

std::vector<MachineInstance> one_of_each(const ProfileCatalogue& catalogue) {
  std::vector<MachineInstance> instances;
  for (const ProfilePart* part : catalogue.offered(ProfileKind::Machine))
    instances.push_back({part->name, part->name, *part, false});
  return instances;
}

Result<ProfileCatalogue> with_instances(const ProfileCatalogue& catalogue,
                                        const std::vector<MachineInstance>& instances) {
  const auto offered = catalogue.offered(ProfileKind::Machine);
  std::map<std::string_view, int> of_profile;
  for (const MachineInstance& instance : instances) {
    if (std::ranges::find(offered, instance.profile, &ProfilePart::name) == offered.end()) {
      std::vector<std::string_view> names;
      for (const ProfilePart* part : offered) names.push_back(part->name);
      return refuse_instance(instance, "inherits",
                             fmt::format("is of the profile {}, which is not known; there are: {}", instance.profile,
                                         fmt::join(names, ", ")));
    }
    ++of_profile[instance.profile];
  }
  std::vector<ProfilePart> parts{catalogue.parts().begin(), catalogue.parts().end()};
  for (const MachineInstance& instance : instances) {
    const auto same = std::ranges::find_if(
        parts, [&](const auto& p) { return p.kind == ProfileKind::Machine && p.name == instance.name; });
    if (same == parts.end()) continue;
    if (instance.name != instance.profile)
      return refuse_instance(instance, "name",
                             fmt::format("is of {}, and its name is that of another profile ({}): give it a name of "
                                         "its own",
                                         instance.profile, same->file));
    if (of_profile[instance.profile] > 1)
      return refuse_instance(instance, "name",
                             "is not the only one of its profile, and that name asks for any of them: give it a name "
                             "of its own");
    if (instance.is_stated && states_anything(instance.part))
      return refuse_instance(instance, "name",
                             fmt::format("is named as its profile, which states resin, print and devices: state them "
                                         "in {}, or give it a name of its own",
                                         same->file));
  }
  for (ProfilePart& part : parts)
    if (part.kind == ProfileKind::Machine && !of_profile.contains(part.name)) part.is_base = true;
  for (const MachineInstance& instance : instances) {
    if (instance.name == instance.profile) continue;
    parts.push_back(instance.part);
    if (instance.part.description.empty())
      parts.back().description = (*std::ranges::find(offered, instance.profile, &ProfilePart::name))->description;
  }
  return ProfileCatalogue::from(std::move(parts));
}

Result<InstanceFit> fit_of(const ProfileCatalogue& catalogue, const MachineInstance& instance,
                           const ProfileChoice& choice) {
  if (choice.machine != instance.name && choice.machine != instance.profile) return InstanceFit::OtherMachine;
  const auto asked = catalogue.compose(choice);
  if (!asked) return tl::unexpected{asked.error()};
  if (choice.machine == instance.name) return InstanceFit::Fits;
  const auto own = catalogue.compose({instance.name});
  if (!own) return tl::unexpected{own.error()};
  if (!own->resin.empty() && own->resin != asked->resin) return InstanceFit::OtherResin;
  if (!is_same_light(own->profile, asked->profile)) return InstanceFit::OtherLight;
  return InstanceFit::Fits;
}

}  // namespace telefab
