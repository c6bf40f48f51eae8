#include <algorithm>
#include <cmath>
#include <telefab/fab/mask/column_caps.hpp>

#include "cover_cells.hpp"

namespace telefab::fab {
namespace {

constexpr int kSolidFrom = 32;
constexpr int kMostReach = 64;

/// Factors of all layers of a column with an underside: dark from below until the rest cures to the underside at most.
std::vector<double> factors_of(int layers, const MaskLight& light) {
  std::vector<double> factors(static_cast<std::size_t>(layers), 1.0);
  const double per_layer = light.layer_mm / light.penetration_mm;
  double rest = 0;
  for (int i = layers - 1; i >= 0; --i) {
    const double reaches = light.white * std::exp(-(i + 1) * per_layer);
    factors[static_cast<std::size_t>(i)] = std::clamp((1 - rest) / reaches, 0.0, 1.0);
    rest += factors[static_cast<std::size_t>(i)] * reaches;
  }
  return factors;
}

}  // namespace

CapTable::CapTable(const MaskLight& light, int most_above) : most_above_{std::clamp(most_above, 0, kMostReach)} {
  for (int below = 0; below < kMostReach; ++below) {
    std::vector<std::uint8_t> row;
    for (int above = 0; above <= most_above_; ++above)
      row.push_back(static_cast<std::uint8_t>(
          std::lround(255 * factors_of(below + 1 + above, light)[static_cast<std::size_t>(below)])));
    if (std::all_of(row.begin(), row.end(), [](std::uint8_t cap) { return cap == 255; })) break;
    caps_.insert(caps_.end(), row.begin(), row.end());
    ++reach_;
  }
}

std::uint8_t CapTable::cap(int below, int above) const {
  if (below >= reach_) return 255;
  return caps_[static_cast<std::size_t>(below * (most_above_ + 1) + std::min(above, most_above_))];
}

SolidRows::SolidRows(std::span<const Contour> part, std::span<const Contour> supports, const MaskFrame& frame) {
  const CoverCells a{part, frame}, b{supports, frame};
  const std::size_t width = frame.size.width_px;
  std::vector<std::uint8_t> row(width), other(width);
  starts_.reserve(std::size_t{frame.size.height_px} + 1);
  for (std::uint32_t y = 0; y < frame.size.height_px; ++y) {
    starts_.push_back(static_cast<std::uint32_t>(runs_.size()));
    const bool any = !a.empty(y), more = !b.empty(y);
    if (!any && !more) continue;
    a.fill(y, row.data());
    if (more) {
      b.fill(y, other.data());
      for (std::size_t x = 0; x < width; ++x) row[x] = std::max(row[x], other[x]);
    }
    for (std::size_t x = 0; x < width;) {
      while (x < width && row[x] < kSolidFrom) ++x;
      const std::size_t first = x;
      while (x < width && row[x] >= kSolidFrom) ++x;
      if (x > first) runs_.push_back({static_cast<std::int32_t>(first), static_cast<std::int32_t>(x)});
    }
  }
  starts_.push_back(static_cast<std::uint32_t>(runs_.size()));
}

std::span<const SolidRows::Run> SolidRows::row(std::uint32_t y) const {
  return {runs_.data() + starts_[y], starts_[y + 1] - starts_[y]};
}

LayerCaps::LayerCaps(const CapTable& table, const SolidRows& here, std::vector<const SolidRows*> below,
                     std::vector<const SolidRows*> above, bool on_platform)
    : table_{&table}, here_{&here}, below_{std::move(below)}, above_{std::move(above)}, on_platform_{on_platform} {}

bool LayerCaps::fill(std::uint32_t y, std::span<std::uint8_t> row) const {
  const auto solid = here_->row(y);
  if (solid.empty() || table_->reach() == 0 || (below_.empty() && on_platform_)) return false;
  const auto from = static_cast<std::size_t>(solid.front().first),
             until = static_cast<std::size_t>(solid.back().behind);
  // Solid layers in an unbroken column: a count that stops growing at the first gap.
  const auto count = [&](const std::vector<const SolidRows*>& layers, std::vector<std::uint8_t>& counts) {
    counts.assign(until - from, 0);
    for (std::size_t k = 0; k < layers.size(); ++k)
      for (const SolidRows::Run& run : layers[k]->row(y)) {
        const auto first = std::max(from, static_cast<std::size_t>(run.first));
        const auto behind = std::min(until, static_cast<std::size_t>(run.behind));
        for (std::size_t x = first; x < behind; ++x)
          counts[x - from] = static_cast<std::uint8_t>(counts[x - from] + (counts[x - from] == k));
      }
  };
  std::vector<std::uint8_t> below, above;
  count(below_, below);
  const auto reach = static_cast<std::size_t>(table_->reach());
  const bool grounded = on_platform_ && below_.size() < reach;
  const auto free = [&](std::size_t i) { return below[i] >= reach || (grounded && below[i] == below_.size()); };
  bool any = false;
  for (const SolidRows::Run& run : solid)
    for (auto x = static_cast<std::size_t>(run.first); x < static_cast<std::size_t>(run.behind) && !any; ++x)
      any = !free(x - from);
  if (!any) return false;
  count(above_, above);
  std::fill(row.begin(), row.end(), std::uint8_t{255});
  for (const SolidRows::Run& run : solid)
    for (auto x = static_cast<std::size_t>(run.first); x < static_cast<std::size_t>(run.behind); ++x)
      if (!free(x - from)) row[x] = table_->cap(below[x - from], above[x - from]);
  return true;
}

}  // namespace telefab::fab
