// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <telefab/base/file.hpp>
#include <telefab/machine/machine_profile.hpp>

#include "builtin_profiles.hpp"

namespace telefab {

Result<std::vector<MachineProfile>> load_machine_profiles(const std::string& folder) {
  std::error_code error;
  std::vector<std::filesystem::path> paths;
  for (const auto& entry : std::filesystem::directory_iterator{folder, error})
    if (entry.path().extension() == ".toml") paths.push_back(entry.path());
  if (error)
    return fail(ErrorCode::NotFound, fmt::format("cannot list machine profiles in {}: {}", folder, error.message()));
  std::sort(paths.begin(), paths.end());
  std::vector<MachineProfile> machines;
  for (const auto& path : paths) {
    auto bytes = read_file(path, 1U << 20U);
    if (!bytes) return tl::unexpected{bytes.error()};
    auto profile =
        machine_profile_from_toml({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, path.string());
    if (!profile) return tl::unexpected{profile.error()};
    if (std::any_of(machines.begin(), machines.end(), [&](const auto& m) { return m.name == profile->name; }))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("machine profile {}: a second machine is named {}", path.string(), profile->name));
    machines.push_back(std::move(*profile));
  }
  if (machines.empty()) return fail(ErrorCode::NotFound, fmt::format("no machine profile (*.toml) in {}", folder));
  return machines;
}

bool holds_machine_profiles(const std::filesystem::path& folder) {
  std::error_code error;
  const bool is_reached = std::filesystem::exists(folder, error);
  if (is_reached)
    for (const auto& entry : std::filesystem::directory_iterator{folder, error})
      if (entry.path().extension() == ".toml") return true;
  // What lies in a home that is another user's is nothing of ours: a service may have kept HOME of who started it.
  if (!is_reached && error == std::errc::permission_denied) return false;
  return error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory;
}

Result<std::vector<MachineProfile>> builtin_machine_profiles() {
  std::vector<MachineProfile> machines;
  for (const auto& [name, text] : builtin_profile_texts()) {
    auto profile = machine_profile_from_toml(text, fmt::format("built-in {}", name));
    if (!profile) return tl::unexpected{profile.error()};
    machines.push_back(std::move(*profile));
  }
  return machines;
}

Result<MachineProfile> find_machine(const std::vector<MachineProfile>& machines, std::string_view name) {
  const auto found = std::find_if(machines.begin(), machines.end(), [&](const auto& m) { return m.name == name; });
  if (found != machines.end()) return *found;
  std::vector<std::string_view> names;
  for (const auto& machine : machines) names.push_back(machine.name);
  return fail(ErrorCode::InvalidInput, fmt::format("no machine named {}; there are: {}", name, fmt::join(names, ", ")));
}

}  // namespace telefab
