// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/job/job.hpp>

// What the bodies of an operator's requests say.
namespace telefab {

/// Of an approval: names of what holds the job and is let through, separated by commas; empty: nothing is. The body is
/// empty or {"although":["NAME",..]}. InvalidInput: something else.
[[nodiscard]] Result<std::string> although_of(std::string_view body);

/// Of a resumption: Resume where the body is empty, or what {"as":"treat-as-exposed"} and the like say about a layer or
/// a start that nobody knows of. InvalidInput: something else.
[[nodiscard]] Result<JobCommand> resumption_of(std::string_view body);

}  // namespace telefab
