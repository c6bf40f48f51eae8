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

}  // namespace telefab::scan
