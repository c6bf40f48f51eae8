// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <telefab/scan/mls/scalar_field.hpp>
#include <telefab/scan/mls/surface_samples.hpp>
#include <vector>

namespace telefab::scan {

/// Which zero set stands for the scanned surface; formulas in README.md.
enum class SurfaceKind : std::uint8_t {
  Unbiased = 1,      ///< mean of both plane distances, curvature corrected: no shrinking, no swelling
  Paper = 2,         ///< the paper's g with weights normalised to sum 1
  PaperLiteral = 3,  ///< the paper's g with plain weights; has a spurious branch at one kernel width
  Imls = 4,          ///< weighted mean of the samples' own plane distances; swells by h^2 / 2R
};
/// "unbiased", "paper", "paper-literal", "imls"; InvalidInput lists them.
[[nodiscard]] Result<SurfaceKind> surface_kind_from(std::string_view name);
[[nodiscard]] std::string_view name_of(SurfaceKind kind);

struct MlsOptions {
  SurfaceKind surface = SurfaceKind::Unbiased;
  std::optional<double> kernel_mm;  ///< (0, 1000]; one width h everywhere. None: from local spacing and noise
  bool drop_outliers = true;        ///< samples that no surface of their neighbours explains are left out
  [[nodiscard]] Result<void> validate() const;
};

/// A sample that nobody measured, on the surface continued across a gap of the scan.
struct GapSample {
  Vec3 point_mm = Vec3::Zero();
  Vec3 normal = Vec3::Zero();
  double spacing_mm = 0;  ///< > 0; of such samples about it
};

/// How the kernel was chosen; for the report.
struct KernelChoice {
  double spacing_mm = 0;            ///< median distance s of neighbouring samples
  double unevenness = 1;            ///< 99 % over 1 % of the local spacing
  double noise_mm = 0;              ///< robust rms of the samples about their surface
  double noise_factor = 1;          ///< kernel width over spacing that the noise alone asks for
  double kernel_mm = 0;             ///< median width h
  bool adaptive = false;            ///< one width a sample
  std::size_t dropped_samples = 0;  ///< outliers
};

/// The moving-least-squares field of an oriented cloud. Its value at a point is a pure function of the point: who
/// asked what before, on which thread, changes no bit.
class MlsField final : public ScalarField {
 public:
  /// `placed` is in the build frame, millimetres, with normals. Fails: InvalidInput (no normals, fewer than 4
  /// samples, options), TooLarge (more than 2^31 samples), Cancelled.
  [[nodiscard]] static Result<std::unique_ptr<MlsField>> from_cloud(PointCloud placed, const MlsOptions& options,
                                                                    std::stop_token stop);
  ~MlsField() override;
  /// The field of the same samples with kernels `factor` times as wide, factor > 0. Copies the samples.
  [[nodiscard]] std::unique_ptr<MlsField> with_scaled_kernel(double factor) const;
  /// The field of the same samples and of others in its gaps, whose kernels follow their own spacing. How the kernel
  /// was chosen stays as the measured samples alone say. Copies the samples.
  [[nodiscard]] std::unique_ptr<MlsField> completed_by(std::span<const GapSample> others) const;

  [[nodiscard]] std::unique_ptr<FieldCursor> cursor() const override;
  [[nodiscard]] Box3 bounds() const override;
  [[nodiscard]] double kernel_width_mm(const Vec3& point_mm) const override;

  [[nodiscard]] const KernelChoice& kernel() const;
  [[nodiscard]] std::size_t sample_count() const;
  [[nodiscard]] double widest_kernel_mm() const;
  /// Samples with low <= z <= high, rising in z; replaces what `found` held.
  void samples_between(double low_mm, double high_mm, SurfaceSamples& found) const;
  /// Samples with |n_z| >= least_nz, rising in z; replaces what `found` held.
  void level_samples(double least_nz, SurfaceSamples& found) const;

 private:
  struct Parts;
  explicit MlsField(std::unique_ptr<const Parts> parts);
  void rising_samples(double low_mm, double high_mm, double least_nz, SurfaceSamples& found) const;
  std::unique_ptr<const Parts> parts_;
};

}  // namespace telefab::scan
