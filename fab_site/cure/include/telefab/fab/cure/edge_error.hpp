// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <span>
#include <telefab/fab/cure/dose_field.hpp>
#include <telefab/geometry/contour.hpp>

namespace telefab::fab {

/// Distances of edges in pixels, summed so that layers and shapes add up. Signed: positive is cured beyond the target.
class DistanceTally {
 public:
  static constexpr double kMost_px = 3;  ///< what is farther counts as this in percentiles

  void add(double signed_px, double weight = 1);
  void add(const DistanceTally& other);
  [[nodiscard]] double count() const { return count_; }
  /// Of the sizes without their signs; 0 where nothing was added.
  [[nodiscard]] double mean_px() const { return count_ > 0 ? sum_ / count_ : 0; }
  [[nodiscard]] double bias_px() const { return count_ > 0 ? signed_sum_ / count_ : 0; }
  [[nodiscard]] double rms_px() const;
  [[nodiscard]] double max_px() const { return max_; }
  /// The size that a share (0 to 1) of all stays within, to 1/256 px.
  [[nodiscard]] double percentile_px(double share) const;

 private:
  static constexpr std::size_t kBins = 768;
  double count_ = 0;
  double sum_ = 0;
  double signed_sum_ = 0;
  double square_sum_ = 0;
  double max_ = 0;
  std::array<double, kBins> bins_{};
};

struct EdgeOptions {
  double sample_px = 0.5;      ///< distance of samples along the contour, 0.05 to 10
  double lost_px = 1.5;        ///< an edge not found within this is lost and counts as this
  double corner_rad = 0.5236;  ///< vertices that turn by more (30 degrees) are corners
  double corner_px = 2;        ///< within this of a corner an edge is not smooth
  int sub_pixels = 4;          ///< 1 to 16; how finely areas and the cured edge are walked
  [[nodiscard]] Result<void> validate() const;
};

/// How the region that reaches a dose compares with the contours it was meant to fill.
struct EdgeFigures {
  DistanceTally edges;    ///< from every sample of the contours along its normal to the cured edge
  DistanceTally smooth;   ///< of these, the ones away from corners
  DistanceTally corners;  ///< from every corner along its bisector, at most kMost_px
  DistanceTally cured;    ///< from every point of the cured edge to the nearest contour, unsigned
  double lost = 0;        ///< samples without a cured edge in reach
  double latitude_sum = 0;
  double target_px2 = 0;   ///< inside the contours
  double cured_px2 = 0;    ///< reaches the dose
  double excess_px2 = 0;   ///< cured outside the contours
  double missing_px2 = 0;  ///< not cured inside them
  double far_px2 = 0;      ///< of both, what lies farther than a pixel from every contour: islands and voids

  void add(const EdgeFigures& other);
  [[nodiscard]] double lost_share() const { return edges.count() > 0 ? lost / edges.count() : 0; }
  /// How far the edge moves for one per cent of dose, mean over the edges found, pixels.
  [[nodiscard]] double latitude_px() const;
};

/// One contour sample and its edge, for pictures.
struct EdgeSample {
  PixelPlace place;
  double error_px = 0;
};

/// What a layer is meant to be. Rings in millimetres of the build frame, on the mask's pixels.
struct EdgeTarget {
  std::span<const Contour> rings;   ///< judged
  std::span<const Contour> joined;  ///< lit as well, e.g. supports: edges in or near them are not judged, areas count
};

/// `threshold`: the dose that counts as cured, e.g. model.to_middle() for the middle of a layer. Rings in millimetres
/// of the build frame, on the mask's pixels. `samples`, if given, receives every contour sample in order. Fails with
/// InvalidInput for options out of range. Same figures on any number of threads.
[[nodiscard]] Result<EdgeFigures> measure_edges(const DoseField& dose, double threshold, const EdgeTarget& target,
                                                double pixel_pitch_mm, const EdgeOptions& options,
                                                std::vector<EdgeSample>* samples = nullptr);

}  // namespace telefab::fab
