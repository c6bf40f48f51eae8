// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <toml++/toml.h>

#include <optional>
#include <string>
#include <string_view>
#include <telefab/machine/machine_profile.hpp>

#include "profile_keys.hpp"

namespace telefab {

/// InvalidInput: "`origin`, line N: `what`". `origin`: "machine profile x.toml".
[[nodiscard]] tl::unexpected<Error> refuse(std::string_view origin, const toml::source_region& at,
                                           std::string_view what);

/// Reads the value of a key into its field. InvalidInput names the key and its range.
[[nodiscard]] Result<void> read_value(const Key& key, const toml::node& node, MachineProfile& profile,
                                      std::string_view origin);

/// A text of at most 256 bytes. InvalidInput names the key.
[[nodiscard]] Result<std::string> read_text(std::string_view key, const toml::node& node, std::string_view origin);
/// A list of keys of the table. InvalidInput names the one that is none.
[[nodiscard]] Result<std::vector<std::string>> read_keys(std::string_view name, const toml::node& node,
                                                         std::string_view origin);

/// A key's value as TOML writes it.
[[nodiscard]] std::string value_text(const Key& key, const MachineProfile& profile);
[[nodiscard]] std::string quoted_text(std::string_view text);
/// ["a", "b"].
[[nodiscard]] std::string list_text(const std::vector<std::string>& items);

void copy_value(const Key& key, const MachineProfile& from, MachineProfile& to);

/// "resin.penetration_mm".
[[nodiscard]] std::string label_of(const Key& key);
/// Nothing where there is no such key.
[[nodiscard]] const Key* find_key(std::string_view section, std::string_view name);
[[nodiscard]] bool is_section(std::string_view section);

/// 1 to 64 of a-z, 0-9 and -.
[[nodiscard]] bool is_profile_name(std::string_view text);

/// What does not fit together in a whole profile.
struct Misfit {
  std::string_view section;  ///< where it shows; empty: in no one section
  std::string what;
};
/// Nothing where all fits: intervals hold their figures, layers and speeds keep the printer's limits, pixels are those
/// that the maker states and no more than a mask may have.
[[nodiscard]] std::optional<Misfit> misfit_of(const MachineProfile& profile);

}  // namespace telefab
