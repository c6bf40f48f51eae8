#pragma once
#include <telefab/program/program.hpp>

namespace telefab {

/// `logs JOB --data DIR`: a job's events and the audit log's lines on it, by time. Same verb at both sites.
[[nodiscard]] VerbBody declare_logs(CLI::App& options);

}  // namespace telefab
