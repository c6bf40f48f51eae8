// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <charconv>
#include <telefab/geometry/limits.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {
namespace {

/// Two whole numbers with a mark between them, and nothing else.
std::optional<std::array<std::uint32_t, 2>> pair_from(std::string_view text, char mark) {
  std::array<std::uint32_t, 2> pair{};
  const char* at = text.data();
  const char* const end = at + text.size();
  for (std::size_t i = 0; i < 2; ++i) {
    const auto [after, error] = std::from_chars(at, end, pair[i]);
    if (error != std::errc{} || (i == 0 ? after == end || *after != mark : after != end)) return std::nullopt;
    at = after + 1;
  }
  return pair;
}

}  // namespace

Result<std::array<std::uint32_t, 2>> layers_from(std::string_view text) {
  if (const auto range = pair_from(text, ':')) return *range;
  return fail(ErrorCode::InvalidInput, fmt::format("{} must be FIRST:LAST, e.g. 0:99", text));
}

Result<LayerShare> layer_share_from(std::string_view text) {
  const auto pair = pair_from(text, '/');
  if (!pair || (*pair)[0] < 1 || (*pair)[0] > (*pair)[1] || (*pair)[1] > kMaxLayers)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} must be I/N with I from 1 to N, and N at most {}, e.g. 3/8", text, kMaxLayers));
  return LayerShare{(*pair)[0], (*pair)[1]};
}

LayerRange share_of(const LayerRange& range, const LayerShare& share) {
  const auto until = [&](std::uint64_t shares) {
    return range.first + static_cast<std::uint32_t>(shares * range.count() / share.count);
  };
  return {until(share.index - 1), until(share.index)};
}

Result<LayerRange> range_of(const SliceRequest& request, std::uint32_t layer_count) {
  LayerRange range{0, layer_count};
  if (request.layers) {
    const auto [first, last] = *request.layers;
    if (first > last || last >= layer_count)
      return fail(ErrorCode::InvalidInput, fmt::format("layers {}:{} are not in 0:{}", first, last, layer_count - 1));
    range = {first, last + 1};
  }
  return request.share ? share_of(range, *request.share) : range;
}

}  // namespace telefab::scan
