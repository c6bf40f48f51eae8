// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/command_line/options.hpp>
#include <telefab/job/slice_parameters.hpp>

namespace telefab {

/// Whether the text of a row that has a form, and no list of choices, can be read; the failure says why not.
using ReadText = std::function<Result<void>(const SliceParameter& row, const std::string& text)>;

/// An option for every row of slice_parameter_table() that is of slicing, or for the rows of some keys; those of
/// the profile come with declare_machine_choice. `into` must outlive the parsing. A number beyond its range, a word
/// that is no choice and, where `read` is there, a text that it cannot read are errors of the command line.
void declare_slice_parameters(VerbOptions& options, SliceParameters& into, std::span<const std::string_view> keys,
                              const ReadText& read);
/// The same for every row: what may be asked of a job. The scan site reads the texts.
void declare_job_parameters(VerbOptions& options, SliceParameters& into);

}  // namespace telefab
