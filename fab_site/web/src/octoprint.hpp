// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/web/page_backend.hpp>
#include <telefab/web/web_message.hpp>

// The part of OctoPrint's REST API (docs.octoprint.org, "REST API") that programs which send files to a printer use.
namespace telefab::fab {

/// What went wrong as OctoPrint says it: {"error": "text"}.
[[nodiscard]] WebResponse octoprint_problem(unsigned status, std::string_view what);

[[nodiscard]] WebResponse octoprint_job(PageBackend& backend);
[[nodiscard]] WebResponse octoprint_printer(PageBackend& backend);
/// 204, or 409 where the job on the machine is not in a state for it.
[[nodiscard]] WebResponse octoprint_command(const WebRequest& request, PageBackend& backend, const std::string& who);
/// 201; 415 for a kind of file that no fab prints.
[[nodiscard]] WebResponse octoprint_upload(const WebRequest& request, PageBackend& backend, const std::string& who);

}  // namespace telefab::fab
