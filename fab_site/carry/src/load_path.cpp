// SPDX-License-Identifier: GPL-3.0-or-later
#include "load_path.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <telefab/base/disjoint_sets.hpp>
#include <unordered_map>

namespace telefab::fab {
namespace {

/// Sums over the pixels of a section, in pixels.
struct Sums {
  std::int64_t count = 0;
  double x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  double low_x = std::numeric_limits<double>::infinity(), high_x = -low_x;
  double low_y = low_x, high_y = -low_x;
  double low_sum = low_x, high_sum = -low_x;    // of x + y
  double low_diff = low_x, high_diff = -low_x;  // of x - y

  void add(std::int32_t first, std::int32_t behind, std::uint32_t row) {
    const double a = first, b = behind, n = b - a, low = row, high = row + 1.0, mid = row + 0.5;
    count += behind - first;
    x += n * (a + b) / 2;
    y += n * mid;
    xx += (b * b * b - a * a * a) / 3;
    xy += n * (a + b) / 2 * mid;
    yy += n * (mid * mid + 1.0 / 12);
    low_x = std::min(low_x, a), high_x = std::max(high_x, b);
    low_y = std::min(low_y, low), high_y = std::max(high_y, high);
    low_sum = std::min(low_sum, a + low), high_sum = std::max(high_sum, b + high);
    low_diff = std::min(low_diff, a - high), high_diff = std::max(high_diff, b - low);
  }
};

Section section_of(const Sums& s, std::uint32_t upper, std::uint32_t lower, double pitch_mm) {
  const auto n = static_cast<double>(s.count);
  const double x = s.x / n, y = s.y / n, area = pitch_mm * pitch_mm, diagonal = pitch_mm / std::numbers::sqrt2;
  Section out;
  out.upper = upper, out.lower = lower;
  out.pixels = s.count;
  out.area_mm2 = n * area;
  out.middle = {x * pitch_mm, y * pitch_mm};
  out.xx = (s.xx / n - x * x) * area;
  out.xy = (s.xy / n - x * y) * area;
  out.yy = (s.yy / n - y * y) * area;
  out.reach_mm = {(s.high_x - x) * pitch_mm, (s.high_sum - (x + y)) * diagonal,
                  (s.high_y - y) * pitch_mm, ((x - y) - s.low_diff) * diagonal,
                  (x - s.low_x) * pitch_mm,  ((x + y) - s.low_sum) * diagonal,
                  (y - s.low_y) * pitch_mm,  (s.high_diff - (x - y)) * diagonal};
  return out;
}

}  // namespace

double Section::along(Point2 v) const {
  // A vector between two neighbouring directions is a sum of multiples of both; so is a bound of the reach.
  constexpr double kEighth = std::numbers::pi / 4;
  const double length = std::hypot(v.x_mm, v.y_mm);
  if (length == 0) return 0;
  double turn = std::atan2(v.y_mm, v.x_mm) / kEighth;
  if (turn < 0) turn += 8;
  const auto i = static_cast<std::size_t>(turn) % 8;
  const double beyond = (turn - std::floor(turn)) * kEighth;
  const double sine = std::sin(kEighth);
  return length * (reach_mm[i] * std::sin(kEighth - beyond) + reach_mm[(i + 1) % 8] * std::sin(beyond)) / sine;
}

namespace {

using Meetings = std::vector<std::pair<std::uint64_t, Sums>>;  ///< by pieces above and below, as they are met

/// What the runs of two layers share, by the pieces that they belong to.
Meetings meetings_of(const LayerRuns& here, std::span<const std::uint32_t> piece_here, const LayerRuns& below,
                     std::span<const std::uint32_t> piece_below) {
  Meetings meetings;
  std::unordered_map<std::uint64_t, std::size_t> number;
  std::uint32_t row = 0;
  for_overlaps(here, below, [&](std::uint32_t upper, std::uint32_t lower) {
    while (row + 1 < here.size().height_px && upper >= here.row_start(row + 1)) ++row;
    const std::uint64_t key = std::uint64_t{piece_here[upper]} << 32U | piece_below[lower];
    const auto [at, is_new] = number.try_emplace(key, meetings.size());
    if (is_new) meetings.emplace_back(key, Sums{});
    const PixelRun &a = here.run(upper), &b = below.run(lower);
    meetings[at->second].second.add(std::max(a.first, b.first), std::min(a.behind, b.behind), row);
  });
  return meetings;
}

std::vector<Sums> sums_of(const LayerRuns& layer, std::span<const std::uint32_t> part_of, std::size_t parts) {
  std::vector<Sums> sums(parts);
  for (std::uint32_t y = 0; y < layer.size().height_px; ++y)
    for (std::uint32_t r = layer.row_start(y); r < layer.row_start(y) + layer.row(y).size(); ++r)
      sums[part_of[r]].add(layer.run(r).first, layer.run(r).behind, y);
  return sums;
}

/// What pulls on a part of a layer, as so many pixels of it would, and the sum of its places.
struct Pulled {
  double pixels = 0, x = 0, y = 0;
  void add(double more, double at_x, double at_y) { pixels += more, x += more * at_x, y += more * at_y; }
};

/// Of each part, in pixels. Level and upright edges of pixels alone are counted, and taken to run in all directions
/// alike: right for discs, a fifth too short for squares along the axes, so that the pull errs upwards.
std::vector<double> perimeters_of(const LayerRuns& solid, std::span<const std::uint32_t> part_of, std::size_t parts) {
  std::vector<double> edges(parts);
  for (std::uint32_t y = 0; y < solid.size().height_px; ++y) {
    const auto row = solid.row(y);
    const std::uint32_t start = solid.row_start(y);
    for (std::uint32_t r = 0; r < row.size(); ++r) edges[part_of[start + r]] += 2 + 2 * row[r].width();
    if (y == 0) continue;
    const auto below = solid.row(y - 1);
    for (std::uint32_t i = 0, j = 0; i < row.size() && j < below.size();) {
      const std::int32_t shared = std::min(row[i].behind, below[j].behind) - std::max(row[i].first, below[j].first);
      if (shared > 0) edges[part_of[start + i]] -= 2 * shared;
      row[i].behind < below[j].behind ? ++i : ++j;
    }
  }
  for (double& e : edges) e *= std::numbers::pi / 4;
  return edges;
}

/// Adds the vacuum of hollows that open in the layer to the parts around them. One layer's dimple is none.
void add_vacuum(const HollowWatch& hollows, std::uint32_t layer, double share, const LayerRuns& solid,
                std::span<const std::uint32_t> part_of, std::vector<Pulled>& pulled) {
  const LayerRuns& empty = hollows.empty();
  for (const HollowWatch::Opening& opening : hollows.openings()) {
    if (opening.since == layer) continue;
    // The rows of runs: they rise with the runs.
    std::uint32_t y = 0;
    std::optional<std::uint32_t> part;
    for (const std::uint32_t r : opening.runs) {
      while (y + 1 < empty.size().height_px && r >= empty.row_start(y + 1)) ++y;
      const PixelRun& gap = empty.run(r);
      if (!part) {
        const auto row = solid.row(y);
        const auto left =
            std::find_if(row.begin(), row.end(), [&](const PixelRun& s) { return s.behind == gap.first; });
        part = part_of[solid.row_start(y) + static_cast<std::uint32_t>(left - row.begin())];
      }
      pulled[*part].add(share * gap.width(), (gap.first + gap.behind) / 2.0, y + 0.5);
    }
  }
}

}  // namespace

void LoadPath::add(const LayerRuns& solid, const LayerRuns& firm, const LayerLight* light, double pull_share) {
  const auto index = static_cast<std::uint32_t>(first_piece_.size());
  first_piece_.push_back(static_cast<std::uint32_t>(pieces_.size()));
  first_section_.push_back(static_cast<std::uint32_t>(sections_.size()));

  const LayerRuns& joined = light ? light->joined : solid;
  const RunComponents parts = components_of(joined, true);
  const auto parts_of = [&](const LayerRuns& some) {
    std::vector<std::uint32_t> part_of(some.count());
    for_overlaps(some, joined, [&](std::uint32_t run, std::uint32_t whole) { part_of[run] = parts.of_run[whole]; });
    return part_of;
  };
  auto piece_of_run = parts_of(solid), piece_of_firm = parts_of(firm);
  const auto all = sums_of(solid, piece_of_run, parts.components.size());
  const auto strong = sums_of(firm, piece_of_firm, parts.components.size());
  std::vector<std::int64_t> lit(parts.components.size());
  if (light)
    for_overlaps(solid, light->lit, [&](std::uint32_t here, std::uint32_t there) {
      const PixelRun &a = solid.run(here), &b = light->lit.run(there);
      lit[piece_of_run[here]] += std::min(a.behind, b.behind) - std::max(a.first, b.first);
    });
  std::vector<Pulled> pulled(all.size());
  const auto perimeter =
      options_.doubled_at_mm > 0 ? perimeters_of(solid, piece_of_run, all.size()) : std::vector<double>{};
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].count == 0 || (light && lit[i] < kLeastIslandPixels)) continue;
    const auto n = static_cast<double>(all[i].count);
    const double by_size = perimeter.empty() ? 1 : 1 + n / perimeter[i] * options_.pitch_mm / options_.doubled_at_mm;
    const Sums& sums = strong[i].count > 0 ? strong[i] : all[i];
    const auto of = static_cast<double>(sums.count);
    pulled[i].add(n * by_size, sums.x / of, sums.y / of);
  }
  if (options_.vacuum_share > 0) {
    hollows_.add(solid);
    add_vacuum(hollows_, index, options_.vacuum_share, solid, piece_of_run, pulled);
  }
  // Of what only joins others there may be nothing solid.
  std::vector<std::uint32_t> piece_of_part(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].count == 0) continue;
    piece_of_part[i] = static_cast<std::uint32_t>(pieces_.size());
    const Sums& sums = strong[i].count > 0 ? strong[i] : all[i];
    const auto n = static_cast<double>(sums.count);
    Piece piece{index, sums.count, 0, {}, {sums.x / n * options_.pitch_mm, sums.y / n * options_.pitch_mm}};
    if (const Pulled& p = pulled[i]; p.pixels > 0) {
      piece.pulled = std::llround(p.pixels * pull_share * kPullUnits);
      piece.pulled_at = {p.x / p.pixels * options_.pitch_mm, p.y / p.pixels * options_.pitch_mm};
    }
    pieces_.push_back(piece);
  }
  for (auto* runs : {&piece_of_run, &piece_of_firm})
    for (std::uint32_t& part : *runs) part = piece_of_part[part];

  if (index > 0) {
    std::unordered_map<std::uint64_t, Sums> firm_ones;
    for (const auto& [key, met] : meetings_of(firm, piece_of_firm, firm_below_, firm_piece_below_))
      firm_ones.emplace(key, met);
    for (const auto& [key, met] : meetings_of(solid, piece_of_run, below_, piece_below_)) {
      const auto at = firm_ones.find(key);
      sections_.push_back(section_of(at == firm_ones.end() ? met : at->second, static_cast<std::uint32_t>(key >> 32U),
                                     static_cast<std::uint32_t>(key), options_.pitch_mm));
    }
  }
  below_ = solid, firm_below_ = firm;
  piece_below_ = std::move(piece_of_run), firm_piece_below_ = std::move(piece_of_firm);
}

