// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <telefab/machine/profile_part.hpp>

#include "profile_headings.hpp"
#include "profile_values.hpp"

namespace telefab {
namespace {

constexpr std::array<std::string_view, 3> kNames{"machine", "resin", "print"};
constexpr std::array<std::string_view, 3> kFolders{"machines", "resins", "prints"};

/// Whether files of that kind may state keys of that section.
bool may_state(ProfileKind kind, std::string_view section) {
  switch (kind) {
    case ProfileKind::Machine:
      return true;
    case ProfileKind::Resin:
      return section == "resin";
    case ProfileKind::Print:
      return section == "layers" || section == "supports" || section == "motion";
  }
  return false;
}

/// A text above the sections.
struct Heading {
  std::string_view key;
  std::string ProfilePart::*field;
  std::array<bool, 3> of;  ///< by ProfileKind
  bool is_name;
  std::string_view meaning;
};
constexpr std::array kHeadings{
    Heading{"name", &ProfilePart::name, {true, true, true}, true, "what it is asked for by; required"},
    Heading{"description", &ProfilePart::description, {true, true, true}, false, "one line for people"},
    Heading{"source", &ProfilePart::source, {true, true, true}, false, "where its figures were published"},
    Heading{"inherits",
            &ProfilePart::inherits,
            {true, true, true},
            true,
            "a file of its kind that says what this one does not"},
    Heading{"loaded_resin",
            &ProfilePart::loaded_resin,
            {true, false, false},
            true,
            "the resin in its vat: it is printed with, and no other is taken"},
    Heading{"default_print",
            &ProfilePart::default_print,
            {true, false, false},
            true,
            "the way to print of a job that chooses none"},
    Heading{"for_machine",
            &ProfilePart::for_machine,
            {false, false, true},
            true,
            "its exposures are for that machine, or what inherits from it"},
    Heading{"for_resin",
            &ProfilePart::for_resin,
            {false, false, true},
            true,
            "its exposures are for that resin, or what inherits from it"},
};

struct Flag {
  std::string_view key;
  bool ProfilePart::*field;
  std::string_view meaning;
};
constexpr std::array kFlags{
    Flag{"is_base", &ProfilePart::is_base, "there to be inherited from, and not offered"},
    Flag{"is_instance", &ProfilePart::is_instance, "one machine of a fab, of the profile that it inherits from"},
    Flag{"built_in", &ProfilePart::is_reference, "between sites: stands for the built-in file of its name"}};

constexpr double kMostPrice = 1e6;

class PartReader {
 public:
  explicit PartReader(ProfilePart& part) : part_{part} {}

  Result<void> read(const toml::table& root) {
    for (const auto& [key, node] : root)
      if (auto read = read_entry(key.str(), node); !read) return read;
    if (!is_profile_name(part_.name))
      return refuse(part_.origin, root.source(), "name must be 1 to 64 of a-z, 0-9 and -");
    for (const std::string& key : part_.assumed)
      if (!part_.states(key))
        return refuse(part_.origin, root.source(),
                      fmt::format("assumed names {}, which this file does not state", key));
    if (part_.price && (part_.price->per_litre == 0 || part_.price->currency.empty()))
      return refuse(part_.origin, root.source(), "price_per_litre and currency go together: one of both is missing");
    return {};
  }

 private:
  Result<void> read_entry(std::string_view key, const toml::node& node) {
    part_.headings[std::string{key}] = static_cast<int>(node.source().begin.line);
    const auto heading = std::ranges::find(kHeadings, key, &Heading::key);
    if (heading != kHeadings.end() && heading->of[static_cast<std::size_t>(part_.kind)])
      return read_heading(*heading, node);
    if (key == "assumed") {
      auto keys = read_keys(key, node, part_.origin);
      if (!keys) return tl::unexpected{keys.error()};
      part_.assumed = std::move(*keys);
      return {};
    }
    const auto flag = std::ranges::find(kFlags, key, &Flag::key);
    if (flag != kFlags.end()) {
      const auto value = node.value_exact<bool>();
      if (!value) return refuse(part_.origin, node.source(), fmt::format("{} must be true or false", key));
      part_.*flag->field = *value;
      return {};
    }
    if ((key == "price_per_litre" || key == "currency") && part_.kind == ProfileKind::Resin)
      return read_price(key, node);
    if (key == "exposures" && part_.kind == ProfileKind::Resin) return read_exposures(node);
    if (is_section(key) && node.is_table()) return read_section(key, *node.as_table());
    return refuse(part_.origin, node.source(), fmt::format("unknown key \"{}\"", key));
  }

