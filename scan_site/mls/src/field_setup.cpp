// SPDX-License-Identifier: GPL-3.0-or-later
#include "field_setup.hpp"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <memory>

#include "sampling.hpp"

namespace telefab::scan {
namespace {

KernelForm form_of(SurfaceKind kind) {
  switch (kind) {
    case SurfaceKind::Paper:
      return KernelForm::Paper;
    case SurfaceKind::PaperLiteral:
      return KernelForm::PaperLiteral;
    case SurfaceKind::Imls:
      return KernelForm::Imls;
    case SurfaceKind::Unbiased:
      break;
  }
  return KernelForm::Unbiased;
}

/// Side of a grid cell in spacings: smaller ones have short runs, larger ones hold samples out of reach.
constexpr double kCellSpacings = 3;
/// Unevenness below which one width serves all.
constexpr double kEven = 1.3;
/// Widths stay within these factors of the median one.
constexpr double kNarrowest = 0.25;
constexpr double kWidest = 16;
/// Kernel width over spacing, at least, of samples in a gap: they lie on a grid, but one a cell.
constexpr double kGapFactor = 1.2;
/// Widths of one band differ by no more than this factor. In gaps lie so few samples that looking into a band costs
/// more than passing over some of them.
constexpr double kBandFactor = 2.2;
constexpr double kGapBandFactor = 5;
/// Kernel width over spacing while noise is measured and outliers are sought.
constexpr double kTrialFactor = 2;

/// Parts the samples into bands of a factor in spacing, which becomes their width.
std::vector<SampleGrid> bands_of(SampleGrid grid, std::vector<float> spacing, double factor) {
  const auto [least, most] = std::minmax_element(spacing.begin(), spacing.end());
  const auto band_of = [first = *least, factor](float s) {
    return static_cast<std::size_t>(std::max(0.0, std::log(s / first) / std::log(factor)));
  };
  std::vector<SampleGrid> bands;
  if (band_of(*most) == 0) {
    grid.set_widths(spacing);
    bands.push_back(std::move(grid));
    return bands;
  }
  struct Part {
    std::vector<Eigen::Vector3f> points, normals;
    std::vector<float> widths;
  };
  std::vector<Part> parts(band_of(*most) + 1);
  std::vector<std::size_t> counts(parts.size(), 0);
  for (const float s : spacing) ++counts[band_of(s)];
  for (std::size_t b = 0; b < parts.size(); ++b) {
    parts[b].points.reserve(counts[b]);
    parts[b].normals.reserve(counts[b]);
    parts[b].widths.reserve(counts[b]);
  }
  for (std::uint32_t i = 0; i < grid.size(); ++i) {
    Part& part = parts[band_of(spacing[i])];
    part.points.push_back(grid.place(i));
    part.normals.push_back(grid.normal(i));
    part.widths.push_back(spacing[i]);
  }
  grid = {};
  std::vector<float>{}.swap(spacing);
  for (Part& part : parts) {
    if (part.points.empty()) continue;
    const float widest = *std::max_element(part.widths.begin(), part.widths.end());
    bands.emplace_back(std::move(part.points), std::move(part.normals), part.widths, kCellSpacings * widest);
    std::vector<float>{}.swap(part.widths);
  }
  return bands;
}

/// As many gathered cells as fit about eight megabytes: then the layers of a block share them.
std::size_t slots_for(double spacing_mm, double reference_mm) {
  constexpr double kBytes = 8e6;
  constexpr double kReachWidths = 4.9;
  const double neighbours = 3.14159 * std::pow(kReachWidths * reference_mm / spacing_mm, 2) + 16;
  std::size_t slots = 64;
  while (slots < 4096 && 2 * static_cast<double>(slots) * neighbours * 7 * sizeof(float) < kBytes) slots *= 2;
  return slots;
}

/// Widths are `factor` times what the bands hold: spacings.
void scale_field(FieldParts& parts, double factor, const KernelChoice& choice) {
  const double reference = factor * choice.spacing_mm;
  for (SampleGrid& band : parts.bands) band.scale_widths(static_cast<float>(factor));
  parts.slots = slots_for(choice.spacing_mm, reference);
  parts.scale =
      choice.adaptive || parts.gap_bands > 0 ? ScaleTable{parts.bands, parts.origin, reference} : ScaleTable{reference};
}

/// Kernel width over spacing for a noise given in spacings. The unbiased surface wants it narrow: 0.9 on clean scans
/// (measured on scanned meshes; 0.8 tears holes at uneven places), wider where noise has to be averaged out.
double width_factor(double noise) {
  if (noise < 0.1) return std::max(0.9, 0.9 + 10 * (noise - 0.03));
  return std::min(4.5, 1.6 + 6 * (noise - 0.1));
}

/// Samples whose nearest other is nearer than the first, in spacings, lie irregularly, at the second as if at random:
/// their voids are wider, and a kernel that spans them is that much wider (decision 0405).
constexpr double kRegular = 0.75;
constexpr double kRandom = 0.5;
constexpr double kRandomFactor = 1.25;
double irregular_factor(const Evenness& even) {
  if (even.rows) return 0;
  return kRandomFactor * std::clamp((kRegular - even.nearest) / (kRegular - kRandom), 0.0, 1.0);
}

/// Robust rms of the samples' distance to the surface.
double noise_mm(const FieldParts& parts) {
  MlsCursor cursor{parts};
  std::vector<double> off;
  for (const SampleGrid& band : parts.bands) {
    const std::uint32_t step = std::max<std::uint32_t>(1, band.size() / 2000);
    for (std::uint32_t i = step / 2; i < band.size(); i += step)
      off.push_back(std::abs(cursor.at(parts.origin + band.place(i).cast<double>()).value_mm));
  }
  // The best quarter decides: on a machined part most samples may lie at edges, which no smooth surface follows.
  std::nth_element(off.begin(), off.begin() + off.size() / 4, off.end());
  return off[off.size() / 4] / 0.3186;
}

/// An outlier at a kernel of two spacings: others weigh less than this (12 on an even surface),
constexpr double kLeastOthers = 0.7;
/// its distance to their planes is more widths than this (and more than four times the noise),
constexpr double kFarthest = 0.6;
/// or its normal and the surface's agree by less.
constexpr double kLeastAgreement = -0.3;

/// Keeps the samples that their neighbours explain: enough weight of others, no opposed normals, near the surface.
void drop_outliers(FieldParts& parts, double noise_mm) {
  std::vector<std::vector<std::uint8_t>> keep;
  tbb::enumerable_thread_specific<std::unique_ptr<MlsCursor>> cursors(
      [&] { return std::make_unique<MlsCursor>(parts); });
  for (const SampleGrid& band : parts.bands) {
    std::vector<std::uint8_t>& flags = keep.emplace_back(band.size());
    tbb::parallel_for(tbb::blocked_range<std::uint32_t>{0, band.size(), 2048}, [&](const auto& range) {
      MlsCursor& cursor = *cursors.local();
      for (std::uint32_t i = range.begin(); i < range.end(); ++i) {
        const GridSample s = band.sample(i);
        const KernelOutput out = cursor.raw(parts.origin + s.place.cast<double>());
        const double others = out.weight - 1;
        const double reference = parts.scale.reference_mm();
        // Its own plane passes through itself: the others' mean distance is larger by weight / others.
        const double distance_mm = reference * std::abs(out.closeness) * out.weight / std::max(others, 1e-9);
        const double along =
            out.gradient[0] * s.normal.x() + out.gradient[1] * s.normal.y() + out.gradient[2] * s.normal.z();
        flags[i] = others > kLeastOthers && distance_mm < std::max(kFarthest * s.width, 4 * noise_mm) &&
                   along > kLeastAgreement;
      }
    });
  }
  for (std::size_t b = 0; b < keep.size(); ++b) parts.bands[b].keep(keep[b]);
  std::erase_if(parts.bands, [](const SampleGrid& band) { return band.size() == 0; });
}

std::size_t size_of(const FieldParts& parts) {
  std::size_t count = 0;
  for (const SampleGrid& band : parts.bands) count += band.size();
  return count;
}

Box3 bounds_of(const FieldParts& parts) {
  Eigen::Vector3f low = Eigen::Vector3f::Constant(1e30F);
  Eigen::Vector3f high = -low;
  float widest = 0;
  for (const SampleGrid& band : parts.bands) {
    widest = std::max(widest, band.widest_mm());
    for (std::uint32_t i = 0; i < band.size(); ++i) {
      const Eigen::Vector3f p = band.place(i);
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
  }
  // Nothing beyond the cut radius of a sample is in reach.
  const Vec3 reach = Vec3::Constant(3.2 * widest);
  return {parts.origin + low.cast<double>() - reach, parts.origin + high.cast<double>() + reach};
}

}  // namespace

Result<FieldSetup> set_up_field(PointCloud placed, const MlsOptions& options, std::stop_token stop) {
  if (placed.size() < 4)
    return fail(ErrorCode::InvalidInput,
                fmt::format("a surface needs at least 4 points, the scan has {}", placed.size()));
  if (placed.normals.size() != placed.points.size())
    return fail(ErrorCode::InvalidInput, "the scan has no normals; estimate and orient them first");
  if (placed.size() > (std::size_t{1} << 31U)) return fail(ErrorCode::TooLarge, "more than 2^31 points");
  for (std::size_t i = 0; i < placed.size(); ++i)
    if (!placed.points[i].allFinite() || !placed.normals[i].allFinite())
      return fail(ErrorCode::InvalidInput, fmt::format("point {} of the scan is not finite", i));

  FieldSetup setup;
  KernelChoice& choice = setup.choice;
  FieldParts& parts = setup.field;
  parts.origin = placed.origin;
  parts.kernels = fastest_kernels();
  std::vector<float>{}.swap(placed.confidence);
  std::vector<float>{}.swap(placed.sheets_apart);
  const float guess = spacing_from_box(placed.points);
  SampleGrid grid{std::move(placed.points), std::move(placed.normals), {}, kCellSpacings * guess};
  const Evenness even = measure_evenness(grid, guess);
  if (even.spacing_mm < 0.6 * guess || even.spacing_mm > 1.6 * guess)
    grid = std::move(grid).with_cells(kCellSpacings * even.spacing_mm);
  if (stop.stop_requested()) return cancelled("setting up the surface");
  choice.spacing_mm = even.spacing_mm;
  choice.unevenness = even.unevenness;
  choice.adaptive = !options.kernel_mm && (even.unevenness > kEven || even.rows);
  if (choice.adaptive) {
    auto spacing = smooth_spacing(grid, static_cast<float>(even.spacing_mm), even.rows, stop);
    if (!spacing) return tl::unexpected{spacing.error()};
    for (float& s : *spacing)
      s = std::clamp(s, static_cast<float>(kNarrowest * even.spacing_mm),
                     static_cast<float>(kWidest * even.spacing_mm));
    parts.bands = bands_of(std::move(grid), std::move(*spacing), kBandFactor);
  } else {
    grid.set_width(static_cast<float>(even.spacing_mm));
    parts.bands.push_back(std::move(grid));
  }

  const double trial = options.kernel_mm ? *options.kernel_mm / even.spacing_mm : kTrialFactor;
  scale_field(parts, trial, choice);
  choice.noise_mm = noise_mm(parts);
  if (stop.stop_requested()) return cancelled("setting up the surface");
  if (options.drop_outliers) {
    const std::size_t before = size_of(parts);
    drop_outliers(parts, choice.noise_mm);
    choice.dropped_samples = before - size_of(parts);
    if (size_of(parts) < 4)
      return fail(ErrorCode::InvalidInput, "the points of the scan do not lie on a common surface");
  }
  choice.noise_factor = width_factor(choice.noise_mm / even.spacing_mm);
  const double factor = options.kernel_mm ? trial : std::max(choice.noise_factor, irregular_factor(even));
  for (SampleGrid& band : parts.bands) band.scale_widths(static_cast<float>(1 / trial));
  scale_field(parts, factor, choice);
  choice.kernel_mm = factor * even.spacing_mm;
  parts.form = form_of(options.surface);
  setup.bounds = bounds_of(parts);
  return setup;
}

FieldSetup completed_by(const FieldSetup& setup, std::span<const GapSample> others) {
  FieldSetup completed = setup;
  if (others.empty()) return completed;
  FieldParts& parts = completed.field;
  const double factor = std::max(kGapFactor, setup.choice.kernel_mm / setup.choice.spacing_mm);
  std::vector<Eigen::Vector3f> points, normals;
  std::vector<float> widths;
  for (const GapSample& s : others) {
    points.push_back((s.point_mm - parts.origin).cast<float>());
    normals.push_back(s.normal.cast<float>());
    widths.push_back(static_cast<float>(factor * s.spacing_mm));
  }
  const auto widest = static_cast<double>(*std::max_element(widths.begin(), widths.end()));
  SampleGrid grid{std::move(points), std::move(normals), widths, kCellSpacings * widest / factor};
  widths.resize(grid.size());
  for (std::uint32_t i = 0; i < grid.size(); ++i) widths[i] = grid.width(i);
  std::vector<SampleGrid> bands = bands_of(std::move(grid), std::move(widths), kGapBandFactor);
  parts.gap_bands = bands.size();
  for (SampleGrid& band : bands) parts.bands.push_back(std::move(band));
  parts.scale = ScaleTable{parts.bands, parts.origin, parts.scale.reference_mm()};
  completed.bounds = bounds_of(parts);
  return completed;
}

FieldSetup with_scaled_kernel(const FieldSetup& setup, double factor) {
  FieldSetup wider = setup;
  const double spacings = setup.choice.kernel_mm / setup.choice.spacing_mm;
  for (SampleGrid& band : wider.field.bands) band.scale_widths(static_cast<float>(1 / spacings));
  scale_field(wider.field, factor * spacings, setup.choice);
  wider.choice.kernel_mm = factor * setup.choice.kernel_mm;
  wider.bounds = bounds_of(wider.field);
  return wider;
}

}  // namespace telefab::scan
