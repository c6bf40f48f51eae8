// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string_view>
#include <telefab/job/job.hpp>

namespace telefab {

inline constexpr std::uint32_t kMostJobsOfAPage = 1000;

/// What the query of `GET /v1/jobs` asks for: ?search=WORDS&state=NAME,NAME&most=N&before=N; nothing where it names
/// none of them. InvalidInput: a value that cannot be meant.
[[nodiscard]] Result<std::optional<JobQuery>> job_question_of(std::string_view target);

}  // namespace telefab
