// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>

namespace telefab {

/// The value of an environment variable; empty where it is not set. Not beside a thread that sets one.
[[nodiscard]] std::string environment_variable(const char* name);

/// The home of whoever runs this: $HOME, else what the system's list of users says; empty where neither knows one.
[[nodiscard]] std::filesystem::path home_folder();

/// Where programs keep what their user sets: $XDG_CONFIG_HOME, else .config at home; empty where there is no home. By
/// the XDG Base Directory Specification.
[[nodiscard]] std::filesystem::path config_folder();

}  // namespace telefab
