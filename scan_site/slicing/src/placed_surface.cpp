// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/placed_surface.hpp>
#include <telefab/scan/slicing/standings.hpp>

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace telefab::scan {
namespace {

/// Sides of the box move by more than so many spacings where dropped points set it; tips move by less.
constexpr double kMovedSpacings = 1.5;
/// Dropped points that lie beyond the samples are strays while they are so few, and else a part too sparse to be
/// sliced.
constexpr std::size_t kFewStrays = 3;
constexpr double kFewShare = 0.003;

Box3 box_of_samples(const MlsField& field) {
  const Box3 reach = field.bounds();
  SurfaceSamples all;
  field.samples_between(reach.min.z(), reach.max.z(), all);
  Box3 box = Box3::nothing();
  for (const Vec3& p : all.points) box.include(p);
  return box;
}

/// A box of the build frame for places of the file, a little grown.
FramedBox for_file(const Box3& box, const Transform4& scan_to_build, double margin_mm) {
  const Vec3 margin = Vec3::Constant(margin_mm);
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> to_build{scan_to_build.data()};
  return {to_build.topRows<3>(), {box.min - margin, box.max + margin}};
}

std::vector<DoubledPlace> doubled_places(const PointCloud& cloud) {
  std::vector<DoubledPlace> places;
  for (std::size_t i = 0; i < cloud.sheets_apart.size(); ++i)
    if (cloud.sheets_apart[i] > 0)
      places.push_back({cloud.origin + cloud.points[i].cast<double>(), static_cast<double>(cloud.sheets_apart[i])});
  std::stable_sort(places.begin(), places.end(),
                   [](const DoubledPlace& l, const DoubledPlace& r) { return l.at_mm.z() < r.at_mm.z(); });
  return places;
}

/// Where on the platform the part's middle is.
Vec3 foot_of(const Placement& placed) { return {placed.middle_mm.x(), placed.middle_mm.y(), 0}; }

Result<PlacedSurface> attempt(std::span<const std::byte> scan, std::string_view name, const IntakeOptions& intake,
                              const SliceRequest& request, const ProgressSink& progress, StageClock& clock,
                              std::stop_token stop) {
  auto prepared = prepare_scan(scan, name, intake, progress, clock, stop);
  if (!prepared) return tl::unexpected{prepared.error()};
  PlacedSurface made;
  SliceRequest wanted = request;
  if (const auto goal = request.placement.stand_for) {
    auto chosen = chosen_standing(prepared->cloud, request, *goal, stop);
    if (!chosen) return fail_in(name, chosen.error());
    wanted.placement.turn = chosen->standing.turn;
    made.chosen = std::move(*chosen);
    clock.lap("choosing how it stands");
  }
  auto placed = place_on_platform(std::move(prepared->cloud), wanted);
  if (!placed) return fail_in(name, placed.error());
  made.prepared = std::move(*prepared);
  made.placed = std::move(*placed);
  clock.lap("placement");
  report(progress, WorkStage::FittingSurface, 0);
  PointCloud cloud = std::move(made.placed.cloud);
  if (intake.about_origin) cloud.origin -= foot_of(made.placed);
  made.doubled = doubled_places(cloud);
  made.placed.cloud = {};
  made.placed.cloud.origin = cloud.origin;
  made.placed.cloud.rounding = cloud.rounding;
  auto field = MlsField::from_cloud(std::move(cloud), request.mls, stop);
  if (!field) return fail_in(name, field.error());
  made.field = std::move(*field);
  return made;
}

}  // namespace

Result<PlacedSurface> surface_of(std::span<const std::byte> scan, std::string_view name, const IntakeOptions& intake,
                                 const SliceRequest& request, const ProgressSink& progress, StageClock& clock,
                                 std::stop_token stop) {
  auto made = attempt(scan, name, intake, request, progress, clock, stop);
  if (!made || made->field->kernel().dropped_samples == 0 || !request.mls.drop_outliers || request.thickness_mm)
    return made;
  const Vec3& size = made->placed.size_mm;
  const Vec3 middle = foot_of(made->placed);
  Box3 samples = box_of_samples(*made->field);
  if (intake.about_origin) samples = {samples.min + middle, samples.max + middle};
  const Vec3 low = middle - Vec3{size.x() / 2, size.y() / 2, 0};
  const double moved_mm =
      std::max((samples.min - low).cwiseAbs().maxCoeff(), (low + size - samples.max).cwiseAbs().maxCoeff());
  const double spacing_mm = made->field->kernel().spacing_mm;
  if (moved_mm <= kMovedSpacings * spacing_mm) return made;

  IntakeOptions without = intake;
  without.pick.surface_box = for_file(samples, made->placed.scan_to_build, 1e-3 * spacing_mm);
  auto again = attempt(scan, name, without, request, progress, clock, stop);
  if (!again) return again;
  const std::size_t beyond = again->prepared.pick.strays - made->prepared.pick.strays;
  const auto few = static_cast<std::size_t>(kFewShare * static_cast<double>(made->prepared.points));
  return beyond <= std::max(kFewStrays, few) ? std::move(again) : std::move(made);
}

}  // namespace telefab::scan
