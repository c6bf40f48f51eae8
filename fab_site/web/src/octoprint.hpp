// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/fab/web/page_backend.hpp>
#include <telefab/web/sign_in.hpp>

// The part of OctoPrint's REST API (docs.octoprint.org, "REST API") that programs which send files to a printer use.
namespace telefab::fab {

inline constexpr std::uint64_t kMostUpload = 256U << 20U;

/// 403 for a request below /api/ with a wrong key, or without one where something would change; as OctoPrint says it.
[[nodiscard]] std::optional<WebResponse> octoprint_refusal(const WebRequest& request, SignIn& sign_in);

[[nodiscard]] WebResponse octoprint_version(const std::string& version);
[[nodiscard]] WebResponse octoprint_job(PageBackend& backend);
[[nodiscard]] WebResponse octoprint_printer(PageBackend& backend);
/// 204, or 409 where the job on the machine is not in a state for it.
[[nodiscard]] WebResponse octoprint_command(const WebRequest& request, PageBackend& backend, const std::string& who);
/// 201; 415 for anything but a .tfc file: a fab prints layers and cuts no scans.
[[nodiscard]] WebResponse octoprint_upload(const WebRequest& request, PageBackend& backend, const std::string& who);

}  // namespace telefab::fab
