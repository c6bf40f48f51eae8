// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/placing/standing.hpp>

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <numbers>
#include <numeric>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/completion/complete_cloud.hpp>
#include <telefab/scan/completion/sheet.hpp>
#include <telefab/scan/placing/room.hpp>

#include "directions.hpp"
#include "growth.hpp"
#include "solid_grid.hpp"

namespace telefab::scan {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3f;

constexpr std::array kGoals{std::pair{StandFor::Supports, "supports"}, std::pair{StandFor::Height, "height"},
                            std::pair{StandFor::Quality, "quality"}};
constexpr double kDegree = std::numbers::pi / 180;
/// More samples say nothing about supports.
constexpr std::size_t kMostSamples = 120'000;
/// Samples that the rectangle around a part is found from.
constexpr std::size_t kOutlineSamples = 2'000;
/// A grid that is thinned so judges all directions, and the whole one the best of them.
constexpr int kThinned = 2;
/// The planner steadies lifted parts alone: what stands on a side of its own and leaves that would fall over.
constexpr double kFallsOver = 10;
/// Faces show steps that look up or down by more than this and are not level.
constexpr double kSteppedNz = 0.5;
constexpr double kLevelNz = 0.9986;  // 3 degrees

/// Points that stand for the scan, relative to its origin.
struct Samples {
  std::vector<Vector3f> points, normals;
  std::vector<float> areas;
};

Result<Samples> samples_of(const PointCloud& cloud, double thickness, std::stop_token stop) {
  Samples s;
  const std::size_t step = (cloud.size() + kMostSamples - 1) / kMostSamples;
  for (std::size_t i = 0; i < cloud.size(); i += step) {
    s.points.push_back(cloud.points[i]);
    s.normals.push_back(cloud.normals[i]);
  }
  s.areas = sample_areas(s.points, s.normals);
  if (thickness > 0) {
    PointCloud front;
    front.points = s.points;
    front.normals = s.normals;
    const auto back = other_side_of_sheet(front, thickness, 0, stop);
    if (!back) return tl::unexpected{back.error()};
    for (const VirtualSample& v : *back) {
      s.points.push_back(v.point);
      s.normals.push_back(v.normal);
      s.areas.push_back(v.spacing * v.spacing);
    }
  }
  return s;
}

/// A direction made to stand: turned along the platform, and as large as asked for.
struct Stood {
  Turn turn;
  StandingSource source = StandingSource::Spread;
  Stance stance;
  bool fits = false;
};

class Judge {
 public:
  Judge(const PointCloud& cloud, Samples samples, const StandingOptions& options)
      : options_{options}, samples_{std::move(samples)}, room_{room_of(options.machine)} {
    // Extremes come from all points, as in placement.
    const std::size_t step = std::max<std::size_t>(1, cloud.size() / 400'000);
    for (std::size_t i = 0; i < cloud.size(); i += step) all_.push_back(cloud.points[i]);
    for (std::size_t i = cloud.size(); i < samples_.points.size(); ++i) all_.push_back(samples_.points[i]);
    const std::size_t thin = std::max<std::size_t>(1, samples_.points.size() / kOutlineSamples);
    for (std::size_t i = 0; i < samples_.points.size(); i += thin)
      outline_.push_back(samples_.points[i].cast<double>());
  }

  [[nodiscard]] Result<Stood> stood(const Direction& direction) const {
    auto turn = Turn::with_up(direction.up);
    if (!turn) return tl::unexpected{turn.error()};
    const Matrix3d m = turn->matrix();
    std::vector<Eigen::Vector2d> places;
    places.reserve(outline_.size());
    for (const Vec3& p : outline_) places.push_back((m * p).head<2>());
    // As the file lies it is judged as it lies.
    if (direction.source != StandingSource::AsInFile)
      turn = turn->then_about_z(turn_along(places, room_.x() >= room_.y()));
    const Vec3 angles = (turn->angles_deg() * 1e4).array().round().matrix() / 1e4;
    turn = Turn::about_axes(angles);
    if (!turn) return tl::unexpected{turn.error()};
    return stood(*turn, direction.source);
  }

  /// As large as asked for, in exactly this turn.
  [[nodiscard]] Stood stood(const Turn& turn, StandingSource source) const {
    Stood s{turn, source, {options_.axis_scale.asDiagonal() * turn.matrix(), Box3::nothing()}, false};
    for (const Vector3f& p : all_) s.stance.box_mm.include(Vec3{s.stance.to_build * p.cast<double>()});
    const Vec3 size = s.stance.box_mm.size();
    if (!(size.minCoeff() > 0)) return s;
    const double scale = scale_for(size, options_);
    s.stance.to_build *= scale;
    s.stance.box_mm = {scale * s.stance.box_mm.min, scale * s.stance.box_mm.max};
    s.fits = ((s.stance.box_mm.size() - room_).array() <= 1e-9 * room_.maxCoeff()).all();
    return s;
  }

  [[nodiscard]] Standing judged(const Stood& stood, const SolidGrid& grid, bool in_full) const {
    Standing s{stood.turn, stood.source, grown(grid, stood.stance, options_.machine, options_.layer_mm, in_full), 0};
    const double scale2 = std::pow(std::abs(stood.stance.to_build.determinant()), 2.0 / 3);
    for (std::size_t i = 0; i < samples_.areas.size(); ++i) {
      const double area = scale2 * samples_.areas[i];
      const double nz = std::abs(stood.turn.matrix().row(2).dot(samples_.normals[i].cast<double>()));
      s.figures.surface_mm2 += area;
      if (nz > kSteppedNz && nz < kLevelNz) s.figures.stepped_mm2 += area;
    }
    return s;
  }

  [[nodiscard]] const Samples& samples() const { return samples_; }

 private:
  const StandingOptions& options_;
  Samples samples_;
  Vec3 room_;
  std::vector<Vector3f> all_;
  std::vector<Vec3> outline_;
};

/// Millimetres a unit of the scan as it lies in its file: good enough to make a sheet thick.
double scale_as_in_file(const PointCloud& cloud, const StandingOptions& options) {
  return scale_for(options.axis_scale.cwiseProduct(size_of(cloud).cwiseMax(1e-12)), options);
}

/// Sets the costs; the numbers of the standings, the best first. Volumes and heights are held against the part's own,
/// as its size may differ from direction to direction; what is equal by the goal is decided by a little of the other.
std::vector<std::size_t> order_of(std::vector<Standing>& standings, StandFor goal) {
  double lowest = std::numeric_limits<double>::infinity();
  for (const Standing& s : standings) lowest = std::min(lowest, static_cast<double>(s.figures.layers));
  for (Standing& s : standings) {
    const StandingFigures& f = s.figures;
    const double supports = f.part_mm3 > 0 ? f.support_mm3 / f.part_mm3 : 0;
    const double height = f.layers / lowest - 1;
    const double marked = f.surface_mm2 > 0 ? (f.overhang_mm2 + 0.3 * f.stepped_mm2) / f.surface_mm2 : 0;
    switch (goal) {
      case StandFor::Supports:
        s.cost = supports + 0.005 * height;
        break;
      case StandFor::Height:
        s.cost = height + 0.05 * supports;
        break;
      case StandFor::Quality:
        s.cost = marked + 0.02 * supports + 0.002 * height;
        break;
    }
  }
  for (Standing& s : standings)
    if (!s.figures.is_lifted && s.figures.stability < 0) s.cost += kFallsOver;
  std::vector<std::size_t> order(standings.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return standings[a].cost < standings[b].cost; });
  return order;
}

Result<Samples> checked_samples(const PointCloud& cloud, const StandingOptions& options, const std::stop_token& stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (cloud.points.empty() || cloud.normals.size() != cloud.size())
    return fail(ErrorCode::InvalidInput, "which way a scan stands best needs points with normals");
  return samples_of(cloud, options.thickness_mm ? *options.thickness_mm / scale_as_in_file(cloud, options) : 0, stop);
}

std::string room_text(const MachineProfile& machine) {
  return fmt::format("{} ({:g} x {:g} mm platform, {:g} mm travel)", machine.name, machine.platform.width_mm,
                     machine.platform.depth_mm, machine.platform.z_travel_mm);
}

}  // namespace

