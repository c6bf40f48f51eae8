// SPDX-License-Identifier: GPL-3.0-or-later
#include <pwd.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <telefab/base/environment.hpp>

namespace telefab {

std::string environment_variable(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr ? value : "";
}

std::filesystem::path home_folder() {
  if (std::string home = environment_variable("HOME"); !home.empty()) return home;
  passwd user{};
  passwd* found = nullptr;
  std::array<char, 4096> texts{};
  if (getpwuid_r(geteuid(), &user, texts.data(), texts.size(), &found) != 0 || found == nullptr) return {};
  return user.pw_dir;
}

std::filesystem::path config_folder() {
  if (std::string folder = environment_variable("XDG_CONFIG_HOME"); !folder.empty()) return folder;
  const std::filesystem::path home = home_folder();
  return home.empty() ? home : home / ".config";
}

}  // namespace telefab
