// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// A closed surface to be looked at: triangles over points.
struct DigitizeModel {
  std::vector<Vec3> points;                             ///< mm
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< corners counter-clockwise seen from outside
};

struct DigitizeOptions {
  double step_deg = 60;      ///< (0, 360]; turn of the table between views
  std::uint32_t views = 0;   ///< 0 = as many as make a whole turn
  double pitch_mm = 0.5;     ///< > 0; distance of neighbouring cells of the range image
  double tilt_deg = 20;      ///< [-80, 80]; how far the scanner looks down on the table
  double noise_mm = 0;       ///< >= 0; sigma along the line of sight
  double outlier_share = 0;  ///< [0, 0.5); share of points with a random depth
  double mixed_share = 0;    ///< [0, 1]; share of cells at depth edges whose depth is between the two surfaces
  double grazing_deg = 80;   ///< (0, 90]; a surface seen at a larger angle from its normal returns nothing
  std::uint64_t seed = 1;    ///< same seed, same model, same images
  [[nodiscard]] Result<void> validate() const;
};

/// One virtual range image. Points in the scanner's frame (x right, y up, z towards the scanner), mm.
struct VirtualView {
  std::vector<Eigen::Vector3f> points;
  RangeView view;
  Eigen::Isometry3d scanner_to_model = Eigen::Isometry3d::Identity();
};

/// Range images of a model on a turntable (axis z through the middle of its box) by parallel projection: nearest
/// surface of every cell, grazing drop-out, noise, outliers, mixed pixels. Fails: InvalidInput, TooLarge (an image
/// above 64 million cells), Cancelled.
[[nodiscard]] Result<std::vector<VirtualView>> digitize(const DigitizeModel& model, const DigitizeOptions& options,
                                                        std::stop_token stop);

}  // namespace telefab::scan
