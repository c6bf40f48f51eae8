// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/scan/mls/mls_field.hpp>
#include <telefab/scan/slicing/placement.hpp>
#include <telefab/scan/slicing/prepare_scan.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <vector>

namespace telefab::scan {

/// A place where the scan shows two sheets and not one surface.
struct DoubledPlace {
  Vec3 at_mm;  ///< build frame
  double apart_mm = 0;
};

/// A scan on the platform and the surface its samples carry.
struct PlacedSurface {
  PreparedScan prepared;                 ///< without its cloud
  std::optional<ChosenStanding> chosen;  ///< where the request let it be
  Placement placed;                      ///< its cloud has no points: the field holds them
  std::unique_ptr<MlsField> field;
  std::vector<DoubledPlace> doubled;  ///< from below
};

/// Prepares, places and sets up the field. Points that the field drops as outliers do not count for the size either:
/// where they set the box, the scan is placed once more without what lies beyond the samples. Fails as prepare_scan,
/// place_on_platform and MlsField::from_cloud do.
[[nodiscard]] Result<PlacedSurface> surface_of(std::span<const std::byte> scan, std::string_view name,
                                               const IntakeOptions& intake, const SliceRequest& request,
                                               const ProgressSink& progress, StageClock& clock, std::stop_token stop);

}  // namespace telefab::scan
