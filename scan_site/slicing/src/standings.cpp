// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/standings.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/scan/cloud/units.hpp>

namespace telefab::scan {
namespace {

/// Of the grid of one turn alone, which somebody waits for.
constexpr double kQuickCorners = 200'000;
constexpr double kFewestCorners = 10'000;

/// No finer than the layers: of a part of a millimetre pins and arms would be hundreds of cells wide.
double quick_corners(const PointCloud& prepared, const StandingOptions& options) {
  const Vec3 size = size_of(prepared);
  double scale = options.scale;
  if (options.height_mm && size.minCoeff() > 0) scale = *options.height_mm / size.maxCoeff();
  const double cells = (scale * size).prod() / std::pow(options.layer_mm, 3);
  return options.fit ? kQuickCorners : std::clamp(cells, kFewestCorners, kQuickCorners);
}

std::string text_of(const StandingFigures& f) {
  const double share = f.part_mm3 > 0 ? 100 * f.support_mm3 / f.part_mm3 : 0;
  return fmt::format("{:.0f} mm3 of supports ({:.1f} % of the part), {} anchors, {:.1f} mm high", f.support_mm3, share,
                     f.anchors, f.size_mm.z());
}

nlohmann::ordered_json json_of(const StandingFigures& f) {
  return {{"size_mm", {f.size_mm.x(), f.size_mm.y(), f.size_mm.z()}},
          {"layers", f.layers},
          {"part_mm3", f.part_mm3},
          {"support_mm3", f.support_mm3},
          {"anchors", f.anchors},
          {"overhang_mm2", f.overhang_mm2},
          {"stepped_mm2", f.stepped_mm2},
          {"lifted", f.is_lifted},
          {"trapped_mm3", f.trapped_mm3},
          {"stability", f.stability}};
}

StandingOptions options_for(const PointCloud& prepared, const SliceRequest& request) {
  const PlacementOptions& placement = request.placement;
  StandingOptions options;
  options.machine = request.machine;
  options.layer_mm = request.layer_mm.value_or(request.machine.layers.thickness_mm);
  options.height_mm = placement.height_mm;
  options.scale = placement.scale.value_or(placement.unit_mm.value_or(prepared.unit_mm.value_or(1)));
  options.fit = placement.fit;
  options.axis_scale = request.drawn_axis_scale();
  options.thickness_mm = request.thickness_mm;
  return options;
}

}  // namespace

PointCloud mirrored(PointCloud cloud, MirrorAxis axis) {
  const auto a = static_cast<Eigen::Index>(axis) - 1;
  cloud.origin[a] = -cloud.origin[a];
  for (auto& p : cloud.points) p[a] = -p[a];
  for (auto& n : cloud.normals) n[a] = -n[a];
  return cloud;
}

double print_scale(const PointCloud& prepared, const SliceRequest& request) {
  const StandingOptions options = options_for(prepared, request);
  Vec3 signs = Vec3::Ones();
  if (const auto mirror = request.placement.mirror) signs[static_cast<Eigen::Index>(*mirror) - 1] = -1;
  const Eigen::Matrix3d turned = options.axis_scale.asDiagonal() * request.placement.turn.matrix() * signs.asDiagonal();
  Box3 box = Box3::nothing();
  for (const Eigen::Vector3f& p : prepared.points) box.include(Vec3{turned * p.cast<double>()});
  const double scale = scale_for(box.size(), options);
  return std::isfinite(scale) && scale > 0 ? scale : 1;
}

std::string to_json(const StandingFigures& figures) { return json_text(json_of(figures)); }

Result<std::vector<Standing>> standings_of(const PointCloud& prepared, const SliceRequest& request,
                                           const StandingSearch& search, const ShareSink& progress,
                                           std::stop_token stop) {
  StandingOptions options = options_for(prepared, request);
  options.goal = search.goal;
  options.directions = search.directions;
  if (!request.placement.mirror) return judged_standings(prepared, options, progress, stop);
  return judged_standings(mirrored(prepared, *request.placement.mirror), options, progress, stop);
}

Result<Standing> standing_of(const PointCloud& prepared, const SliceRequest& request, std::stop_token stop) {
  StandingOptions options = options_for(prepared, request);
  options.corners = quick_corners(prepared, options);
  const Turn& turn = request.placement.turn;
  if (!request.placement.mirror) return judged_standing(prepared, options, turn, stop);
  return judged_standing(mirrored(prepared, *request.placement.mirror), options, turn, stop);
}

Result<ChosenStanding> chosen_standing(const PointCloud& prepared, const SliceRequest& request, StandFor goal,
                                       std::stop_token stop) {
  const auto standings = standings_of(prepared, request, {.goal = goal}, {}, stop);
  if (!standings) return tl::unexpected{standings.error()};
  ChosenStanding chosen{goal, standings->front(), {}};
  for (const Standing& s : *standings)
    if (s.source == StandingSource::AsInFile) chosen.as_in_file = s.figures;
  return chosen;
}

std::string sentence_of(const ChosenStanding& chosen) {
  const std::string best = fmt::format("chosen to stand for {} ({}): about {}", name_of(chosen.goal),
                                       name_of(chosen.standing.source), text_of(chosen.standing.figures));
  if (chosen.standing.source == StandingSource::AsInFile) return best;
  return best + (chosen.as_in_file ? "; as it lies in its file " + text_of(*chosen.as_in_file)
                                   : std::string{"; as it lies in its file it does not fit"});
}

std::string to_json(const ChosenStanding& chosen) {
  return json_text(nlohmann::ordered_json{
      {"for", name_of(chosen.goal)},
      {"source", name_of(chosen.standing.source)},
      {"estimate", json_of(chosen.standing.figures)},
      {"as_in_file", chosen.as_in_file ? json_of(*chosen.as_in_file) : nlohmann::ordered_json(nullptr)}});
}

}  // namespace telefab::scan
