// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/scan/slicing/prepare_scan.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/scan/staging/cloud_picture.hpp>

namespace telefab::scan {

/// A scan file as it lies there, before anything is decided: what is seen first.
struct RawScan {
  CloudPicture picture;
  std::string facts_json;  ///< one object: format, points, box, unit_mm or null, unit_is_open (a size that is hardly
                           ///< meant, and no unit stated), notes
};

/// Reads a file and makes its first picture. Fails as read_scan_file does.
[[nodiscard]] Result<RawScan> raw_scan(std::span<const std::byte> file, std::string_view name, std::stop_token stop);

/// A scan as slicing would take it: the object picked, its normals outward, its surface surveyed.
struct StagedScan {
  PreparedScan prepared;   ///< frame and unit of the file
  Openness open;           ///< frame of the file, square units of it
  CloudPicture picture;    ///< measured, completed, doubtful and left out
  std::string facts_json;  ///< one object: points, pieces, strays, gaps, warnings, ...
};

/// Prepares a scan as the request's intake, completion and surface say; how it is placed does not matter. Fails as
/// prepare_scan and survey_surface do.
[[nodiscard]] Result<StagedScan> staged_scan(std::span<const std::byte> file, std::string_view name,
                                             const SliceRequest& request, const ProgressSink& progress,
                                             std::stop_token stop);

}  // namespace telefab::scan