Result<StandFor> stand_for_from(std::string_view name) {
  for (const auto& [goal, text] : kGoals)
    if (name == text) return goal;
  return fail(ErrorCode::InvalidInput, fmt::format("nothing to stand for named \"{}\"; there are supports, height, "
                                                   "quality",
                                                   name));
}

std::string_view name_of(StandFor goal) { return kGoals[static_cast<std::size_t>(goal) - 1].second; }

double scale_for(const Vec3& size, const StandingOptions& options) {
  if (options.fit) return fitted_scale(options.machine, size, Vec3::Zero());
  return options.height_mm ? *options.height_mm * options.axis_scale.z() / size.z() : options.scale;
}

std::string_view name_of(StandingSource source) {
  switch (source) {
    case StandingSource::AsInFile:
      return "as in the file";
    case StandingSource::Axis:
      return "axis";
    case StandingSource::FlatSide:
      return "flat side";
    case StandingSource::OpenSide:
      return "open side";
    case StandingSource::Spread:
      break;
  }
  return "spread";
}

Result<void> StandingOptions::validate() const {
  if (!(layer_mm > 0 && layer_mm <= 1))
    return fail(ErrorCode::InvalidInput, fmt::format("layer thickness {} mm is not in (0, 1]", layer_mm));
  if (!(scale > 0) || !std::isfinite(scale) || (height_mm && !(*height_mm > 0)) ||
      (thickness_mm && !(*thickness_mm > 0)))
    return fail(ErrorCode::InvalidInput, "a height, a scale and a thickness are above 0");
  if (!(axis_scale.minCoeff() > 0)) return fail(ErrorCode::InvalidInput, "an axis is scaled by more than 0");
  if (in_full < 1 || in_full > 5000)
    return fail(ErrorCode::InvalidInput, fmt::format("{} directions in full; from 1 to 5000 are possible", in_full));
  if (!(corners >= 1e4 && corners <= 1e8))
    return fail(ErrorCode::InvalidInput, fmt::format("a grid of {} corners; from 1e4 to 1e8 are possible", corners));
  if (directions < 1 || directions > 5000)
    return fail(ErrorCode::InvalidInput, fmt::format("{} directions; from 1 to 5000 are possible", directions));
  return {};
}

