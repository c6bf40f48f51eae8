// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/codec/stack_codec.hpp>
#include <telefab/job/slice_parameters.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

/// What was asked for, checked, with what has to fit together.
struct JobParameters {
  SliceRequest slice;
  CodecOptions codec;
};

/// Whether contours are coded: then the chords leave room for the error of the coding.
enum class Contours : std::uint8_t { Coded = 1, Plain = 2 };

/// Fails with InvalidInput, naming the key, as validate of parameters, request and codec do.
[[nodiscard]] Result<JobParameters> job_parameters_of(const SliceParameters& asked, const MachineProfile& machine,
                                                      Contours contours = Contours::Coded);
/// The same of the JSON object that came with a job.
[[nodiscard]] Result<JobParameters> job_parameters_from(std::string_view json, const MachineProfile& machine);

/// Whether the text of one row of slice_parameter_table() that has a form can be read, whatever the machine.
/// InvalidInput says what is wrong with it.
[[nodiscard]] Result<void> check_text(const SliceParameter& row, const std::string& text);

}  // namespace telefab::scan
