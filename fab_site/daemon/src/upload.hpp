// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <span>
#include <string_view>
#include <telefab/fab/planning/ready_print.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/store/job_store.hpp>

namespace telefab::fab {

/// What an upload may be for: the name that its job asks for, a machine's or a profile's, and how that prints.
struct UploadTarget {
  std::string asked;
  MachineProfile machine;
};

/// Writes the layers of a file into the folder of a new job, as if a scan site had sent them, or its masks, which are
/// printed as they are and traced by whoever plans them (trace_masks); what is still to be done is to make the job,
/// which is `who`'s. A .tfc file is for the machine that it names, contours of another program for the first that they
/// fit, masks for the profile that they fit and, of several, the one whose printer they name. Where not `start`, the
/// job waits for approval once it is planned. InvalidInput: none of the formats, damaged, for a machine this fab has
/// not, for other pixels or layers than its machines have, or for any of several; StorageFailed.
[[nodiscard]] Result<NewJob> write_upload(const DataFolder& data, const std::vector<UploadTarget>& targets,
                                          std::string_view name, std::span<const std::byte> bytes, bool start,
                                          std::string_view who);

/// Writes the layers of a job into the folder of a new one, in the coding in which they came, with its masks and its
/// list of supports by hand where it has them; what is still to be done is to make the job, which is `who`'s and waits
/// for approval. Nobody signs for it. Conflict: not all layers are here; StorageFailed, NotTrusted.
[[nodiscard]] Result<NewJob> write_again(const DataFolder& data, const Job& job, std::string_view who);

/// Layers of a job of masks, as write_upload leaves them of other files; nothing where they are there. Fails as
/// ready_print_in, outlines_of, and with StorageFailed.
[[nodiscard]] Result<void> trace_masks(const std::filesystem::path& folder, const Job& job,
                                       const MachineProfile& machine, const std::stop_token& stop);

/// Whether the job in this folder is a file of masks.
[[nodiscard]] bool has_ready_print(const std::filesystem::path& folder);
/// The masks of such a job. Fails as ready_for, and with StorageFailed.
[[nodiscard]] Result<std::shared_ptr<const ReadyPrint>> ready_print_in(const std::filesystem::path& folder,
                                                                       const MachineProfile& machine);

/// Whether the job in this folder was uploaded to wait for approval.
[[nodiscard]] Result<void> hold_for_approval(const std::filesystem::path& folder);
[[nodiscard]] bool waits_for_approval(const std::filesystem::path& folder);

}  // namespace telefab::fab
