// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/machine/profile_catalogue.hpp>
#include <vector>

// The machines that stand in one fab: several may be of one profile, each with devices and resin of its own.
namespace telefab {

inline constexpr std::size_t kMaxInstances = 64;  ///< named by one list

/// One machine as it stands in a fab. Its name is one under which jobs ask for it, as for a profile.
struct MachineInstance {
  std::string name;     ///< 1 to 64 of a-z, 0-9 and -
  std::string profile;  ///< it is one of
  /// What it states itself, as a machine's file that inherits from the profile would: what is loaded, its default way
  /// to print, and keys of [devices], [screen] and [light].
  ProfilePart part;
  /// Named by a list; else it is there because the profile is, and all that is known of it is the profile.
  bool is_stated = false;
};

/// Reads a list of machines, `[[machine]]` tables with name, profile, and, where they differ from the profile's,
/// resin, print, description, [machine.devices], [machine.screen] and [machine.light]. `file`: for messages.
/// InvalidInput: file, line, what is wrong, how it should be; also two of one name, none, or more than kMaxInstances.
[[nodiscard]] Result<std::vector<MachineInstance>> machine_instances_from_toml(std::string_view text,
                                                                               std::string_view file);
/// One for each machine that a catalogue offers, named as its profile.
[[nodiscard]] std::vector<MachineInstance> one_of_each(const ProfileCatalogue& catalogue);

/// The catalogue of a fab in which these machines stand: it offers them by their names, and the profiles they are of,
/// which stand for any machine of them; the profiles of which none stands there may only be inherited from. A machine
/// may be named as its own profile where it is the only one of it and states nothing beside it. Fails with
/// InvalidInput, by file and line: a profile, resin or way to print that is not known, a name that is one of another
/// profile, what does not fit together.
[[nodiscard]] Result<ProfileCatalogue> with_instances(const ProfileCatalogue& catalogue,
                                                      const std::vector<MachineInstance>& instances);

/// Why a machine does not print a job that asks for its profile.
enum class InstanceFit : std::uint8_t {
  Fits,
  OtherMachine,  ///< the job asks for another
  OtherResin,    ///< another resin is loaded than the job is planned for
  OtherLight,    ///< its light is stated otherwise than its profile's, so the job's exposures do not hold
};
/// Whether the machine may print a job that asked for `choice`. Fails as ProfileCatalogue::compose, and with NotFound
/// where the catalogue offers no such machine. `catalogue`: as with_instances made it.
[[nodiscard]] Result<InstanceFit> fit_of(const ProfileCatalogue& catalogue, const MachineInstance& instance,
                                         const ProfileChoice& choice);

}  // namespace telefab
