// SPDX-License-Identifier: GPL-3.0-or-later
#include "completed_scan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/scan/completion/facing.hpp>
#include <telefab/scan/completion/sheet.hpp>

#include "openness.hpp"

namespace telefab::scan {
namespace {

/// The winding number is asked at every so many-th vertex,
constexpr std::size_t kProbed = 5;
/// and the contour is doubtful about the failures where they are more than this share.
constexpr double kMostFailures = 0.01;
/// (one alone proves nothing, unless it is all there is),
constexpr double kFewestFailures = 1;
/// Probes on either side, in spacings: on walls thinner than two of them and at sharp edges the far ones come out on
/// the other side.
constexpr std::array kProbeSpacings{1.F, 0.5F, 0.25F, 2.F};
/// A measured sample that is the nearest bears the surface as far as the field reaches, in kernel widths.
constexpr double kReachWidths = 2;
/// Where no virtual sample says otherwise.
constexpr double kErrorOfGap = 0.4;
/// Pieces of completed surface that face each other nearer than so many times the sum of their gaps may be one.
constexpr float kPassageGaps = 1.5F;
/// A sheet is at least so many spacings thick: its sides would else be seen as one.
constexpr double kLeastSheetSpacings = 2.5;

/// Slices of the scan that are taken one after the other: what the field says of a sample takes twice its own memory.
constexpr int kSlices = 32;

PointCloud cleaned_samples(const MlsField& field) {
  SurfaceSamples some;
  const Box3 box = field.bounds();
  PointCloud cloud;
  cloud.origin = (box.min + box.max) / 2;
  cloud.points.reserve(field.sample_count());
  cloud.normals.reserve(field.sample_count());
  const double step = (box.max.z() - box.min.z()) / kSlices, margin = step / 1000;
  for (int slice = 0; slice < kSlices; ++slice) {
    const double low = slice == 0 ? box.min.z() - step : box.min.z() + slice * step;
    const double high = slice + 1 == kSlices ? box.max.z() + step : box.min.z() + (slice + 1) * step;
    field.samples_between(low - margin, high + margin, some);
    for (std::size_t i = 0; i < some.points.size(); ++i) {
      // The field rounds heights in its own way: whose turn it is, is told by what it gives.
      if (some.points[i].z() <= low || some.points[i].z() > high) continue;
      cloud.points.push_back((some.points[i] - cloud.origin).cast<float>());
      cloud.normals.push_back(some.normals[i].cast<float>());
    }
  }
  return cloud;
}

/// Solid is on the left: outward is to the right.
Point2 outward_at(std::span<const Point2> ring, std::size_t i) {
  const Point2 a = ring[(i + ring.size() - 1) % ring.size()], b = ring[(i + 1) % ring.size()];
  const double x = b.y_mm - a.y_mm, y = a.x_mm - b.x_mm, length = std::hypot(x, y);
  return length > 0 ? Point2{x / length, y / length} : Point2{};
}

}  // namespace

CompletedScan::CompletedScan(PointCloud measured, Completion completion)
    : origin_{measured.origin}, measured_count_{measured.size()}, completion_{std::move(completion)} {
  areas_ = std::move(completion_.areas);
  for (std::size_t i = 0; i < measured_count_; ++i) {
    seen_mm2_ += static_cast<double>(areas_[i]);
    missing_mm2_ -= static_cast<double>(areas_[i]) * measured.normals[i].cast<double>();
  }
  if (!completion_.samples.empty()) near_measured_ = std::make_unique<KdTree>(measured.points);
  for (const VirtualSample& s : completion_.samples) {
    measured.points.push_back(s.point);
    measured.normals.push_back(s.normal);
    areas_.push_back(s.spacing * s.spacing);
  }
  near_ = std::make_unique<KdTree>(measured.points);
  tree_ = std::make_unique<WindingTree>(measured.points, measured.normals, areas_);
  normals_ = std::move(measured.normals);
}

Result<std::unique_ptr<CompletedScan>> CompletedScan::of(const MlsField& measured, const SliceRequest& request,
                                                         const ProgressSink& progress, std::stop_token stop) {
  PointCloud cloud = cleaned_samples(measured);
  std::vector<VirtualSample> back;
  if (request.thickness_mm) {
    const double least_mm = kLeastSheetSpacings * measured.kernel().spacing_mm;
    if (*request.thickness_mm < least_mm)
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("a sheet of {:.3g} mm is too thin for samples {:.3g} mm apart; make it {:.3g} mm thick or "
                      "more, or scan it more densely",
                      *request.thickness_mm, measured.kernel().spacing_mm, least_mm));
    auto made = other_side_of_sheet(cloud, *request.thickness_mm, measured.kernel().noise_mm, stop);
    if (!made) return tl::unexpected{made.error()};
    back = std::move(*made);
  }
  const std::size_t seen = cloud.size();
  for (const VirtualSample& s : back) {
    cloud.points.push_back(s.point);
    cloud.normals.push_back(s.normal);
  }
  Completion completion;
  if (!request.complete) {
    completion.areas = sample_areas(cloud.points, cloud.normals);
  } else {
    CompletionOptions options;
    options.noise = measured.kernel().noise_mm;
    options.most_gap = request.most_gap_mm;
    auto found = complete_cloud(cloud, options, progress, stop);
    if (!found) return tl::unexpected{found.error()};
    completion = std::move(*found);
  }
  completion.samples.insert(completion.samples.begin(), back.begin(), back.end());
  completion.areas.resize(seen);
  cloud.points.resize(seen);
  cloud.normals.resize(seen);
  if (stop.stop_requested()) return cancelled("closing gaps of the scan");
  return std::unique_ptr<CompletedScan>{new CompletedScan{std::move(cloud), std::move(completion)}};
}

