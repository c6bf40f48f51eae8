// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string_view>
#include <utility>

namespace telefab {

/// File names and texts of the profiles in deploy/config/machines; made by embed_profiles.cmake.
[[nodiscard]] std::span<const std::pair<std::string_view, std::string_view>> builtin_profile_texts();

}  // namespace telefab
