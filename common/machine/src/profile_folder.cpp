// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/base/file.hpp>
#include <telefab/machine/profile_catalogue.hpp>

#include "builtin_profiles.hpp"

namespace telefab {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t kMaxProfileBytes = 1U << 20U;

/// The built-in files of every kind.
Result<std::vector<ProfilePart>> builtin_parts() {
  std::vector<ProfilePart> all;
  for (const ProfileKind kind : kProfileKinds) {
    auto parts = builtin_profile_parts(kind);
    if (!parts) return parts;
    std::ranges::move(*parts, std::back_inserter(all));
  }
  return all;
}

bool has(const std::vector<ProfilePart>& parts, const ProfilePart& part) {
  return std::ranges::any_of(parts, [&](const auto& p) { return p.kind == part.kind && p.name == part.name; });
}

}  // namespace

Result<std::vector<ProfilePart>> load_profile_parts(ProfileKind kind, const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator{folder, error})
    if (entry.path().extension() == ".toml") paths.push_back(entry.path());
  if (error)
    return fail(ErrorCode::NotFound,
                fmt::format("cannot list {0} profiles in {1}: {2}; give the folder that holds {0}s as *.toml, or leave "
                            "--machines out for those that are installed or built in",
                            name_of(kind), folder.string(), error.message()));
  std::ranges::sort(paths, {}, [](const fs::path& path) { return path.stem(); });
  std::vector<ProfilePart> parts;
  for (const auto& path : paths) {
    const auto bytes = read_file(path, kMaxProfileBytes);
    if (!bytes) return tl::unexpected{bytes.error()};
    auto part =
        profile_part_from_toml(kind, {reinterpret_cast<const char*>(bytes->data()), bytes->size()}, path.string());
    if (!part) return tl::unexpected{part.error()};
    if (part->is_instance)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("{}, line {}: is_instance is what a fab tells of its machines; name them in its list "
                              "(telefab-fab serve --instances)",
                              part->origin, part->headings.at("is_instance")));
    parts.push_back(std::move(*part));
  }
  return parts;
}

Result<std::vector<ProfilePart>> builtin_profile_parts(ProfileKind kind) {
  std::vector<ProfilePart> parts;
  for (const BuiltinProfile& each : builtin_profile_texts()) {
    if (each.folder != folder_name_of(kind)) continue;
    auto part = profile_part_from_toml(kind, each.text, fmt::format("built-in {}", each.file));
    if (!part) return tl::unexpected{part.error()};
    parts.push_back(std::move(*part));
  }
  std::ranges::sort(parts, {}, [](const ProfilePart& part) { return fs::path{part.file}.stem(); });
  return parts;
}

bool holds_profiles(const fs::path& folder) {
  std::error_code error;
  const bool is_reached = fs::exists(folder, error);
  if (is_reached)
    for (const auto& entry : fs::directory_iterator{folder, error})
      if (entry.path().extension() == ".toml") return true;
  // What lies in a home that is another user's is nothing of ours: a service may have kept HOME of who started it.
  if (!is_reached && error == std::errc::permission_denied) return false;
  return error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory;
}

Result<ProfileCatalogue> load_profiles(const fs::path& machine_folder) {
  auto parts = load_profile_parts(ProfileKind::Machine, machine_folder);
  if (!parts) return tl::unexpected{parts.error()};
  if (parts->empty())
    return fail(ErrorCode::NotFound, fmt::format("no machine profile (*.toml) in {}", machine_folder.string()));
  const fs::path beside = fs::absolute(machine_folder / "").lexically_normal().parent_path().parent_path();
  for (const ProfileKind kind : {ProfileKind::Resin, ProfileKind::Print}) {
    const fs::path folder = beside / folder_name_of(kind);
    if (!holds_profiles(folder)) continue;
    auto more = load_profile_parts(kind, folder);
    if (!more) return tl::unexpected{more.error()};
    std::ranges::move(*more, std::back_inserter(*parts));
  }
  const auto builtin = builtin_parts();
  if (!builtin) return tl::unexpected{builtin.error()};
  for (const ProfilePart& part : *builtin)
    if (part.kind != ProfileKind::Machine && !has(*parts, part)) parts->push_back(part);
  return ProfileCatalogue::from(std::move(*parts), *builtin);
}

Result<ProfileCatalogue> builtin_profiles() {
  auto parts = builtin_parts();
  if (!parts) return tl::unexpected{parts.error()};
  return ProfileCatalogue::from(std::move(*parts));
}

}  // namespace telefab
