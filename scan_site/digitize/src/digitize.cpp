// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/digitize/digitize.hpp>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

namespace telefab::scan {
namespace {

constexpr double kMaxCells = 64e6;
constexpr std::uint32_t kRim = 2;  ///< empty cells about the image

struct Cell {
  double depth = -std::numeric_limits<double>::infinity();
  double cosine = 0;  ///< of the angle between normal and line of sight
};

struct Frame {
  std::uint32_t rows = 0, columns = 0;
  double left = 0, bottom = 0, pitch = 1;
  [[nodiscard]] double x_of(std::uint32_t column) const { return left + pitch * (column + 0.5); }
  [[nodiscard]] double y_of(std::uint32_t row) const { return bottom + pitch * (row + 0.5); }
};

/// The nearest surface of every cell, by filling every triangle that faces the scanner or not.
std::vector<Cell> depths(const Frame& frame, std::span<const Vec3> points,
                         std::span<const std::array<std::uint32_t, 3>> triangles) {
  std::vector<Cell> cells(std::size_t{frame.rows} * frame.columns);
  for (const auto& t : triangles) {
    const Vec3 &a = points[t[0]], &b = points[t[1]], &c = points[t[2]];
    const Vec3 normal = (b - a).cross(c - a);
    const double area = normal.z();  // twice, as seen
    if (!(std::abs(area) > 0)) continue;
    const double cosine = area / normal.norm();
    const auto index = [&](double v, double from) { return (v - from) / frame.pitch - 0.5; };
    const double top_column = frame.columns - 1, top_row = frame.rows - 1;
    const auto first_column = static_cast<std::uint32_t>(
        std::clamp(std::ceil(index(std::min({a.x(), b.x(), c.x()}), frame.left)), 0.0, top_column));
    const auto last_column = static_cast<std::uint32_t>(
        std::clamp(std::floor(index(std::max({a.x(), b.x(), c.x()}), frame.left)), 0.0, top_column));
    const auto first_row = static_cast<std::uint32_t>(
        std::clamp(std::ceil(index(std::min({a.y(), b.y(), c.y()}), frame.bottom)), 0.0, top_row));
    const auto last_row = static_cast<std::uint32_t>(
        std::clamp(std::floor(index(std::max({a.y(), b.y(), c.y()}), frame.bottom)), 0.0, top_row));
    for (std::uint32_t row = first_row; row <= last_row; ++row)
      for (std::uint32_t column = first_column; column <= last_column; ++column) {
        const double x = frame.x_of(column), y = frame.y_of(row);
        const auto side = [&](const Vec3& p, const Vec3& q) {
          return ((q.x() - p.x()) * (y - p.y()) - (q.y() - p.y()) * (x - p.x())) / area;
        };
        const double wc = side(a, b), wa = side(b, c), wb = side(c, a);
        if (wa < 0 || wb < 0 || wc < 0) continue;
        const double z = wa * a.z() + wb * b.z() + wc * c.z();
        Cell& cell = cells[std::size_t{row} * frame.columns + column];
        if (z > cell.depth) cell = {z, cosine};
      }
  }
  return cells;
}

/// What a scanner makes of the true depths. One generator a view, cells in order: the same on every machine.
VirtualView look(const Frame& frame, std::span<const Cell> cells, const DigitizeOptions& options, std::uint64_t seed,
                 double low, double high) {
  std::mt19937_64 random{seed};
  const auto uniform = [&] { return static_cast<double>(random() >> 11U) * 0x1p-53; };
  const auto gauss = [&] {  // Box-Muller: std::normal_distribution differs from library to library
    const double u = std::max(uniform(), 1e-300), v = uniform();
    return std::sqrt(-2 * std::log(u)) * std::cos(2 * std::numbers::pi * v);
  };
  const double least_cosine = std::cos(options.grazing_deg * std::numbers::pi / 180);
  VirtualView view;
  view.view = {frame.rows, frame.columns, {}, std::nullopt};
  view.view.point_at.assign(cells.size(), RangeView::kEmpty);
  for (std::uint32_t row = 0; row < frame.rows; ++row)
    for (std::uint32_t column = 0; column < frame.columns; ++column) {
      const std::size_t at = std::size_t{row} * frame.columns + column;
      const double noise = gauss(), chance = uniform(), place = uniform(), mix = uniform(), part = uniform();
      if (!std::isfinite(cells[at].depth) || cells[at].cosine < least_cosine) continue;
      double depth = cells[at].depth + options.noise_mm * noise;
      if (mix < options.mixed_share)
        for (const std::size_t next : {at + 1, at + frame.columns})
          if (next < cells.size() && std::isfinite(cells[next].depth) &&
              cells[next].depth < cells[at].depth - 6 * frame.pitch) {
            depth = cells[next].depth + part * (cells[at].depth - cells[next].depth);
            break;
          }
      if (chance < options.outlier_share) depth = low + place * (high - low);
      view.view.point_at[at] = static_cast<std::int32_t>(view.points.size());
      view.points.push_back(Vec3{frame.x_of(column), frame.y_of(row), depth}.cast<float>());
    }
  return view;
}

}  // namespace

Result<void> DigitizeOptions::validate() const {
  const auto refuse = [](std::string_view what, double value) {
    return fail(ErrorCode::InvalidInput, fmt::format("{} is {}: out of range", what, value));
  };
  if (!(step_deg > 0 && step_deg <= 360)) return refuse("step_deg", step_deg);
  if (!(pitch_mm > 0)) return refuse("pitch_mm", pitch_mm);
  if (!(tilt_deg >= -80 && tilt_deg <= 80)) return refuse("tilt_deg", tilt_deg);
  if (!(noise_mm >= 0)) return refuse("noise_mm", noise_mm);
  if (!(outlier_share >= 0 && outlier_share < 0.5)) return refuse("outlier_share", outlier_share);
  if (!(mixed_share >= 0 && mixed_share <= 1)) return refuse("mixed_share", mixed_share);
  if (!(grazing_deg > 0 && grazing_deg <= 90)) return refuse("grazing_deg", grazing_deg);
  if (views > 3600) return refuse("views", views);
  return {};
}

Result<std::vector<VirtualView>> digitize(const DigitizeModel& model, const DigitizeOptions& options,
                                          std::stop_token stop) {
  if (auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  if (model.triangles.empty())
    return fail(ErrorCode::InvalidInput,
                "the model has no triangles; digitize needs a mesh (PLY, OFF or STL with faces)");
  Vec3 low = model.points.at(0), high = low;
  for (const Vec3& p : model.points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  for (const auto& t : model.triangles)
    for (const std::uint32_t corner : t)
      if (corner >= model.points.size())
        return fail(ErrorCode::InvalidInput,
                    fmt::format("a triangle names point {} of {}", corner, model.points.size()));
  const Vec3 middle = (low + high) / 2;
  const std::uint32_t count =
      options.views > 0 ? options.views : static_cast<std::uint32_t>(std::max(1.0, std::round(360 / options.step_deg)));
  const double reach = (high - low).norm() / 2;  // the same image size for every view
  const double cells = std::ceil(2 * reach / options.pitch_mm) + 2 * kRim;
  if (cells * cells > kMaxCells)
    return fail(ErrorCode::TooLarge, fmt::format("{0:.0f} x {0:.0f} cells a view; take a coarser pitch than {1} mm",
                                                 cells, options.pitch_mm));
  const auto side = static_cast<std::uint32_t>(cells);
  const Frame frame{side, side, -options.pitch_mm * cells / 2, -options.pitch_mm * cells / 2, options.pitch_mm};

  // The scanner stands before the table (-y of the model), looks along +y, tilted down: its z towards itself.
  Eigen::Matrix3d upright;
  upright.col(0) = Vec3{1, 0, 0};
  upright.col(1) = Vec3{0, 0, -1};
  upright.col(2) = Vec3{0, 1, 0};
  const Eigen::Matrix3d to_scanner =
      Eigen::AngleAxisd{options.tilt_deg * std::numbers::pi / 180, Vec3::UnitX()}.toRotationMatrix() * upright;
  std::vector<VirtualView> views(count);
  tbb::parallel_for(std::uint32_t{0}, count, [&](std::uint32_t v) {
    if (stop.stop_requested()) return;
    const Eigen::AngleAxisd turn{options.step_deg * std::numbers::pi / 180 * v, Vec3::UnitZ()};
    const Eigen::Isometry3d motion = Eigen::Isometry3d{to_scanner * turn} * Eigen::Translation3d{-middle};
    std::vector<Vec3> seen;
    seen.reserve(model.points.size());
    for (const Vec3& p : model.points) seen.push_back(motion * p);
    views[v] = look(frame, depths(frame, seen, model.triangles), options, options.seed * 0x9E3779B97F4A7C15ULL + v,
                    -reach, reach);
    views[v].scanner_to_model = motion.inverse();
  });
  if (stop.stop_requested()) return cancelled("digitizing");
  return views;
}

}  // namespace telefab::scan
