// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/cloud/normals.hpp>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <algorithm>
#include <array>
#include <cmath>

#include "orientation.hpp"
#include "outside_grid.hpp"
#include "surface_graph.hpp"

namespace telefab::scan {
namespace {

constexpr std::array kCellsInSpacings{4.0F, 2.5F, 1.6F};  ///< coarse grids close gaps, fine ones tell near walls apart
constexpr std::size_t kMaxCells = 24'000'000;
/// Few points, some of them far off, are not worth many cells.
constexpr std::size_t kLeastCells = 1U << 20, kCellsAPoint = 512;

/// +1, -1 or 0 a point: the finest grid that can tell decides.
std::vector<std::int8_t> look_outside(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph) {
  std::vector<std::int8_t> side(points.size(), 0);
  std::vector<OutsideGrid> grids;
  grids.reserve(kCellsInSpacings.size());
  const std::size_t most = std::min(kMaxCells, kLeastCells + kCellsAPoint * points.size());
  for (const float cells : kCellsInSpacings)
    grids.emplace_back(points, cells * graph.spacing, most, grids.empty() ? nullptr : &grids.back());
  tbb::parallel_for(tbb::blocked_range<std::size_t>{0, points.size(), 4096}, [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i)
      for (auto grid = grids.rbegin(); grid != grids.rend(); ++grid)
        if (const auto found_side = grid->outward_side(points[i], graph.normal[i])) {
          side[i] = static_cast<std::int8_t>(*found_side);
          break;
        }
  });
  return side;
}

/// Share of near pairs that agree, sure pairs counting more.
double neighbour_agreement(std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph) {
  double agreeing = 0, all = 0;
  for (std::size_t i = 0; i < graph.size(); ++i)
    for (const std::uint32_t j : graph.neighbours_of(i)) {
      const PairVote vote = pair_vote(points[i], graph.normal[i], points[j], graph.normal[j]);
      const double weight = static_cast<double>(vote.confidence) * std::abs(vote.agreement);
      all += weight;
      if (vote.agreement > 0) agreeing += weight;
    }
  return all > 0 ? agreeing / all : 1;
}

/// Fills what is known about normals that stand as they are; `side` is measured against them.
void judge(NormalReport& report, std::span<const Eigen::Vector3f> points, const SurfaceGraph& graph,
           std::span<const std::int8_t> side) {
  std::size_t known = 0, outward = 0;
  for (const std::int8_t s : side) {
    known += s != 0 ? 1 : 0;
    outward += s > 0 ? 1 : 0;
  }
  report.outside_known = static_cast<double>(known) / static_cast<double>(side.size());
  report.outside_agreement = known > 0 ? static_cast<double>(outward) / static_cast<double>(known) : 1;
  report.neighbour_agreement = neighbour_agreement(points, graph);
}

}  // namespace

Result<void> NormalOptions::validate() const {
  if (neighbours < 6 || neighbours > 64)
    return fail(ErrorCode::InvalidInput, fmt::format("neighbours is {}; 6 to 64 are possible", neighbours));
  return {};
}

Result<NormalResult> with_normals(PointCloud cloud, const NormalOptions& options, std::stop_token stop) {
  if (auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  auto graph = build_surface_graph(cloud.points, static_cast<std::size_t>(options.neighbours), stop);
  if (!graph) return tl::unexpected{graph.error()};
  return with_normals(std::move(cloud), std::make_shared<SurfaceGraph>(std::move(*graph)), options, stop);
}

Result<NormalResult> with_normals(PointCloud cloud, std::shared_ptr<SurfaceGraph> graph, const NormalOptions& options,
                                  std::stop_token stop) {
  if (auto valid = options.validate(); !valid) return tl::unexpected{valid.error()};
  NormalReport report;
  report.estimated = true;
  std::vector<std::int8_t> side = look_outside(cloud.points, *graph);
  auto chosen = choose_sides(cloud.points, *graph, side, stop);
  if (!chosen) return tl::unexpected{chosen.error()};
  report.pieces = chosen->pieces;
  report.uncertain_points = chosen->uncertain_points;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    if (chosen->turned[i]) {
      graph->normal[i] = -graph->normal[i];
      side[i] = static_cast<std::int8_t>(-side[i]);
    }
  judge(report, cloud.points, *graph, side);
  cloud.normals = graph->normal;
  return NormalResult{std::move(cloud), report, std::move(side)};
}

Result<std::shared_ptr<SurfaceGraph>> surface_graph_of(const PointCloud& cloud, std::stop_token stop) {
  auto graph = build_surface_graph(cloud.points, static_cast<std::size_t>(NormalOptions{}.neighbours), stop);
  if (!graph) return tl::unexpected{graph.error()};
  return std::make_shared<SurfaceGraph>(std::move(*graph));
}

SurfaceFacts facts_of(const SurfaceGraph& graph) {
  SurfaceFacts facts{graph.area, graph.normal, graph.neighbour, graph.k, {}, 0};
  facts.piece = pieces_of(graph, facts.pieces);
  return facts;
}

std::string to_json(const NormalReport& report) {
  return fmt::format(
      R"({{"estimated":{},"pieces":{},"flipped_points":{},"disagreeing_points":{},"replaced_points":{},"winding_agreement":{:.6f},"by_winding":{},"neighbour_agreement":{:.6f},"outside_agreement":{:.6f},"outside_known":{:.6f},"uncertain_points":{}}})",
      report.estimated, report.pieces, report.flipped_points, report.disagreeing_points, report.replaced_points,
      report.winding_agreement, report.by_winding, report.neighbour_agreement, report.outside_agreement,
      report.outside_known, report.uncertain_points);
}

}  // namespace telefab::scan