Result<std::vector<Standing>> judged_standings(const PointCloud& cloud, const StandingOptions& options,
                                               const ShareSink& progress, std::stop_token stop) {
  auto samples = checked_samples(cloud, options, stop);
  if (!samples) return tl::unexpected{samples.error()};
  const SolidGrid fine{samples->points, samples->normals, samples->areas, options.corners, stop};
  if (stop.stop_requested()) return cancelled("filling the part");
  const SolidGrid coarse = fine.thinned(kThinned);
  const Judge judge{cloud, std::move(*samples), options};

  const auto directions = directions_of(judge.samples().normals, judge.samples().areas, options.directions);
  std::mutex mutex;
  std::size_t done = 0;
  const std::size_t all = directions.size() + options.in_full * 4;
  const auto advance = [&](std::size_t worth) {
    const std::lock_guard lock{mutex};
    done += worth;
    if (progress) progress(std::min(1.0, static_cast<double>(done) / static_cast<double>(all)));
  };
  std::vector<Stood> stood(directions.size());
  std::vector<Standing> first(directions.size());
  tbb::parallel_for(std::size_t{0}, directions.size(), [&](std::size_t i) {
    if (stop.stop_requested()) return;
    const auto made = judge.stood(directions[i]);
    if (!made) return;
    stood[i] = *made;
    if (made->fits) first[i] = judge.judged(*made, coarse, false);
    advance(1);
  });
  if (stop.stop_requested()) return cancelled("judging directions");
  std::vector<std::size_t> fitting;
  std::vector<Standing> rated;
  for (std::size_t i = 0; i < stood.size(); ++i)
    if (stood[i].fits) {
      fitting.push_back(i);
      rated.push_back(first[i]);
    }
  if (fitting.empty())
    return fail(ErrorCode::InvalidInput,
                fmt::format("the part is larger than {} whichever way it stands; make it smaller, or give --fit",
                            room_text(options.machine)));
  // The best by the coarse grid are judged on the fine one, and the file's own way always.
  std::vector<std::size_t> chosen;
  for (const std::size_t k : order_of(rated, options.goal))
    if (const std::size_t i = fitting[k];
        chosen.size() < options.in_full || stood[i].source == StandingSource::AsInFile)
      chosen.push_back(i);
  std::vector<Standing> judged(chosen.size());
  tbb::parallel_for(std::size_t{0}, chosen.size(), [&](std::size_t k) {
    if (stop.stop_requested()) return;
    judged[k] = judge.judged(stood[chosen[k]], fine, true);
    advance(4);
  });
  if (stop.stop_requested()) return cancelled("judging directions");
  rank(judged, options.goal);
  return judged;
}

Result<Standing> judged_standing(const PointCloud& cloud, const StandingOptions& options, const Turn& turn,
                                 std::stop_token stop) {
  auto samples = checked_samples(cloud, options, stop);
  if (!samples) return tl::unexpected{samples.error()};
  const SolidGrid grid{samples->points, samples->normals, samples->areas, options.corners, stop};
  if (stop.stop_requested()) return cancelled("filling the part");
  const Judge judge{cloud, std::move(*samples), options};
  const Stood stood = judge.stood(turn, StandingSource::AsInFile);
  if (!stood.fits) {
    const Vec3 size = stood.stance.box_mm.size();
    return fail(ErrorCode::InvalidInput,
                fmt::format("the part, {:.4g} x {:.4g} x {:.4g} mm, is larger than {} in this turn; make it smaller, "
                            "turn it, or give --fit",
                            size.x(), size.y(), size.z(), room_text(options.machine)));
  }
  return judge.judged(stood, grid, true);
}

void rank(std::vector<Standing>& standings, StandFor goal) {
  std::vector<Standing> sorted;
  for (const std::size_t k : order_of(standings, goal)) sorted.push_back(standings[k]);
  standings = std::move(sorted);
}

std::vector<Standing> best_apart(const std::vector<Standing>& judged, std::size_t most, double apart_deg) {
  std::vector<Standing> few;
  const double near = std::cos(apart_deg * kDegree);
  for (const Standing& s : judged) {
    if (few.size() >= most) break;
    const bool is_near = std::any_of(few.begin(), few.end(), [&](const Standing& other) {
      return s.turn.matrix().row(2).dot(other.turn.matrix().row(2)) > near;
    });
    if (!is_near) few.push_back(s);
  }
  return few;
}

}  // namespace telefab::scan
