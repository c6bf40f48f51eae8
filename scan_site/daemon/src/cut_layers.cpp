// SPDX-License-Identifier: GPL-3.0-or-later
#include "cut_layers.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/service/saved_message.hpp>

namespace telefab::scan {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostStacks = 2;
/// Chunks of 64 layers; the slider goes to and fro.
constexpr std::size_t kMostChunks = 6;

Result<std::string> not_cut(const Job& job, std::uint32_t layer, std::uint32_t there) {
  return fail(ErrorCode::NotFound,
              there == 0 ? fmt::format("no layer of job {} is cut yet", job.id)
                         : fmt::format("layer {} of job {} is not cut; {} are, from 0", layer, job.id, there));
}

/// Places to a micrometre: a hundredth of a pixel is not to be seen.
double rounded(double mm) { return std::round(mm * 1000) / 1000; }

std::string text_of(const StackHeader& header, const Layer& layer) {
  Json rings = Json::array(), kinds = Json::array();
  for (const Contour& contour : layer.contours) {
    Json ring = Json::array(), runs = Json::array();
    for (const Point2 v : contour.vertices()) ring.push_back({rounded(v.x_mm), rounded(v.y_mm)});
    for (const SurfaceRun& run : contour.runs()) runs.push_back({name_of(run.kind), run.edges});
    // Kept as no run at all, which whoever draws would leave out.
    if (runs.empty()) runs.push_back({name_of(SurfaceClass::Measured), contour.vertices().size()});
    rings.push_back(std::move(ring));
    kinds.push_back(std::move(runs));
  }
  const Bounds2& b = header.bounds;
  return json_text({{"layer", layer.index.count()},
                    {"layers", header.layer_count},
                    {"z_mm", layer.z_mm},
                    {"thickness_mm", header.layer_thickness_mm},
                    {"bounds", {b.min.x_mm, b.min.y_mm, b.max.x_mm, b.max.y_mm}},
                    {"certified", layer.certificate.is_certified()},
                    {"rings", rings},
                    {"kinds", kinds}});
}

}  // namespace

Result<CutLayers::Stack*> CutLayers::stack_of(const Job& job, const std::filesystem::path& folder) {
  if (const auto found = stacks_.find(job.id); found != stacks_.end()) {
    found->second.used = ++uses_;
    return &found->second;
  }
  const auto offer = saved_offer(folder);
  std::error_code error;
  if (!offer || !std::filesystem::exists(folder / "chunks", error))
    return fail(ErrorCode::NotFound, fmt::format("no layer of job {} is cut yet", job.id));
  auto decoder = StackDecoder::start(offer->header);
  if (!decoder) return tl::unexpected{decoder.error()};
  Stack stack;
  stack.decoder = std::make_unique<StackDecoder>(std::move(*decoder));
  if (is_final(job.state)) {
    // Nobody else works on it any more.
    auto spool = ChunkSpool::look_into(folder / "chunks");
    if (!spool) return tl::unexpected{spool.error()};
    stack.spool = std::make_shared<SharedSpool>(std::move(*spool));
  } else {
    auto spool = spools_.of(job.id, folder);
    if (!spool) return tl::unexpected{spool.error()};
    stack.spool = std::move(*spool);
  }
  stack.used = ++uses_;
  if (stacks_.size() >= kMostStacks)
    stacks_.erase(std::min_element(stacks_.begin(), stacks_.end(),
                                   [](const auto& a, const auto& b) { return a.second.used < b.second.used; }));
  return &stacks_.emplace(job.id, std::move(stack)).first->second;
}

Result<std::string> CutLayers::json(const Job& job, const std::filesystem::path& folder, std::uint32_t layer) {
  const auto found = stack_of(job, folder);
  if (!found) return tl::unexpected{found.error()};
  Stack& stack = **found;
  const auto [layers, found_in] = stack.spool->with([&](const ChunkSpool& s) {
    return std::pair{s.layer_count(), s.sequence_of(LayerIndex{layer})};
  });
  if (!found_in) return not_cut(job, layer, layers);
  const std::uint32_t sequence = *found_in;
  auto kept = stack.chunks.find(sequence);
  if (kept == stack.chunks.end()) {
    const auto chunk = stack.spool->with([&](const ChunkSpool& s) { return s.read(sequence); });
    if (!chunk) return tl::unexpected{chunk.error()};
    auto decoded = stack.decoder->decode({chunk->sequence, chunk->first_layer, chunk->layer_count, chunk->payload});
    if (!decoded) return tl::unexpected{decoded.error()};
    if (stack.chunks.size() >= kMostChunks)
      // The one farthest from where the slider is.
      stack.chunks.erase(sequence > stack.chunks.begin()->first ? stack.chunks.begin() : std::prev(stack.chunks.end()));
    kept = stack.chunks.emplace(sequence, std::move(*decoded)).first;
  }
  const std::vector<Layer>& decoded = kept->second;
  const auto there = std::ranges::find(decoded, LayerIndex{layer}, &Layer::index);
  if (there == decoded.end())
    return fail(ErrorCode::NotTrusted, fmt::format("chunk {} of job {} has no layer {}", sequence, job.id, layer));
  return text_of(stack.decoder->header(), *there);
}

}  // namespace telefab::scan
