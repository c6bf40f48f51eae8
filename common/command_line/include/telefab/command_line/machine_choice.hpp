// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <string_view>
#include <telefab/command_line/options.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <vector>

namespace telefab {

/// Which machine a verb works for. Declared alike by every verb.
struct MachineChoice {
  std::string name;    ///< empty: what the verb's input was made for
  std::string folder;  ///< of profiles; empty: they are searched, see machine_profiles
};
enum class MachineIs : std::uint8_t { Optional = 1, Required = 2 };

/// --machine, of which `help` says what for, and --machines. `choice` must outlive the parsing.
void declare_machine_choice(VerbOptions& options, MachineChoice& choice, std::string_view help, MachineIs is);
/// --machines alone.
void declare_machine_folder(VerbOptions& options, std::string& folder);

struct MachineProfiles {
  std::vector<MachineProfile> machines;
  std::string origin;  ///< the folder, or "built in"
};
/// Those of `folder`; where that is empty, of the first of machine_folders() that holds any, else the built-in ones.
/// Never of two places at once, so that a site offers what stands in one folder. Fails as load_machine_profiles does.
[[nodiscard]] Result<MachineProfiles> machine_profiles(const std::string& folder);

/// The profile that was chosen, or the one named `otherwise`. Fails as machine_profiles and find_machine do, and with
/// InvalidInput where neither names one.
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
