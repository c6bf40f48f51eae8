// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/fab/web/page_backend.hpp>
#include <tl/expected.hpp>

namespace telefab::fab {

inline constexpr std::uint64_t kMostUpload = 256U << 20U;

/// Why a file became no job: 400 its name or content, 404 for a machine this fab has not, 415 its kind.
struct UploadRefusal {
  unsigned status = 400;
  std::string what;
};

/// The last part of a path of either kind.
[[nodiscard]] std::string_view base_name(std::string_view path);

/// Makes a job of a file, `path` being what its sender calls it, with the folder that may name a machine; the job's id.
/// Printed as soon as it is planned where `start` and nothing holds it, else it waits for approval.
[[nodiscard]] tl::expected<std::string, UploadRefusal> take_upload(PageBackend& backend, std::string_view path,
                                                                   std::string_view bytes, bool start,
                                                                   std::string_view who);

}  // namespace telefab::fab
