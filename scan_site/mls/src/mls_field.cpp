// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/scan/mls/mls_field.hpp>

#include "field_setup.hpp"

namespace telefab::scan {
namespace {

constexpr std::array kKinds{std::pair{SurfaceKind::Unbiased, "unbiased"}, std::pair{SurfaceKind::Paper, "paper"},
                            std::pair{SurfaceKind::PaperLiteral, "paper-literal"},
                            std::pair{SurfaceKind::Imls, "imls"}};

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
  FieldSetup setup;
};

MlsField::MlsField(std::unique_ptr<const Parts> parts) : parts_{std::move(parts)} {}
MlsField::~MlsField() = default;

Result<std::unique_ptr<MlsField>> MlsField::from_cloud(PointCloud placed, const MlsOptions& options,
                                                       std::stop_token stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  auto setup = set_up_field(std::move(placed), options, stop);
  if (!setup) return tl::unexpected{setup.error()};
  return std::unique_ptr<MlsField>{new MlsField{std::make_unique<const Parts>(Parts{std::move(*setup)})}};
}

std::unique_ptr<MlsField> MlsField::with_scaled_kernel(double factor) const {
  return std::unique_ptr<MlsField>{
      new MlsField{std::make_unique<const Parts>(Parts{scan::with_scaled_kernel(parts_->setup, factor)})}};
}

std::unique_ptr<MlsField> MlsField::completed_by(std::span<const GapSample> others) const {
  return std::unique_ptr<MlsField>{
      new MlsField{std::make_unique<const Parts>(Parts{scan::completed_by(parts_->setup, others)})}};
}

std::unique_ptr<FieldCursor> MlsField::cursor() const { return std::make_unique<MlsCursor>(parts_->setup.field); }
Box3 MlsField::bounds() const { return parts_->setup.bounds; }
double MlsField::kernel_width_mm(const Vec3& point_mm) const { return parts_->setup.field.scale.width_mm(point_mm); }
const KernelChoice& MlsField::kernel() const { return parts_->setup.choice; }
std::size_t MlsField::sample_count() const {
  std::size_t count = 0;
  for (const SampleGrid& band : parts_->setup.field.bands) count += band.size();
  return count;
}

double MlsField::widest_kernel_mm() const {
  float widest = 0;
  for (const SampleGrid& band : parts_->setup.field.bands) widest = std::max(widest, band.widest_mm());
  return widest;
}

void MlsField::samples_between(double low_mm, double high_mm, SurfaceSamples& found) const {
  rising_samples(low_mm, high_mm, 0, found);
}

void MlsField::level_samples(double least_nz, SurfaceSamples& found) const {
  rising_samples(bounds().min.z(), bounds().max.z(), least_nz, found);
}

void MlsField::rising_samples(double low_mm, double high_mm, double least_nz, SurfaceSamples& found) const {
  const FieldParts& field = parts_->setup.field;
  const double low = low_mm - field.origin.z();
  const double high = high_mm - field.origin.z();
  // Height as an integer of the same order, then the number of the sample, band after band.
  std::vector<std::uint64_t> keys;
  std::uint32_t before = 0;
  for (const SampleGrid& band : field.bands) {
    band.visit_slabs(static_cast<float>(low), static_cast<float>(high), [&](std::uint32_t first, std::uint32_t last) {
      for (std::uint32_t i = first; i < last; ++i) {
        const float z = band.place(i).z();
        if (z >= low && z <= high && std::abs(band.normal(i).z()) >= least_nz)
          keys.push_back(static_cast<std::uint64_t>(rising(z)) << 32U | (before + i));
      }
    });
    before += band.size();
  }
  if (keys.size() > 10'000)
    tbb::parallel_sort(keys.begin(), keys.end());
  else
    std::sort(keys.begin(), keys.end());
  found.points.resize(keys.size());
  found.normals.resize(keys.size());
  const SampleGrid* const first_gap = field.bands.data() + (field.bands.size() - field.gap_bands);
  found.in_gap.assign(field.gap_bands > 0 ? keys.size() : 0, 0);
  for (std::size_t k = 0; k < keys.size(); ++k) {
    auto i = static_cast<std::uint32_t>(keys[k]);
    const SampleGrid* band = field.bands.data();
    for (; i >= band->size(); ++band) i -= band->size();
    found.points[k] = field.origin + band->place(i).cast<double>();
    found.normals[k] = band->normal(i).cast<double>();
    if (band >= first_gap) found.in_gap[k] = 1;
  }
}

}  // namespace telefab::scan
