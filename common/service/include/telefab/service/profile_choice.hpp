// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/wire/message.hpp>

namespace telefab {

/// What a job is printed with: its machine, and `resin` and `print` of its parameters, a JSON object in which other
/// keys may stand, or nothing. InvalidInput: no object, or one of both is not a text.
[[nodiscard]] Result<ProfileChoice> profile_choice_of(std::string_view machine, std::string_view parameters);

/// What such a job is printed with. Fails as profile_choice_of and ProfileCatalogue::compose.
[[nodiscard]] Result<ComposedProfile> composed_of_job(const ProfileCatalogue& catalogue, std::string_view machine,
                                                      std::string_view parameters);
/// The profile of it alone.
[[nodiscard]] Result<MachineProfile> profile_of_job(const ProfileCatalogue& catalogue, std::string_view machine,
                                                    std::string_view parameters);

/// Digest, hexadecimal, of what a machine of that profile prints with that resin where a job chooses nothing else: what
/// a fleet compares, so that a job which was cut for one machine is printed by any of its kind, and by no other of the
/// same name. Empty resin: the machine's own. Empty where they do not compose.
[[nodiscard]] std::string light_of(const ProfileCatalogue& catalogue, const std::string& profile,
                                   const std::string& resin);

/// The catalogue as an answer to AskMachines; `origin` says whose it is.
[[nodiscard]] Machines to_machines(const ProfileCatalogue& catalogue, std::string origin);

}  // namespace telefab
