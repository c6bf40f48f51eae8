// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/command_line/program.hpp>

// Verbs that both sites' programs have.
namespace telefab {

/// `logs JOB --data DIR`: a job's events and the audit log's lines on it, by time.
[[nodiscard]] VerbBody declare_logs(VerbOptions& options);

/// `audit --data DIR`: follows the audit log through all of its parts.
[[nodiscard]] VerbBody declare_audit(VerbOptions& options);

/// `machines`: the machine profiles of a folder, one of them value by value, or every key a profile may have.
[[nodiscard]] VerbBody declare_machines(VerbOptions& options);
/// `resins`, `prints`: those beside it, and those that are built in.
[[nodiscard]] VerbBody declare_resins(VerbOptions& options);
[[nodiscard]] VerbBody declare_prints(VerbOptions& options);

/// `api [--json]`: the description of the site's HTTP API, as a page or as OpenAPI; `openapi` gives the latter.
[[nodiscard]] VerbBody declare_api(VerbOptions& options, std::string (*openapi)());

/// `tokens ACTION [NAME] --data DIR`: the tokens that operators sign in with at the page.
[[nodiscard]] VerbBody declare_tokens(VerbOptions& options);

/// `page-link [--data DIR] [--json]`: a link that signs in once at the page of the daemon there; `data`: of the
/// installed service.
[[nodiscard]] VerbBody declare_page_link(VerbOptions& options, const char* data);

}  // namespace telefab