  Result<void> read_heading(const Heading& heading, const toml::node& node) {
    auto text = read_text(heading.key, node, part_.origin);
    if (!text) return tl::unexpected{text.error()};
    if (heading.is_name && !is_profile_name(*text))
      return refuse(part_.origin, node.source(), fmt::format("{} must be 1 to 64 of a-z, 0-9 and -", heading.key));
    part_.*heading.field = std::move(*text);
    return {};
  }

  Result<void> read_price(std::string_view key, const toml::node& node) {
    if (!part_.price) part_.price.emplace();
    if (key == "currency") {
      auto text = read_text(key, node, part_.origin);
      if (!text) return tl::unexpected{text.error()};
      if (text->size() != 3 || !std::ranges::all_of(*text, [](char c) { return c >= 'A' && c <= 'Z'; }))
        return refuse(part_.origin, node.source(), "currency must be three capital letters, as EUR or USD");
      part_.price->currency = std::move(*text);
      return {};
    }
    const auto value = node.value<double>();
    if (!value || node.is_boolean() || !(*value > 0 && *value <= kMostPrice))
      return refuse(part_.origin, node.source(),
                    fmt::format("price_per_litre must be a number above 0, up to {}", kMostPrice));
    part_.price->per_litre = *value;
    return {};
  }

  Result<void> read_section(std::string_view section, const toml::table& table) {
    if (!may_state(part_.kind, section))
      return refuse(part_.origin, table.source(),
                    fmt::format("[{}] is not a {}'s to state", section, name_of(part_.kind)));
    for (const auto& [name, node] : table) {
      const Key* key = find_key(section, name.str());
      if (!key) return refuse(part_.origin, node.source(), fmt::format("unknown key \"{}.{}\"", section, name.str()));
      if (auto read = read_value(*key, node, part_.values, part_.origin); !read) return read;
      part_.lines[label_of(*key)] = static_cast<int>(node.source().begin.line);
    }
    return {};
  }

  Result<void> read_exposures(const toml::node& node) {
    const toml::array* array = node.as_array();
    if (!array) return refuse(part_.origin, node.source(), "exposures must be tables, [[exposures]]");
    for (const toml::node& item : *array) {
      const toml::table* table = item.as_table();
      if (!table) return refuse(part_.origin, item.source(), "exposures must be tables, [[exposures]]");
      PublishedExposure exposure;
      for (const auto& [key, value] : *table)
        if (auto read = read_exposure(key.str(), value, exposure); !read) return read;
      if (exposure.machine.empty() || exposure.thickness_mm == 0 || exposure.exposure_s == 0)
        return refuse(part_.origin, item.source(), "[[exposures]] needs machine, thickness_mm and exposure_s");
      part_.exposures.push_back(std::move(exposure));
    }
    return {};
  }

