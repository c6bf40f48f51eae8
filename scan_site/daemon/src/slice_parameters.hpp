// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

/// What a client asked for, checked.
struct JobParameters {
  SliceRequest slice;
  CodecOptions codec;
};

/// Reads the JSON object that came with a scan: height_mm, scale, fit, layer_mm, method, surface, coding; all may be
/// missing. InvalidInput names the key.
[[nodiscard]] Result<JobParameters> job_parameters_from(std::string_view json, const MachineProfile& machine);

}  // namespace telefab::scan
