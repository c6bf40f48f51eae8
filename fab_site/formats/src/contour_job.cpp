// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/fab/formats/contour_job.hpp>
#include <telefab/fab/region/region.hpp>

namespace telefab::fab {

std::string_view name_of(PartKind kind) { return kind == PartKind::Part ? "part" : "supports"; }

ContourJob contour_job(const LayerStack& stack, Point2 platform_mm) {
  ContourJob job;
  job.name = stack.header().scan_name;
  job.machine = stack.header().machine;
  job.thickness_mm = stack.header().layer_thickness_mm;
  job.layer_count = stack.header().layer_count;
  job.platform_mm = platform_mm;
  ContourPart& part = job.parts.emplace_back();
  for (const Layer& layer : stack.layers()) part.layers.push_back(layer.contours);
  return job;
}

Result<ContourJob> contour_job(const LayerStack& stack, Point2 platform_mm,
                               std::vector<std::vector<Contour>> supports) {
  ContourJob job = contour_job(stack, platform_mm);
  if (supports.size() < job.layer_count)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} layers of supports for a part of {}; they are of different jobs", supports.size(),
                            job.layer_count));
  const std::size_t elevation = supports.size() - job.layer_count;
  auto& part = job.parts.front().layers;
  part.insert(part.begin(), elevation, {});
  job.layer_count = static_cast<std::uint32_t>(supports.size());
  bool any = false;
  for (std::size_t i = 0; i < supports.size(); ++i) {
    if (supports[i].empty()) continue;
    any = true;
    if (part[i].empty()) continue;
    const auto held = Region::from_contours(part[i]);
    const auto holding = Region::from_contours(supports[i]);
    if (!held) return tl::unexpected{held.error()};
    if (!holding) return tl::unexpected{holding.error()};
    supports[i] = subtract(*holding, *held).to_contours();
  }
  if (any) job.parts.push_back({PartKind::Supports, std::move(supports)});
  return job;
}

Result<std::vector<Contour>> united(const ContourJob& job, std::uint32_t layer) {
  std::vector<Region> regions;
  const std::vector<Contour>* only = nullptr;
  for (const ContourPart& part : job.parts) {
    if (part.layers[layer].empty()) continue;
    only = &part.layers[layer];
    auto region = Region::from_contours(*only);
    if (!region) return tl::unexpected{region.error()};
    regions.push_back(std::move(*region));
  }
  if (only == nullptr) return std::vector<Contour>{};
  return regions.size() == 1 ? *only : unite(regions).to_contours();
}

Bounds2 bounds_of(const ContourJob& job) {
  Bounds2 all = Bounds2::nothing();
  for (const ContourPart& part : job.parts)
    for (const auto& layer : part.layers)
      for (const Contour& ring : layer) all.include(ring.bounds());
  return all.is_nothing() ? Bounds2{} : all;
}

std::uint64_t vertex_count(const ContourJob& job) {
  std::uint64_t count = 0;
  for (const ContourPart& part : job.parts)
    for (const auto& layer : part.layers)
      for (const Contour& ring : layer) count += ring.vertices().size();
  return count;
}

}  // namespace telefab::fab
