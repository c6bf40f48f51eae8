// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string_view>
#include <telefab/command_line/options.hpp>
#include <telefab/job/slice_parameters.hpp>

namespace telefab {

/// An option for every row of slice_parameter_table() that chooses no profile, or for the rows of some keys; those of
/// the profile come with declare_machine_choice. `into` must outlive the parsing.
/// Ranges and words are for validate() to judge, here as at the site that gets them: a wrong value is refused, not a
/// wrong line.
void declare_slice_parameters(VerbOptions& options, SliceParameters& into, std::span<const std::string_view> keys = {});
/// The same for every row: what may be asked of a job.
void declare_job_parameters(VerbOptions& options, SliceParameters& into);

}  // namespace telefab
