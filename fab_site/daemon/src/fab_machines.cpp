// SPDX-License-Identifier: GPL-3.0-or-later
#include "fab_machines.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <telefab/base/file.hpp>
#include <telefab/fab/drivers/device_claims.hpp>
#include <telefab/service/profile_choice.hpp>

namespace telefab::fab {
namespace {

constexpr std::uint64_t kMaxListBytes = 1U << 20U;

/// Two lights behind one device would be switched by two prints that know nothing of each other.
Result<void> check_devices(const FabInventory& inventory, const std::string& list) {
  struct Owned {
    DeviceClaim claim;
    std::string machine;
  };
  std::vector<Owned> owned;
  for (const MachineInstance& instance : inventory.instances) {
    const auto composed = inventory.profiles.compose({instance.name});
    if (!composed) return tl::unexpected{composed.error()};
    for (const DeviceClaim& claim : devices_of(composed->profile)) {
      const auto other = std::ranges::find_if(owned, [&](const Owned& o) { return may_be_one(o.claim, claim); });
      if (other != owned.end())
        return fail(
            ErrorCode::InvalidInput,
            fmt::format("the machines {} and {} may have one {} ({} and {}): state {} of each{}", other->machine,
                        instance.name, name_of(claim.kind),
                        other->claim.identity.empty() ? "whichever is found" : other->claim.identity,
                        claim.identity.empty() ? "whichever is found" : claim.identity, claim.key,
                        list.empty() ? "; or, where they are one machine, list those that stand here: --instances"
                                     : fmt::format(" in {}", list)));
      owned.push_back({claim, instance.name});
    }
  }
  return {};
}

}  // namespace

Result<FabInventory> open_inventory(const std::string& list, ProfileCatalogue profiles) {
  std::vector<MachineInstance> instances;
  if (list.empty()) {
    instances = one_of_each(profiles);
  } else {
    const auto bytes = read_file(list, kMaxListBytes);
    if (!bytes) return fail_in("--instances", bytes.error());
    auto read = machine_instances_from_toml({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, list);
    if (!read) return tl::unexpected{read.error()};
    instances = std::move(*read);
  }
  auto offered = with_instances(profiles, instances);
  if (!offered) return tl::unexpected{offered.error()};
  FabInventory inventory{std::move(*offered), std::move(instances)};
  if (auto apart = check_devices(inventory, list); !apart) return tl::unexpected{apart.error()};
  return inventory;
}

Result<FabMachines> FabMachines::of(const ProfileCatalogue& profiles, std::vector<MachineInstance> instances) {
  FabMachines machines{profiles, std::move(instances)};
  for (const MachineInstance& instance : machines.instances_) {
    auto composed = profiles.compose({instance.name});
    if (!composed) return tl::unexpected{composed.error()};
    machines.composed_.push_back(std::move(*composed));
  }
  return machines;
}

std::vector<std::size_t> FabMachines::of_profile(std::string_view profile) const {
  std::vector<std::size_t> places;
  for (std::size_t place = 0; place < instances_.size(); ++place)
    if (instances_[place].profile == profile) places.push_back(place);
  return places;
}

FabMachines::Fits FabMachines::fits(const Job& job) const {
  Fits found;
  const auto choice = profile_choice_of(job.machine, job.parameters);
  if (!choice) return {{}, choice.error().what};
  const auto asked = profiles_->compose(*choice);
  if (!asked) return {{}, asked.error().what};
  std::vector<std::string> others;
  for (std::size_t place = 0; place < instances_.size(); ++place) {
    const auto fit = fit_of(*profiles_, instances_[place], *choice);
    const std::string& name = instances_[place].name;
    if (!fit)
      others.push_back(fit.error().what);
    else if (*fit == InstanceFit::Fits && is_whole(place) &&
             (composed_[place].profile.file.kind != PrinterFile::Goo || composed_[place].profile.file.model.empty()))
      others.push_back(
          fmt::format("the profile of {} does not say what that printer takes: state [file] kind = \"goo\" "
                      "and model (deploy/docs/first-light-sdcp.md)",
                      name));
    else if (*fit == InstanceFit::Fits)
      found.places.push_back(place);
    else if (*fit == InstanceFit::OtherResin)
      others.push_back(fmt::format("{} has {} loaded, not {}", name, composed_[place].resin,
                                   asked->resin.empty() ? asked->profile.resin.name : asked->resin));
    else if (*fit == InstanceFit::OtherLight)
      others.push_back(fmt::format("the light of {} is stated otherwise than that of {}", name, job.machine));
  }
  if (found.places.empty())
    found.why_none = others.empty() ? fmt::format("no machine of {} stands in this fab", job.machine)
                                    : fmt::format("{}", fmt::join(others, "; "));
  return found;
}

Result<MachineProfile> FabMachines::profile_on(std::size_t place, const Job& job) const {
  auto profile = profile_of_job(*profiles_, job.machine, job.parameters);
  if (profile) {
    const MachineProfile& own = this->profile(place);
    profile->devices = own.devices;
    profile->screen = own.screen;
    profile->light = own.light;
  }
  return profile;
}

}  // namespace telefab::fab
