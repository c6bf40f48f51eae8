// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <span>
#include <string_view>
#include <telefab/machine/machine_profile.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/store/job_store.hpp>

namespace telefab::fab {

/// Writes the layers of a .tfc file into the folder of a new job, as if a scan site had sent them; what is still to be
/// done is to make the job, which is `who`'s. Where not `start`, the job waits for approval once it is planned.
/// InvalidInput: not a .tfc file, damaged, for a machine this fab has not, or for another pitch or thickness of it;
/// StorageFailed.
[[nodiscard]] Result<NewJob> write_upload(const DataFolder& data, const std::vector<MachineProfile>& machines,
                                          std::string_view name, std::span<const std::byte> tfc, bool start,
                                          std::string_view who);

/// Whether the job in this folder was uploaded to wait for approval.
[[nodiscard]] Result<void> hold_for_approval(const std::filesystem::path& folder);
[[nodiscard]] bool waits_for_approval(const std::filesystem::path& folder);

}  // namespace telefab::fab
