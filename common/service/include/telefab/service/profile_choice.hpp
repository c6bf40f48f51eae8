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

/// The catalogue as an answer to AskMachines; `origin` says whose it is.
[[nodiscard]] Machines to_machines(const ProfileCatalogue& catalogue, std::string origin);

}  // namespace telefab
