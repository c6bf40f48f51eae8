// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <telefab/command_line/options.hpp>
#include <telefab/machine/profile_catalogue.hpp>
#include <vector>

namespace telefab {

/// Which machine a verb works for, with which resin and in which way it prints. Declared alike by every verb.
struct MachineChoice {
  std::string name;        ///< empty: what the verb's input was made for
  std::string folder;      ///< of profiles; empty: they are searched, see known_profiles
  std::string resin = {};  ///< empty: what the machine has loaded, or states itself
  std::string print = {};  ///< empty: as the machine states
};
enum class MachineIs : std::uint8_t { Optional = 1, Required = 2 };

/// --machine, of which `help` says what for, --resin, --print and --machines. `choice` must outlive the parsing.
void declare_machine_choice(VerbOptions& options, MachineChoice& choice, std::string_view help, MachineIs is);
/// --machines alone.
void declare_machine_folder(VerbOptions& options, std::string& folder);

struct KnownProfiles {
  ProfileCatalogue catalogue;
  std::string origin;  ///< the folder of the machines, or "built in"
};
/// The machines of `folder`; where that is empty, of the first of machine_folders() that holds any, else the built-in
/// ones; with the resins and prints that load_profiles finds beside them. Machines never come from two places at once,
/// so that a site offers what stands in one folder. Fails as load_profiles does.
[[nodiscard]] Result<KnownProfiles> known_profiles(const std::string& folder);

/// What was chosen, of the machine named `otherwise` where the choice names none. Fails as chosen_machine.
[[nodiscard]] Result<ComposedProfile> chosen_profile(const MachineChoice& choice, std::string_view otherwise = {});
/// The profile that was chosen, of the machine named `otherwise` where the choice names none. Fails as known_profiles
/// and ProfileCatalogue::compose do, and with InvalidInput where neither names a machine.
[[nodiscard]] Result<MachineProfile> chosen_machine(const MachineChoice& choice, std::string_view otherwise = {});

/// Where this process stands: what the search depends on.
struct Surroundings {
  std::filesystem::path config;   ///< config_folder(); empty: none is known
  std::filesystem::path program;  ///< the executable
  std::filesystem::path etc = "/etc";
};
[[nodiscard]] Surroundings surroundings();
/// In order: telefab/machines of the user's configuration, of /etc, of the share folder the program is installed with,
/// machines beside the program, deploy/config/machines below the working folder (a checkout).
[[nodiscard]] std::vector<std::filesystem::path> machine_folders(const Surroundings& where);

}  // namespace telefab