std::vector<GapSample> CompletedScan::gap_samples() const {
  std::vector<GapSample> samples;
  samples.reserve(completion_.samples.size());
  for (const VirtualSample& s : completion_.samples)
    samples.push_back({origin_ + s.point.cast<double>(), s.normal.cast<double>(), static_cast<double>(s.spacing)});
  return samples;
}

Openness CompletedScan::openness() const { return {seen_mm2_, missing_mm2_}; }

CompletionSummary CompletedScan::summary() const {
  CompletionSummary summary{completion_.rim_samples, completion_.samples.size(), completion_.largest_gap, 0};
  for (const VirtualSample& s : completion_.samples)
    summary.largest_error_mm = std::max(summary.largest_error_mm, static_cast<double>(s.error()));
  return summary;
}

Result<void> CompletedScan::check(const SliceRequest& request) const { return check_openness(openness(), request); }

std::vector<std::string> CompletedScan::warnings(const SliceRequest& request) const {
  std::vector<std::string> sentences = gap_warnings(request);
  if (!request.thickness_mm)
    if (auto open = warning_of(unasked(openness(), request))) sentences.insert(sentences.begin(), std::move(*open));
  return sentences;
}

std::vector<std::string> CompletedScan::gap_warnings(const SliceRequest& request) const {
  std::vector<std::string> sentences;
  if (request.thickness_mm)
    sentences.emplace_back(fmt::format("taken as a sheet or relief: its back lies {:.3g} mm behind what was scanned",
                                       *request.thickness_mm));
  if (completion_.too_wide)
    sentences.emplace_back(
        "a gap of the scan is wider than what is closed (--complete MM closes wider ones): its middle is "
        "taken as flat");
  if (completion_.too_many)
    sentences.emplace_back(
        fmt::format("the gaps of the scan are larger than what it shows: closing them ended after {} samples "
                    "nobody measured; scan what is missing, or cut the scan to the part wanted",
                    completion_.samples.size()));
  return sentences;
}

CompletedScan::Side CompletedScan::side_of(const Vec3& place_mm) const {
  const Eigen::Vector3f place = local(place_mm);
  return {std::sqrt(static_cast<double>(near_->nearest(place).squared_distance)),
          static_cast<double>(tree_->winding(place))};
}

double CompletedScan::winding_at(const Vec3& place_mm) const {
  return static_cast<double>(tree_->winding(local(place_mm)));
}

std::vector<CompletedScan::Passage> CompletedScan::passages() const {
  std::vector<Passage> passages;
  for (const FacingPair& pair : facing_pairs(completion_.samples, *tree_, kPassageGaps)) {
    Passage p{origin_ + pair.from.cast<double>(), origin_ + pair.to.cast<double>()};
    if (p.low_mm.z() > p.high_mm.z()) std::swap(p.low_mm, p.high_mm);
    passages.push_back(p);
  }
  return passages;
}

bool CompletedScan::is_measured(const Vec3& place_mm, const ScalarField& field) const {
  if (!near_measured_) return true;
  return std::sqrt(static_cast<double>(near_measured_->nearest(local(place_mm)).squared_distance)) <=
         field.kernel_width_mm(place_mm);
}

