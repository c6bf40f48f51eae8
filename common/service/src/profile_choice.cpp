// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/service/profile_choice.hpp>

namespace telefab {

Result<ProfileChoice> profile_choice_of(std::string_view machine, std::string_view parameters) {
  ProfileChoice choice{std::string{machine}};
  if (parameters.empty()) return choice;
  const auto object = json_or_discarded(parameters);
  if (!object.is_object()) return fail(ErrorCode::InvalidInput, "the parameters of the job are not a JSON object");
  for (const auto& [key, field] : {std::pair{"resin", &ProfileChoice::resin}, {"print", &ProfileChoice::print}}) {
    const auto found = object.find(key);
    if (found == object.end()) continue;
    if (!found->is_string()) return fail(ErrorCode::InvalidInput, fmt::format("parameter {}: must be a text", key));
    choice.*field = found->get<std::string>();
  }
  return choice;
}

Result<ComposedProfile> composed_of_job(const ProfileCatalogue& catalogue, std::string_view machine,
                                        std::string_view parameters) {
  const auto choice = profile_choice_of(machine, parameters);
  if (!choice) return tl::unexpected{choice.error()};
  return catalogue.compose(*choice);
}

Result<MachineProfile> profile_of_job(const ProfileCatalogue& catalogue, std::string_view machine,
                                      std::string_view parameters) {
  auto composed = composed_of_job(catalogue, machine, parameters);
  if (!composed) return tl::unexpected{composed.error()};
  return std::move(composed->profile);
}

std::string light_of(const ProfileCatalogue& catalogue, const std::string& profile, const std::string& resin) {
  const auto composed = catalogue.compose({profile, resin});
  return composed ? to_hex(digest_of_profile(composed->profile)) : std::string{};
}

Machines to_machines(const ProfileCatalogue& catalogue, std::string origin) {
  Machines machines;
  machines.machine_toml = catalogue.texts(ProfileKind::Machine);
  machines.resin_toml = catalogue.texts(ProfileKind::Resin);
  machines.print_toml = catalogue.texts(ProfileKind::Print);
  machines.origin = std::move(origin);
  return machines;
}

}  // namespace telefab
