// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string_view>

namespace telefab {

struct BuiltinProfile {
  std::string_view folder;  ///< "machines", "resins", "prints"
  std::string_view file;    ///< "dlp6500.toml"
  std::string_view text;
};
/// The profiles of deploy/config, by folder and file name. Made by embed_profiles.cmake.
[[nodiscard]] std::span<const BuiltinProfile> builtin_profile_texts();

}  // namespace telefab