double CompletedScan::error_at(const Vec3& place_mm, const ScalarField& field) const {
  std::optional<std::uint32_t> beside;
  return near_measured_ ? rests_on(place_mm, field, beside).error_mm : 0;
}

SurfaceRun CompletedScan::rests_on(const Vec3& place_mm, const ScalarField& field,
                                   std::optional<std::uint32_t>& beside) const {
  const Eigen::Vector3f place = local(place_mm);
  const double width = field.kernel_width_mm(place_mm);
  // Any measured sample within a width will do.
  if (beside && static_cast<double>((near_->point(*beside) - place).norm()) <= width) return {};
  const Neighbour nearest = near_->nearest(place);
  const auto distance = [](const Neighbour& n) { return std::sqrt(static_cast<double>(n.squared_distance)); };
  const bool is_virtual = nearest.index >= measured_count_;
  if (!is_virtual) beside = nearest.index;
  if (!is_virtual && distance(nearest) <= kReachWidths * width) return {};
  const double gap = is_virtual ? distance(near_measured_->nearest(place)) : distance(nearest);
  if (gap <= width) return {};
  double share = kErrorOfGap;
  if (is_virtual) {
    const VirtualSample& sample = completion_.samples[nearest.index - measured_count_];
    // The back of a sheet lies where it was asked for.
    share = sample.gap > 0 ? static_cast<double>(sample.error() / sample.gap) : 0;
  }
  return {SurfaceClass::Completed, 1, gap, share * gap};
}

bool CompletedScan::sides_agree(const Vec3& place_mm, const Eigen::Vector3f& outward) const {
  const Eigen::Vector3f place = local(place_mm);
  const Neighbour nearest = near_->nearest(place);
  const float spacing = std::sqrt(areas_[nearest.index]);
  for (const Eigen::Vector3f& normal : {normals_[nearest.index], outward})
    for (const float spacings : kProbeSpacings) {
      const Eigen::Vector3f way = spacings * spacing * normal;
      if (tree_->winding(place - way) > 0.5F && tree_->winding(place + way) < 0.5F) return true;
    }
  return false;
}

std::vector<SurfaceRun> CompletedScan::surface_of(const Contour& contour, double z_mm, const ScalarField& field) const {
  const auto vertices = contour.vertices();
  const std::size_t count = vertices.size();
  std::vector<SurfaceRun> runs(count);
  if (near_measured_) {
    std::vector<SurfaceRun> at(count);
    std::optional<std::uint32_t> beside;
    for (std::size_t i = 0; i < count; ++i) at[i] = rests_on({vertices[i].x_mm, vertices[i].y_mm, z_mm}, field, beside);
    for (std::size_t i = 0; i < count; ++i) {
      const SurfaceRun& next = at[(i + 1) % count];
      runs[i] = next.gap_mm > at[i].gap_mm ? next : at[i];
    }
  }
  // Nearly all agree at the first distance: that is asked of the whole ring at once.
  std::vector<Eigen::Vector3f> beside;
  for (std::size_t i = 0; i < count; i += kProbed) {
    const Eigen::Vector3f place = local({vertices[i].x_mm, vertices[i].y_mm, z_mm});
    const Neighbour nearest = near_->nearest(place);
    const Eigen::Vector3f way = kProbeSpacings[0] * std::sqrt(areas_[nearest.index]) * normals_[nearest.index];
    beside.push_back(place - way);
    beside.push_back(place + way);
  }
  const std::vector<float> windings = tree_->windings(beside);
  const std::size_t asked = beside.size() / 2;
  std::vector<std::size_t> failed;
  for (std::size_t k = 0; k < asked; ++k) {
    if (windings[2 * k] > 0.5F && windings[2 * k + 1] < 0.5F) continue;
    const std::size_t i = k * kProbed;
    const Point2 outward = outward_at(vertices, i);
    if (!sides_agree({vertices[i].x_mm, vertices[i].y_mm, z_mm},
                     {static_cast<float>(outward.x_mm), static_cast<float>(outward.y_mm), 0}))
      failed.push_back(i);
  }
  const double most = std::max(kFewestFailures, kMostFailures * static_cast<double>(asked));
  if (static_cast<double>(failed.size()) <= std::min(most, 0.5 * static_cast<double>(asked))) return runs;
  for (const std::size_t i : failed)
    for (std::size_t k = 0; k < std::min(count, 2 * kProbed); ++k) {
      SurfaceRun& run = runs[(i + count - std::min(count, kProbed) + k) % count];
      run.kind = SurfaceClass::Doubtful;
    }
  return runs;
}

}  // namespace telefab::scan