std::uint32_t LoadPath::first_piece(std::uint32_t layer) const {
  return layer < first_piece_.size() ? first_piece_[layer] : static_cast<std::uint32_t>(pieces_.size());
}

std::uint32_t LoadPath::first_section(std::uint32_t layer) const {
  return layer < first_section_.size() ? first_section_[layer] : static_cast<std::uint32_t>(sections_.size());
}

LoadPath LoadPath::without(std::span<const std::uint32_t> torn, std::vector<std::uint32_t>& kept) const {
  LoadPath rest{options_};
  rest.pieces_ = pieces_;
  rest.first_piece_ = first_piece_;
  kept.clear();
  for (std::uint32_t k = 0; k < layers(); ++k) {
    rest.first_section_.push_back(static_cast<std::uint32_t>(rest.sections_.size()));
    for (std::uint32_t s = first_section(k); s < first_section(k + 1); ++s) {
      if (std::find(torn.begin(), torn.end(), s) != torn.end()) continue;
      rest.sections_.push_back(sections_[s]);
      kept.push_back(s);
    }
  }
  rest.close();
  return rest;
}

void LoadPath::close() {
  stands_.assign(pieces_.size(), 0);
  steps_.assign(pieces_.size(), {});
  DisjointSets joined{pieces_.size() + 1};
  const auto ground = static_cast<std::uint32_t>(pieces_.size());
  for (std::uint32_t k = 0; k < layers(); ++k) {
    const std::uint32_t from = first_piece(k), to = first_piece(k + 1);
    if (k == 0)
      for (std::uint32_t p = from; p < to; ++p) joined.join(p, ground);
    std::vector<std::int64_t> widest(to - from);
    for (std::uint32_t s = first_section(k); s < first_section(k + 1); ++s) {
      const Section& section = sections_[s];
      joined.join(section.upper, section.lower);
      if (section.pixels <= widest[section.upper - from]) continue;
      widest[section.upper - from] = section.pixels;
      steps_[section.upper] = {section.lower, options_.thickness_mm / section.area_mm2};
    }
    for (std::uint32_t p = from; p < to; ++p) {
      stands_[p] = joined.root(p) == joined.root(ground);
      // What hangs from above: as if a column of its own area stood below it.
      if (k > 0 && steps_[p].next == kPlatform)
        steps_[p].softness = k * options_.thickness_mm / (static_cast<double>(pieces_[p].pixels) * pixel_mm2());
    }
  }
}

}  // namespace telefab::fab
