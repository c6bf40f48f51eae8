// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/base/environment.hpp>
#include <telefab/command_line/machine_choice.hpp>

namespace telefab {

namespace fs = std::filesystem;

void declare_machine_folder(VerbOptions& options, std::string& folder) {
  options.add("--machines", folder,
              "folder of machine profiles (*.toml); default: the first of ~/.config/telefab/machines, "
              "/etc/telefab/machines, share/telefab/machines of the installation, machines beside the program, "
              "deploy/config/machines; without any the profiles that are built in. Resins and prints are those of the "
              "folders resins and prints beside it, and those that are built in");
}

void declare_machine_choice(VerbOptions& options, MachineChoice& choice, std::string_view help, MachineIs is) {
  options.add("--machine", choice.name, std::string{help}).required(is == MachineIs::Required).names("MACHINE");
  options.add("--resin", choice.resin, "which of `resins`; default: what the machine has loaded, or states itself")
      .names("RESIN");
  options.add("--print", choice.print, "which of `prints`: layers, supports and motion; default: as the machine states")
      .names("PRINT");
  declare_machine_folder(options, choice.folder);
}

Surroundings surroundings() {
  std::error_code unknown;  // where the program lies is not always told; the other places are looked at all the same
  return {config_folder(), fs::read_symlink("/proc/self/exe", unknown)};
}

std::vector<fs::path> machine_folders(const Surroundings& where) {
  std::vector<fs::path> folders;
  if (!where.config.empty()) folders.push_back(where.config / "telefab/machines");
  folders.push_back(where.etc / "telefab/machines");
  if (!where.program.empty()) {
    const fs::path beside = where.program.parent_path();
    folders.push_back(beside.parent_path() / "share/telefab/machines");
    folders.push_back(beside / "machines");
  }
  folders.emplace_back("deploy/config/machines");
  return folders;
}

Result<KnownProfiles> known_profiles(const std::string& folder) {
  std::string place = folder;
  if (folder.empty())
    for (const fs::path& each : machine_folders(surroundings())) {
      if (!holds_profiles(each)) continue;
      place = each.string();
      break;
    }
  auto catalogue = place.empty() ? builtin_profiles() : load_profiles(place);
  if (!catalogue) return tl::unexpected{catalogue.error()};
  return KnownProfiles{std::move(*catalogue), place.empty() ? "built in" : place};
}

Result<ComposedProfile> chosen_profile(const MachineChoice& choice, std::string_view otherwise) {
  const std::string_view name = choice.name.empty() ? otherwise : std::string_view{choice.name};
  if (name.empty()) return fail(ErrorCode::InvalidInput, "name the machine with --machine");
  const auto known = known_profiles(choice.folder);
  if (!known) return tl::unexpected{known.error()};
  auto composed = known->catalogue.compose({std::string{name}, choice.resin, choice.print});
  if (!composed) return fail_in("machine profiles, " + known->origin, composed.error());
  return composed;
}

Result<MachineProfile> chosen_machine(const MachineChoice& choice, std::string_view otherwise) {
  auto composed = chosen_profile(choice, otherwise);
  if (!composed) return tl::unexpected{composed.error()};
  return std::move(composed->profile);
}

}  // namespace telefab
