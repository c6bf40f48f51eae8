// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/scan/cloud/kd_tree.hpp>
#include <telefab/scan/completion/complete_cloud.hpp>
#include <telefab/scan/completion/winding_tree.hpp>
#include <telefab/scan/mls/mls_field.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

/// A scan with its gaps closed: what is measured, what is not, and which side of it all is solid. Immutable; const
/// methods from any thread.
class CompletedScan {
 public:
  /// Closes the gaps of the cleaned samples of `measured` as `request` says. Fails: Cancelled.
  [[nodiscard]] static Result<std::unique_ptr<CompletedScan>> of(const MlsField& measured, const SliceRequest& request,
                                                                 const ProgressSink& progress, std::stop_token stop);

  [[nodiscard]] const Completion& completion() const { return completion_; }
  /// The virtual samples as the field takes them.
  [[nodiscard]] std::vector<GapSample> gap_samples() const;
  /// In the frame of `measured`.
  [[nodiscard]] Openness openness() const;
  [[nodiscard]] CompletionSummary summary() const;
  /// Whether so little of the surface is missing that closing it is right; for a scan that is placed. Fails:
  /// InvalidInput, says what to do.
  [[nodiscard]] Result<void> check(const SliceRequest& request) const;
  /// About what was closed, and what could not be; for people. For a scan that is placed.
  [[nodiscard]] std::vector<std::string> warnings(const SliceRequest& request) const;
  /// Those that hold however it is turned.
  [[nodiscard]] std::vector<std::string> gap_warnings(const SliceRequest& request) const;

  /// How far the place is from the nearest sample, and whether the solid is there: where samples surround a place their
  /// winding number tells, however far they are.
  struct Side {
    double distance_mm = 0;
    double winding = 0;
  };
  [[nodiscard]] Side side_of(const Vec3& place_mm) const;
  [[nodiscard]] double winding_at(const Vec3& place_mm) const;

  /// Air between two pieces of completed surface that may be one: whether the object is joined there nobody measured.
  struct Passage {
    Vec3 low_mm, high_mm;  ///< on either piece; the lower first
  };
  [[nodiscard]] std::vector<Passage> passages() const;

  /// Whether a measured sample lies within a kernel width of `field`.
  [[nodiscard]] bool is_measured(const Vec3& place_mm, const ScalarField& field) const;
  /// How far the surface may lie from this place of it (19 cases of 20): 0 where it is measured.
  [[nodiscard]] double error_at(const Vec3& place_mm, const ScalarField& field) const;
  /// Whether both sides of a place of the surface are what they should be; `outward`: its normal.
  [[nodiscard]] bool sides_agree(const Vec3& place_mm, const Eigen::Vector3f& outward) const;
  /// What every edge of a contour of `field` rests on: measured where a measured sample lies within a kernel width, or
  /// is the nearest and within two; else completed; doubtful where the winding number of all samples tells inside and
  /// outside otherwise.
  [[nodiscard]] std::vector<SurfaceRun> surface_of(const Contour& contour, double z_mm, const ScalarField& field) const;

 private:
  CompletedScan(PointCloud measured, Completion completion);
  [[nodiscard]] Eigen::Vector3f local(const Vec3& place_mm) const { return (place_mm - origin_).cast<float>(); }
  /// `beside`: a measured sample that may be near, to be asked first; the nearest one where another had to be found.
  [[nodiscard]] SurfaceRun rests_on(const Vec3& place_mm, const ScalarField& field,
                                    std::optional<std::uint32_t>& beside) const;

  Vec3 origin_;
  std::size_t measured_count_;
  Completion completion_;
  std::vector<Eigen::Vector3f> normals_;  ///< measured, then virtual
  std::vector<float> areas_;
  Vec3 missing_mm2_ = Vec3::Zero();
  double seen_mm2_ = 0;
  std::unique_ptr<KdTree> near_;           ///< all samples
  std::unique_ptr<KdTree> near_measured_;  ///< null where all are measured
  std::unique_ptr<WindingTree> tree_;      ///< all samples
};

}  // namespace telefab::scan
