#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <telefab/scan/mls/mls_field.hpp>

#include "mls_cursor.hpp"
#include "sampling.hpp"

namespace telefab::scan {
namespace {

constexpr std::array kKinds{std::pair{SurfaceKind::Unbiased, "unbiased"}, std::pair{SurfaceKind::Paper, "paper"},
                            std::pair{SurfaceKind::PaperLiteral, "paper-literal"},
                            std::pair{SurfaceKind::Imls, "imls"}};

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

/// A grid cell of 1.2 cut radii: finer ones lose by short rows where kernels are narrow.
double cell_for(double width_mm) { return 1.2 * std::sqrt(static_cast<double>(kCut)) * width_mm; }

/// Unevenness below which one width serves all.
constexpr double kEven = 1.3;
/// Widths stay within these factors of the median one.
constexpr double kNarrowest = 0.25;
constexpr double kWidest = 4;

/// Bands of a factor 2.2 in width; the even cloud has one.
std::vector<WidthBand> bands_of(const std::vector<GridSample>& samples, const Vec3& origin) {
  float least = samples[0].width;
  for (const GridSample& s : samples) least = std::min(least, s.width);
  std::vector<std::vector<GridSample>> split;
  for (const GridSample& s : samples) {
    const auto band = static_cast<std::size_t>(std::max(0.0, std::log(s.width / least) / std::log(2.2)));
    if (split.size() <= band) split.resize(band + 1);
    split[band].push_back(s);
  }
  std::vector<WidthBand> bands;
  for (auto& part : split) {
    if (part.empty()) continue;
    float widest = 0;
    for (const GridSample& s : part) widest = std::max(widest, s.width);
    bands.push_back({SampleGrid{std::move(part), origin, cell_for(widest)}, widest});
  }
  return bands;
}

/// As many gathered cells as fit about two megabytes: then the layers of a block share them.
std::size_t slots_for(const std::vector<GridSample>& samples, double reference_mm) {
  constexpr double kBytes = 2e6;
  constexpr double kReachWidths = 4.5;
  const double spacing_mm = spacing_from_box(samples);
  const double neighbours = 3.14159 * std::pow(kReachWidths * reference_mm / spacing_mm, 2) + 16;
  std::size_t slots = 64;
  while (slots < 4096 && 2 * static_cast<double>(slots) * neighbours * sizeof(GridSample) < kBytes) slots *= 2;
  return slots;
}

FieldParts parts_for(std::vector<GridSample> samples, const Vec3& origin, double reference_mm, bool adaptive,
                     KernelForm form) {
  FieldParts parts;
  parts.origin = origin;
  parts.form = form;
  parts.kernel = fastest_kernel();
  parts.slots = slots_for(samples, reference_mm);
  parts.scale = adaptive ? ScaleTable{samples, origin, reference_mm} : ScaleTable{reference_mm};
  if (adaptive) {
    parts.bands = bands_of(samples, origin);
  } else {
    parts.bands.push_back(
        {SampleGrid{std::move(samples), origin, cell_for(reference_mm)}, static_cast<float>(reference_mm)});
  }
  return parts;
}

/// Kernel width over spacing for a noise given in spacings. The unbiased surface wants it narrow: 0.9 on clean scans
/// (measured on scanned meshes; 0.8 tears holes at uneven places), wider where noise has to be averaged out.
double width_factor(double noise) {
  if (noise < 0.1) return std::max(0.9, 0.9 + 10 * (noise - 0.03));
  return std::min(4.5, 1.6 + 6 * (noise - 0.1));
}

/// Robust rms of the samples' distance to the surface.
double noise_mm(const FieldParts& parts) {
  MlsCursor cursor{parts};
  std::vector<double> off;
  for (const WidthBand& band : parts.bands) {
    const auto& samples = band.grid.samples();
    const std::size_t step = std::max<std::size_t>(1, samples.size() / 2000);
    for (std::size_t i = step / 2; i < samples.size(); i += step) {
      const GridSample& s = samples[i];
      off.push_back(std::abs(cursor.at(parts.origin + Vec3{s.x, s.y, s.z}).value_mm));
    }
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
std::vector<GridSample> without_outliers(const FieldParts& parts, double noise_mm) {
  std::vector<GridSample> kept;
  for (const WidthBand& band : parts.bands) {
    const auto& samples = band.grid.samples();
    std::vector<std::uint8_t> keep(samples.size());
    tbb::parallel_for(tbb::blocked_range<std::size_t>{0, samples.size(), 2048}, [&](const auto& range) {
      MlsCursor cursor{parts};
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        const GridSample& s = samples[i];
        const KernelOutput out = cursor.raw(parts.origin + Vec3{s.x, s.y, s.z});
        const double others = out.weight - 1;
        const double reference = parts.scale.reference_mm();
        // Its own plane passes through itself: the others' mean distance is larger by weight / others.
        const double distance_mm = reference * std::abs(out.closeness) * out.weight / std::max(others, 1e-9);
        const double along = out.gradient[0] * s.nx + out.gradient[1] * s.ny + out.gradient[2] * s.nz;
        keep[i] = others > kLeastOthers && distance_mm < std::max(kFarthest * s.width, 4 * noise_mm) &&
                  along > kLeastAgreement;
      }
    });
    for (std::size_t i = 0; i < samples.size(); ++i)
      if (keep[i]) kept.push_back(samples[i]);
  }
  return kept;
}

}  // namespace

Result<SurfaceKind> surface_kind_from(std::string_view name) {
  for (const auto& [kind, text] : kKinds)
    if (name == text) return kind;
  return fail(ErrorCode::InvalidInput,
              fmt::format("no surface named \"{}\"; there are unbiased, paper, paper-literal, imls", name));
}

std::string_view name_of(SurfaceKind kind) {
  for (const auto& [known, text] : kKinds)
    if (known == kind) return text;
  return "unknown";
}

Result<void> MlsOptions::validate() const {
  if (kernel_mm && !(*kernel_mm > 0 && *kernel_mm <= 1000))
    return fail(ErrorCode::InvalidInput, fmt::format("kernel width {} mm is not in (0, 1000]", *kernel_mm));
  return {};
}

struct MlsField::Parts {
  FieldParts field;
  KernelChoice choice;
  Box3 bounds;
  std::size_t samples = 0;
  struct Place {
    float z;
    std::uint32_t band;
    std::uint32_t index;
  };
  std::vector<Place> rising;  ///< samples by z
};

MlsField::MlsField(std::unique_ptr<const Parts> parts) : parts_{std::move(parts)} {}
MlsField::~MlsField() = default;

Result<std::unique_ptr<MlsField>> MlsField::from_cloud(PointCloud placed, const MlsOptions& options,
                                                       std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (placed.size() < 4)
    return fail(ErrorCode::InvalidInput,
                fmt::format("a surface needs at least 4 points, the scan has {}", placed.size()));
  if (placed.normals.size() != placed.points.size())
    return fail(ErrorCode::InvalidInput, "the scan has no normals; estimate and orient them first");
  if (placed.size() > (std::size_t{1} << 31U)) return fail(ErrorCode::TooLarge, "more than 2^31 points");

  std::vector<GridSample> samples(placed.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const auto& p = placed.points[i];
    const auto& n = placed.normals[i];
    if (!p.allFinite() || !n.allFinite())
      return fail(ErrorCode::InvalidInput, fmt::format("point {} of the scan is not finite", i));
    samples[i] = {p.x(), p.y(), p.z(), 0, n.x(), n.y(), n.z()};
  }
  const Vec3 origin = placed.origin;
  placed = {};

  KernelChoice choice;
  const auto cancelled = [] { return fail(ErrorCode::Cancelled, "cancelled while the surface was set up"); };
  const float guess = spacing_from_box(samples);
  SampleGrid grid{std::move(samples), origin, 2.4 * guess};
  Evenness even = measure_evenness(grid, guess);
  if (even.spacing_mm < 0.5 * guess || even.spacing_mm > 2 * guess) {
    std::vector<GridSample> again = grid.samples();
    grid = SampleGrid{std::move(again), origin, 2.4 * even.spacing_mm};
  }
  if (stop.stop_requested()) return cancelled();
  choice.spacing_mm = even.spacing_mm;
  choice.unevenness = even.unevenness;
  choice.adaptive = !options.kernel_mm && even.unevenness > kEven;
  samples = grid.samples();
  std::vector<float> spacing;
  if (choice.adaptive) {
    auto all = smooth_spacing(grid, static_cast<float>(even.spacing_mm), stop);
    if (!all) return tl::unexpected{all.error()};
    spacing = std::move(*all);
  }
  grid = SampleGrid{{}, origin, 1};

  const auto set_widths = [&](double factor) {
    for (std::size_t i = 0; i < samples.size(); ++i)
      samples[i].width =
          static_cast<float>(factor * (choice.adaptive ? std::clamp<double>(spacing[i], kNarrowest * even.spacing_mm,
                                                                            kWidest * even.spacing_mm)
                                                       : even.spacing_mm));
  };
  double factor = 2;
  if (options.kernel_mm) {
    factor = *options.kernel_mm / even.spacing_mm;
  }
  {
    set_widths(factor);
    const FieldParts trial =
        parts_for(samples, origin, factor * even.spacing_mm, choice.adaptive, KernelForm::Unbiased);
    choice.noise_mm = noise_mm(trial);
    if (stop.stop_requested()) return cancelled();
    if (!options.kernel_mm) {
      factor = width_factor(choice.noise_mm / even.spacing_mm);
    }
    if (options.drop_outliers) {
      // The trial's samples are sorted by band; spacing follows width.
      const std::size_t before = samples.size();
      samples = without_outliers(trial, choice.noise_mm);
      choice.dropped_samples = before - samples.size();
      if (samples.size() < 4)
        return fail(ErrorCode::InvalidInput, "the points of the scan do not lie on a common surface");
      for (GridSample& s : samples)
        s.width = static_cast<float>(s.width / (trial.scale.reference_mm() / even.spacing_mm) * factor);
    } else {
      set_widths(factor);
    }
  }
  choice.kernel_mm = factor * even.spacing_mm;

  auto parts = std::make_unique<Parts>();
  parts->choice = choice;
  parts->samples = samples.size();
  parts->field = parts_for(std::move(samples), origin, choice.kernel_mm, choice.adaptive, form_of(options.surface));
  Vec3 low = Vec3::Constant(1e30);
  Vec3 high = -low;
  parts->rising.reserve(parts->samples);
  for (std::uint32_t b = 0; b < parts->field.bands.size(); ++b) {
    const WidthBand& band = parts->field.bands[b];
    for (std::uint32_t i = 0; i < band.grid.samples().size(); ++i) {
      const GridSample& s = band.grid.samples()[i];
      low = low.cwiseMin(Vec3{s.x, s.y, s.z});
      high = high.cwiseMax(Vec3{s.x, s.y, s.z});
      parts->rising.push_back({s.z, b, i});
    }
  }
  tbb::parallel_sort(parts->rising.begin(), parts->rising.end(), [](const auto& a, const auto& b) {
    return a.z != b.z ? a.z < b.z : a.band != b.band ? a.band < b.band : a.index < b.index;
  });
  // Nothing beyond the cut radius of a sample is in reach.
  float widest = 0;
  for (const WidthBand& band : parts->field.bands) widest = std::max(widest, band.widest_mm);
  const Vec3 reach = Vec3::Constant(3.2 * widest);
  parts->bounds = {origin + low - reach, origin + high + reach};
  return std::unique_ptr<MlsField>{new MlsField{std::move(parts)}};
}

std::unique_ptr<FieldCursor> MlsField::cursor() const { return std::make_unique<MlsCursor>(parts_->field); }
Box3 MlsField::bounds() const { return parts_->bounds; }
double MlsField::kernel_width_mm(const Vec3& point_mm) const { return parts_->field.scale.width_mm(point_mm); }
const KernelChoice& MlsField::kernel() const { return parts_->choice; }
std::size_t MlsField::sample_count() const { return parts_->samples; }

void MlsField::samples_between(double low_mm, double high_mm, SurfaceSamples& found) const {
  found.points.clear();
  found.normals.clear();
  const double base = parts_->field.origin.z();
  const auto first = std::lower_bound(parts_->rising.begin(), parts_->rising.end(), low_mm - base,
                                      [](const Parts::Place& p, double z) { return p.z < z; });
  for (auto p = first; p != parts_->rising.end() && p->z <= high_mm - base; ++p) {
    const GridSample& s = parts_->field.bands[p->band].grid.samples()[p->index];
    found.points.push_back(parts_->field.origin + Vec3{s.x, s.y, s.z});
    found.normals.emplace_back(s.nx, s.ny, s.nz);
  }
}

}  // namespace telefab::scan
