// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/job/job.hpp>
#include <telefab/machine/machine_instances.hpp>
#include <vector>

namespace telefab::fab {

/// What a fab offers, and what stands in it.
struct FabInventory {
  ProfileCatalogue profiles;               ///< jobs are cut for; the machines by their own names too
  std::vector<MachineInstance> instances;  ///< in the order of the list
};
/// The machines of a list, or one of each profile where `list` is empty. Fails as machine_instances_from_toml and
/// with_instances do, with NotFound where the file is not there, and with InvalidInput where two machines may turn out
/// to have one device: each is to state which is its own.
[[nodiscard]] Result<FabInventory> open_inventory(const std::string& list, ProfileCatalogue profiles);

/// The machines that stand in the fab, by their places in its list. Threads: any.
class FabMachines {
 public:
  /// `profiles`: as open_inventory gave them; must outlive this. Fails as ProfileCatalogue::compose.
  [[nodiscard]] static Result<FabMachines> of(const ProfileCatalogue& profiles, std::vector<MachineInstance> instances);

  [[nodiscard]] std::size_t size() const { return instances_.size(); }
  [[nodiscard]] const MachineInstance& operator[](std::size_t place) const { return instances_[place]; }
  /// As it prints where a job chooses nothing.
  [[nodiscard]] const ComposedProfile& composed(std::size_t place) const { return composed_[place]; }
  [[nodiscard]] const MachineProfile& profile(std::size_t place) const { return composed_[place].profile; }
  /// Whether it is a printer that owns its light.
  [[nodiscard]] bool is_whole(std::size_t place) const { return profile(place).devices.printer != PrinterKind::None; }
  /// Places of the machines of a profile.
  [[nodiscard]] std::vector<std::size_t> of_profile(std::string_view profile) const;

  /// Which machines may print a job, as its parameters are; where none may, `why_none` says what stands against it.
  struct Fits {
    std::vector<std::size_t> places;
    std::string why_none;
  };
  [[nodiscard]] Fits fits(const Job& job) const;
  /// What a job is printed with on a machine: the profile it was planned for, on the devices of that machine. Fails as
  /// profile_of_job does.
  [[nodiscard]] Result<MachineProfile> profile_on(std::size_t place, const Job& job) const;

 private:
  FabMachines(const ProfileCatalogue& profiles, std::vector<MachineInstance> instances)
      : profiles_{&profiles}, instances_{std::move(instances)} {}

  const ProfileCatalogue* profiles_;
  std::vector<MachineInstance> instances_;
  std::vector<ComposedProfile> composed_;
};

}  // namespace telefab::fab
