#pragma once
#include "site_client.hpp"

namespace telefab::cli {

/// Follows a job until it is final and shows progress on standard error: a bar on a terminal, a line a change of state
[[nodiscard]] Result<Job> watch_job(SiteClient& client, const std::string& job, bool quiet);

}  // namespace telefab::cli
