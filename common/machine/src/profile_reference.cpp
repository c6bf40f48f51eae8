// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/machine/profile_reference.hpp>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <telefab/machine/profile_part.hpp>

#include "profile_headings.hpp"
#include "profile_values.hpp"

namespace telefab {
namespace {

constexpr std::string_view kHead = R"(# Reference of profiles

Every key that a machine, a resin or a print may state. Made by `telefab-fab machines --keys --markdown`; how profiles are
composed, and how to add one: [profiles](profiles.md).

## Above the sections

| key | of | may be | meaning |
|---|---|---|---|
)";

/// Of a number, by the end of its key's name; the longest ending that fits counts.
constexpr std::array kUnits{std::pair{"_mm_per_s2", "mm/s²"},
                            std::pair{"_mm_per_s", "mm/s"},
                            std::pair{"_mw_per_cm2", "mW/cm²"},
                            std::pair{"_mj_per_cm2", "mJ/cm²"},
                            std::pair{"_g_per_ml", "g/ml"},
                            std::pair{"_per_mm", "1/mm"},
                            std::pair{"_mpa_s", "mPa s"},
                            std::pair{"_mpa", "MPa"},
                            std::pair{"_kpa", "kPa"},
                            std::pair{"_mm2", "mm²"},
                            std::pair{"_mm3", "mm³"},
                            std::pair{"_mm", "mm"},
                            std::pair{"_um", "µm"},
                            std::pair{"_px2", "pixels"},
                            std::pair{"_px", "pixels"},
                            std::pair{"_ml", "ml"},
                            std::pair{"_percent", "%"},
                            std::pair{"_celsius", "°C"},
                            std::pair{"_degrees", "°"},
                            std::pair{"_hz", "Hz"},
                            std::pair{"_ms", "ms"},
                            std::pair{"_bytes", "bytes"},
                            std::pair{"_frames", "frames"},
                            std::pair{"_s", "s"}};

std::string_view unit_of(std::string_view name) {
  const auto found = std::ranges::find_if(kUnits, [&](const auto& each) { return name.ends_with(each.first); });
  return found == kUnits.end() ? std::string_view{} : found->second;
}

/// A bar would end the cell, and what looks like HTML would be taken for it.
std::string cell(std::string_view text) {
  std::string safe;
  for (const char c : text) {
    if (c == '|') safe += '\\';
    if (c == '<')
      safe += "&lt;";
    else
      safe += c;
  }
  return safe;
}

std::string kinds_text(const std::array<bool, 3>& of) {
  std::vector<std::string_view> names;
  for (const ProfileKind kind : kProfileKinds)
    if (of[static_cast<std::size_t>(kind)]) names.push_back(name_of(kind));
  return fmt::format("{}", fmt::join(names, ", "));
}

std::string_view kinds_of(std::string_view section) {
  if (section == "resin") return "machines and resins";
  return section == "layers" || section == "supports" || section == "motion" ? "machines and prints" : "machines";
}

}  // namespace

std::string profile_reference() {
  std::string page{kHead};
  for (const HeadingRow& row : profile_headings())
    page += fmt::format("| `{}` | {} | {} | {} |\n", row.key, kinds_text(row.of), cell(row.range), cell(row.meaning));
  const MachineProfile untouched;
  std::string_view section;
  for (const Key& key : profile_keys()) {
    if (key.section != section) {
      section = key.section;
      page += fmt::format("\n## [{}]\n\nOf {}.\n\n| key | unit | may be | default | meaning |\n|---|---|---|---|---|\n",
                          section, kinds_of(section));
    }
    const std::string fallback = key.required ? "required" : fmt::format("`{}`", value_text(key, untouched));
    page += fmt::format("| `{}` | {} | {} | {} | {} |\n", key.name, unit_of(key.name), cell(range_of(key)),
                        cell(fallback), cell(key.reason));
  }
  return page;
}

}  // namespace telefab