  /// Times and heights have the ranges of the keys that they stand for.
  Result<void> read_exposure(std::string_view key, const toml::node& node, PublishedExposure& exposure) {
    if (key == "machine") {
      auto text = read_text("exposures.machine", node, part_.origin);
      if (!text) return tl::unexpected{text.error()};
      if (!is_profile_name(*text))
        return refuse(part_.origin, node.source(), "exposures.machine must be 1 to 64 of a-z, 0-9 and -");
      exposure.machine = std::move(*text);
      return {};
    }
    const Key* stands_for = find_key("layers", key);
    if (!stands_for || (key != "thickness_mm" && key != "exposure_s" && key != "bottom_exposure_s"))
      return refuse(part_.origin, node.source(), fmt::format("unknown key \"exposures.{}\"", key));
    MachineProfile values;
    if (auto read = read_value(*stands_for, node, values, part_.origin); !read) return read;
    if (key == "thickness_mm") exposure.thickness_mm = values.layers.thickness_mm;
    if (key == "exposure_s") exposure.exposure_s = values.layers.exposure_s;
    if (key == "bottom_exposure_s") exposure.bottom_exposure_s = values.layers.bottom_exposure_s;
    return {};
  }

  ProfilePart& part_;
};

}  // namespace

std::vector<HeadingRow> profile_headings() {
  std::vector<HeadingRow> rows;
  for (const Heading& each : kHeadings)
    rows.push_back({each.key, each.of, each.is_name ? "1 to 64 of a-z, 0-9 and -" : "text", each.meaning});
  rows.push_back({"price_per_litre",
                  {false, true, false},
                  "a number above 0",
                  "what a litre costs; pages and plans show what a print takes of it"});
  rows.push_back({"currency", {false, true, false}, "three capital letters, as EUR", "of the price"});
  rows.push_back(
      {"assumed", {true, true, true}, "keys of this file", "those whose values nobody has published or measured"});
  for (const Flag& each : kFlags) rows.push_back({each.key, {true, true, true}, "true | false", each.meaning});
  rows.push_back({"[[exposures]]",
                  {false, true, false},
                  "machine, thickness_mm, exposure_s, bottom_exposure_s",
                  "published for a machine, or what inherits from it, and a thickness"});
  return rows;
}

std::string_view name_of(ProfileKind kind) { return kNames[static_cast<std::size_t>(kind)]; }
std::string_view folder_name_of(ProfileKind kind) { return kFolders[static_cast<std::size_t>(kind)]; }

Result<ProfilePart> profile_part_from_toml(ProfileKind kind, std::string_view text, std::string_view file) {
  ProfilePart part;
  part.kind = kind;
  part.file = file;
  part.origin = fmt::format("{} profile {}", name_of(kind), file);
  try {
    if (auto read = PartReader{part}.read(toml::parse(text, file)); !read) return tl::unexpected{read.error()};
  } catch (const toml::parse_error& error) {
    return refuse(part.origin, error.source(), error.description());
  }
  return part;
}

std::string to_toml(const ProfilePart& part) {
  std::string text;
  if (part.is_reference)
    return fmt::format("name = {}\nbuilt_in = true\n{}", quoted_text(part.name),
                       part.is_base ? "is_base = true\n" : "");
  for (const Heading& heading : kHeadings)
    if (const std::string& value = part.*heading.field; !value.empty())
      text += fmt::format("{} = {}\n", heading.key, quoted_text(value));
  if (part.is_base) text += "is_base = true\n";
  if (part.is_instance) text += "is_instance = true\n";
  if (!part.assumed.empty()) text += fmt::format("assumed = {}\n", list_text(part.assumed));
  if (part.price)
    text +=
        fmt::format("price_per_litre = {}\ncurrency = {}\n", part.price->per_litre, quoted_text(part.price->currency));
  std::string_view section;
  for (const Key& key : profile_keys()) {
    if (!part.states(label_of(key))) continue;
    if (key.section != section) text += fmt::format("\n[{}]\n", section = key.section);
    text += fmt::format("{} = {}\n", key.name, value_text(key, part.values));
  }
  for (const PublishedExposure& exposure : part.exposures) {
    text += fmt::format("\n[[exposures]]\nmachine = {}\nthickness_mm = {}\nexposure_s = {}\n",
                        quoted_text(exposure.machine), exposure.thickness_mm, exposure.exposure_s);
    if (exposure.bottom_exposure_s > 0) text += fmt::format("bottom_exposure_s = {}\n", exposure.bottom_exposure_s);
  }
  return text;
}

}  // namespace telefab
