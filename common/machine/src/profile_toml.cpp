// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <set>
#include <telefab/machine/machine_profile.hpp>

#include "profile_values.hpp"

namespace telefab {
namespace {

Result<void> read_heading(std::string_view key, const toml::node& node, MachineProfile& profile,
                          std::string_view origin) {
  if (key == "assumed") {
    auto keys = read_keys(key, node, origin);
    if (!keys) return tl::unexpected{keys.error()};
    profile.assumed = std::move(*keys);
    return {};
  }
  auto text = read_text(key, node, origin);
  if (!text) return tl::unexpected{text.error()};
  (key == "name" ? profile.name : profile.description) = std::move(*text);
  return {};
}

Result<MachineProfile> read_table(const toml::table& root, std::string_view origin) {
  MachineProfile profile;
  std::set<std::string> seen;
  for (const auto& [section_key, section_node] : root) {
    const std::string_view section = section_key.str();
    if (section == "name" || section == "description" || section == "assumed") {
      if (auto read = read_heading(section, section_node, profile, origin); !read) return tl::unexpected{read.error()};
      continue;
    }
    if (!is_section(section) || !section_node.is_table())
      return refuse(origin, section_node.source(), fmt::format("unknown key \"{}\"", section));
    for (const auto& [name, node] : *section_node.as_table()) {
      const Key* key = find_key(section, name.str());
      if (!key) return refuse(origin, node.source(), fmt::format("unknown key \"{}.{}\"", section, name.str()));
      if (auto read = read_value(*key, node, profile, origin); !read) return tl::unexpected{read.error()};
      seen.insert(label_of(*key));
    }
  }
  if (!is_profile_name(profile.name)) return refuse(origin, root.source(), "name must be 1 to 64 of a-z, 0-9 and -");
  for (const Key& key : profile_keys())
    if (key.required && !seen.count(label_of(key)))
      return refuse(origin, root.source(),
                    fmt::format("{} is missing ({}; {})", label_of(key), key.reason, range_of(key)));
  if (const auto misfit = misfit_of(profile)) {
    const auto* where = root.get(misfit->section);
    return refuse(origin, where ? where->source() : root.source(), misfit->what);
  }
  return profile;
}

}  // namespace

Result<MachineProfile> machine_profile_from_toml(std::string_view text, std::string_view origin) {
  const std::string from = fmt::format("machine profile {}", origin);
  try {
    return read_table(toml::parse(text, origin), from);
  } catch (const toml::parse_error& error) {
    return refuse(from, error.source(), error.description());
  }
}

std::string to_toml(const MachineProfile& profile) {
  const MachineProfile untouched;
  std::string text =
      fmt::format("name = {}\ndescription = {}\n", quoted_text(profile.name), quoted_text(profile.description));
  if (!profile.assumed.empty()) text += fmt::format("assumed = {}\n", list_text(profile.assumed));
  std::string_view section;
  for (const Key& key : profile_keys()) {
    const std::string value = value_text(key, profile);
    if (key.written == Written::UnlessDefault && value == value_text(key, untouched)) continue;
    if (key.section != section) text += fmt::format("\n[{}]\n", section = key.section);
    text += fmt::format("{} = {}\n", key.name, value);
  }
  return text;
}

}  // namespace telefab
