// SPDX-License-Identifier: GPL-3.0-or-later
#include "virtual_scans.hpp"

#include <fmt/format.h>

#include <cstdlib>
#include <numbers>
#include <telefab/base/file.hpp>
#include <telefab/scan/digitize/models.hpp>

namespace telefab::campaign {
namespace {

constexpr std::uint64_t kMaxBytes = 4ULL << 30U;
constexpr double kSizeMm = 80;

/// A campaign goes on only with what it was asked for.
template <class T>
T or_stop(Result<T> result, const std::string& what) {
  if (result) return std::move(*result);
  fmt::print(stderr, "{}: {}\n", what, result.error().what);
  std::exit(1);
}

scan::Box3 box_of(const scan::DigitizeModel& model) {
  scan::Box3 box = scan::Box3::nothing();
  for (const scan::Vec3& p : model.points) box.include(p);
  return box;
}

}  // namespace

scan::DigitizeModel load_model(const std::string& path) {
  scan::DigitizeModel model;
  if (path == "knot" || path == "torus" || path == "sphere") {
    model = or_stop(scan::shape_model(path, kSizeMm), path);
  } else {
    const auto bytes = or_stop(read_file(path, kMaxBytes), path);
    const auto file = or_stop(scan::read_scan_file(bytes, path, {.keep_faces = true}, {}), path);
    model.triangles = file.faces;
    for (const auto& p : file.cloud.points) model.points.emplace_back(file.cloud.origin + p.cast<double>());
    if (model.triangles.empty()) model = or_stop(scan::surfel_model(file.cloud), path);
  }
  scan::face_outward(model);
  const scan::Box3 box = box_of(model);
  for (scan::Vec3& p : model.points) p = (p - box.middle()) * (kSizeMm / box.size().maxCoeff());
  return model;
}

scan::DigitizeModel mirrored(scan::DigitizeModel model) {
  for (scan::Vec3& p : model.points) p.x() = -p.x();
  for (auto& t : model.triangles) std::swap(t[1], t[2]);
  return model;
}

Turn take_turn(scan::DigitizeModel model, const scan::RigidMotion& motion, const TurnOptions& options) {
  for (scan::Vec3& p : model.points) p = motion * p;
  auto views = or_stop(scan::digitize(model,
                                      {.step_deg = options.step_deg,
                                       .pitch_mm = 0.5,
                                       .tilt_deg = 0,
                                       .noise_mm = options.noise_mm,
                                       .seed = options.seed},
                                      {}),
                       "digitize");
  Turn turn;
  for (scan::VirtualView& view : views) {
    const scan::RigidMotion to_model = motion.inverse() * view.scanner_to_model;
    if (options.keep)
      for (std::int32_t& cell : view.view.point_at)
        if (cell >= 0 && !options.keep(to_model * view.points[static_cast<std::size_t>(cell)].cast<double>()))
          cell = scan::RangeView::kEmpty;
    scan::ScanFile file;
    file.cloud.points = view.points;
    file.views.push_back(view.view);
    auto image = scan::make_range_image(file, 0, fmt::format("view_{:03}", turn.images.size()));
    if (!image) continue;  // nearly all of it was cut away
    turn.images.push_back(std::move(*image));
    turn.to_model.push_back(to_model);
  }
  return turn;
}

scan::RigidMotion turned_over(std::mt19937_64& random) {
  const auto uniform = [&] { return static_cast<double>(random() >> 11U) / 9007199254740992.0; };
  const double along = uniform() * 2 * std::numbers::pi, angle = (1 + uniform()) * std::numbers::pi / 2;
  scan::RigidMotion motion = scan::RigidMotion::Identity();
  motion.linear() = Eigen::AngleAxisd{angle, scan::Vec3{std::cos(along), std::sin(along), 0}}.toRotationMatrix();
  return motion;
}

}  // namespace telefab::campaign
