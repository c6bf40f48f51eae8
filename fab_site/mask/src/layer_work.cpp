// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "blend_model.hpp"
#include "cover_cells.hpp"
#include "edge_samples.hpp"
#include "tile_problem.hpp"

namespace telefab::fab {
namespace {

constexpr int kCore = DoseTiles::kSide;
constexpr float kSnap = 1e-4F;           // shares of a white dose that make no difference
constexpr int kSolid = 32;               // cover from which a pixel has a cap of its own, as in SolidRows
constexpr int kBeside = 2;               // pixels
constexpr std::size_t kInterleave = 16;  // neighbours on a contour wait for each other's stores
constexpr std::uint8_t kAll = 255;       // cover of a whole pixel, and no cap

bool is_even(const std::uint8_t* row, std::size_t count) { return std::memcmp(row, row + 1, count - 1) == 0; }

using Model = MaskBlender::Model;

/// Spots by tile, those of halos included.
struct SpotLists {
  std::vector<std::uint32_t> starts;
  std::vector<std::uint32_t> spots;
};
SpotLists lists_of(const std::vector<EdgeSpot>& spots, const Model& m, int columns, int rows) {
  const int taps = m.weights.taps(), reach = m.halo - taps / 2;
  const auto each_tile = [&](const EdgeSpot& spot, auto&& visit) {
    if (spot.x_px < 0 || spot.y_px < 0 || spot.x_px > m.frame.size.width_px || spot.y_px > m.frame.size.height_px)
      return;
    const auto tile = [&](double place) { return static_cast<int>(std::floor(place / kCore)); };
    const int left = std::max(0, tile(spot.x_px - reach)), right = std::min(columns - 1, tile(spot.x_px + reach));
    const int front = std::max(0, tile(spot.y_px - reach)), back = std::min(rows - 1, tile(spot.y_px + reach));
    for (int y = front; y <= back; ++y)
      for (int x = left; x <= right; ++x) visit(static_cast<std::size_t>(y * columns + x));
  };
  SpotLists lists;
  lists.starts.assign(static_cast<std::size_t>(columns * rows) + 1, 0);
  for (const EdgeSpot& spot : spots) each_tile(spot, [&](std::size_t t) { ++lists.starts[t + 1]; });
  for (std::size_t t = 1; t < lists.starts.size(); ++t) lists.starts[t] += lists.starts[t - 1];
  lists.spots.resize(lists.starts.back());
  std::vector<std::uint32_t> next(lists.starts.begin(), lists.starts.end() - 1);
  for (std::uint32_t i = 0; i < spots.size(); ++i)
    each_tile(spots[i], [&](std::size_t t) { lists.spots[next[t]++] = i; });
  return lists;
}

/// Rows of cover around one row of tiles, with margins left and right so that halos need no care.
class Strip {
 public:
  Strip(const Model& m) : halo_{m.halo}, size_{m.frame.size}, side_{m.side} {
    stride_ = ((size_.width_px + kCore - 1) / kCore) * kCore + 2 * static_cast<std::size_t>(halo_);
  }
  /// Covers rows from `front` - halo on.
  void fill(const CoverCells& cells, int front) {
    any_ = false;
    for (int y = front - halo_; y < front - halo_ + side_ && !any_; ++y)
      any_ = y >= 0 && y < static_cast<int>(size_.height_px) && !cells.empty(static_cast<std::uint32_t>(y));
    if (!any_) return;
    rows_.resize(stride_ * static_cast<std::size_t>(side_));
    for (int i = 0; i < side_; ++i) {
      const int y = front - halo_ + i;
      std::uint8_t* row = rows_.data() + static_cast<std::size_t>(i) * stride_;
      if (y < 0 || y >= static_cast<int>(size_.height_px) || cells.empty(static_cast<std::uint32_t>(y))) {
        std::memset(row, 0, stride_);
        continue;
      }
      cells.fill(static_cast<std::uint32_t>(y), row + halo_);
      std::memset(row, 0, static_cast<std::size_t>(halo_));
      std::memset(row + halo_ + size_.width_px, 0, stride_ - static_cast<std::size_t>(halo_) - size_.width_px);
    }
  }
  [[nodiscard]] bool any() const { return any_; }
  /// Row `i` of the strip from column x - halo on.
  [[nodiscard]] const std::uint8_t* row(int i, int x) const {
    return rows_.data() + static_cast<std::size_t>(i) * stride_ + static_cast<std::size_t>(x);
  }

 private:
  int halo_;
  PixelSize size_;
  int side_;
  std::size_t stride_;
  bool any_ = false;
  std::vector<std::uint8_t> rows_;
};

/// One layer at work.
class LayerWork {
 public:
  LayerWork(const Model& m, const BlendTask& task, int iterations, DoseTiles* above)
      : m_{m},
        task_{task},
        iterations_{iterations},
        above_{above},
        part_{task.part, m.frame},
        inner_{task.part, m.frame, m.inwards_px},
        supports_{task.supports, m.frame},
        spots_{edge_spots(task.part, m.frame.pixel_pitch_mm, {.corner_weight = m.options.corner_weight})},
        part_strip_{m},
        inner_strip_{m},
        support_strip_{m} {
    light_ = static_cast<float>(task.exposure);
    if (iterations > 0) problem_.resize(m.side);
    problem_.target = m.target;
    problem_.regular = static_cast<float>(m.options.regular);
    problem_.weights = &m.weights;
    h_.resize(static_cast<std::size_t>(m.side) * static_cast<std::size_t>(m.side));
    field_.assign(h_.size(), 1.0F);
    steady_dose_ = m.passed / (1 - m.passed);
    for (auto* row : {&nothing_, &row_caps_, &attached_, &attached_columns_})
      row->assign(static_cast<std::size_t>(m.side), 0);
    all_.assign(static_cast<std::size_t>(m.side), kAll);
  }

  BlendedLayer run() {
    const PixelSize size = m_.frame.size;
    const DoseTiles grid{size};
    const SpotLists lists = lists_of(spots_, m_, grid.columns(), grid.rows());
    BlendedLayer out{{size, std::vector<std::uint8_t>(std::size_t{size.width_px} * size.height_px)}, {}};
    for (int row = 0; row < grid.rows(); ++row) {
      part_strip_.fill(part_, row * kCore);
      support_strip_.fill(supports_, row * kCore);
      if (part_strip_.any()) {
        inner_strip_.fill(inner_, row * kCore);
        fill_caps(row * kCore);
      }
      const bool lit = part_strip_.any() || support_strip_.any();
      for (int column = 0; column < grid.columns(); ++column) {
        const auto t = static_cast<std::size_t>(row * grid.columns() + column);
        if (lit) draw_cover(out.mask, column, row);
        if (lists.starts[t] != lists.starts[t + 1]) {
          if (task_.out_of_time && task_.out_of_time()) {
            ++out.figures.unsolved;
          } else {
            solve(out, column, row, {lists.spots.data() + lists.starts[t], lists.starts[t + 1] - lists.starts[t]});
          }
        }
        if (above_) pass_on(out.mask, column, row);
      }
    }
    return out;
  }

 private:
  [[nodiscard]] std::uint8_t* grey_row(Mask& mask, int x, int y) const {
    return mask.rows.data() +
           std::size_t{m_.frame.size.height_px - 1 - static_cast<std::uint32_t>(y)} * m_.frame.size.width_px +
           static_cast<std::size_t>(x);
  }
  /// Caps of row i of the strip from column x on; nothing where there are none.
  [[nodiscard]] const std::uint8_t* cap_row(int i, int x) const {
    const auto at = static_cast<std::size_t>(i);
    if (at >= capped_.size() || !capped_[at]) return nullptr;
    return caps_.data() + at * m_.frame.size.width_px + static_cast<std::size_t>(x);
  }
  void fill_caps(int front) {
    if (!task_.caps) return;
    const std::size_t width = m_.frame.size.width_px;
    caps_.resize(width * static_cast<std::size_t>(m_.side));
    capped_.assign(static_cast<std::size_t>(m_.side), 0);
    for (int i = 0; i < m_.side; ++i) {
      const int y = front - m_.halo + i;
      if (y < 0 || y >= static_cast<int>(m_.frame.size.height_px)) continue;
      const auto at = static_cast<std::size_t>(i);
      capped_[at] = task_.caps(static_cast<std::uint32_t>(y), {caps_.data() + at * width, width});
    }
  }
  [[nodiscard]] int width_in(int column) const {
    return std::min(kCore, static_cast<int>(m_.frame.size.width_px) - column * kCore);
  }
  [[nodiscard]] int height_in(int row) const {
    return std::min(kCore, static_cast<int>(m_.frame.size.height_px) - row * kCore);
  }

  /// What a pixel shows unless it is solved for: cover up to its cap, supports on top.
  void draw_cover(Mask& mask, int column, int row) {
    const auto scale = static_cast<float>(m_.options.support_grey);
    for (int y = 0; y < height_in(row); ++y) {
      std::uint8_t* to = grey_row(mask, column * kCore, row * kCore + y);
      const std::uint8_t* part = part_strip_.any() ? part_strip_.row(m_.halo + y, column * kCore + m_.halo) : nullptr;
      const std::uint8_t* support =
          support_strip_.any() ? support_strip_.row(m_.halo + y, column * kCore + m_.halo) : nullptr;
      const std::uint8_t* cap = cap_row(m_.halo + y, column * kCore);
      const int width = width_in(column);
      if (!cap && !support) {
        if (is_even(part, static_cast<std::size_t>(width)))
          std::memset(to, m_.grey_of_share[part[0]], static_cast<std::size_t>(width));
        else
          for (int x = 0; x < width; ++x) to[x] = m_.grey_of_share[part[x]];
        continue;
      }
      const auto count = static_cast<std::size_t>(width);
      if (!part) part = nothing_.data();
      if (!support) support = nothing_.data();
      if (!cap) cap = all_.data();
      if (is_even(part, count) && is_even(support, count) && is_even(cap, count)) {
        std::memset(to, m_.grey_of_share[drawn_share(part[0], cap[0], support[0], scale)], count);
        continue;
      }
      std::array<std::uint8_t, kCore> shares;
#pragma GCC ivdep
      for (std::size_t x = 0; x < count; ++x) shares[x] = drawn_share(part[x], cap[x], support[x], scale);
      for (std::size_t x = 0; x < count; ++x) to[x] = m_.grey_of_share[shares[x]];
    }
  }
  static std::uint8_t drawn_share(std::uint8_t part, std::uint8_t cap, std::uint8_t support, float scale) {
    const float share =
        static_cast<float>(part) * (static_cast<float>(cap) / 255) + scale * static_cast<float>(support);
    const float rounded = share + 0.5F;
    return static_cast<std::uint8_t>(static_cast<int>(rounded < 255.0F ? rounded : 255.0F));
  }

  void fill_field(int x0, int y0) {
    const auto& projection = m_.light.projection;
    if (projection.field.empty()) return;
    const double width = m_.frame.size.width_px, height = m_.frame.size.height_px;
    for (int y = 0; y < m_.side; ++y)
      for (int x = 0; x < m_.side; ++x)
        field_[static_cast<std::size_t>(y * m_.side + x)] =
            static_cast<float>(field_at(projection, (x0 + x + 0.5) / width, 1 - (y0 + y + 0.5) / height));
  }

  /// Bounds and reference of every pixel of the tile and its halo that a spot sees.
  void set_bounds(int column, int row) {
    const int x0 = column * kCore - m_.halo, y0 = row * kCore - m_.halo;
    fill_field(x0, y0);
    if (task_.caps && part_strip_.any())
      find_caps_beside(column);
    else
      beside_.clear();
    const int width = static_cast<int>(m_.frame.size.width_px), height = static_cast<int>(m_.frame.size.height_px);
    for (int y = 0; y < m_.side; ++y) {
      const int first = problem_.first[static_cast<std::size_t>(y)], last = problem_.last[static_cast<std::size_t>(y)];
      if (first >= last) continue;
      const std::size_t from = static_cast<std::size_t>(y * m_.side + first);
      if (above_)
        above_->copy_row(x0 + first, y0 + y, last - first, h_.data() + from);
      else
        std::fill_n(h_.data() + from, last - first, 0.0F);
      const int begins = std::clamp(-x0, first, last), ends = std::clamp(width - x0, begins, last);
      const bool is_whole = begins == first && ends == last && y0 + y >= 0 && y0 + y < height;
      for (auto* field : {&problem_.least, &problem_.most, &problem_.reference})
        if (!is_whole) std::copy_n(h_.data() + from, last - first, field->data() + from);  // as beyond the frame
      if (y0 + y >= 0 && y0 + y < height) set_row_bounds(column, y, begins, ends);
    }
  }

  /// The same of row y, columns `first` to `behind`; passes that g++ makes vectors of.
  void set_row_bounds(int column, int y, int first, int behind) {
    const auto from = static_cast<std::size_t>(first), until = static_cast<std::size_t>(behind);
    const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(m_.side);
    const bool has_part = part_strip_.any(), has_supports = support_strip_.any();
    const std::uint8_t* const part = has_part ? part_strip_.row(y, column * kCore) : nothing_.data();
    const std::uint8_t* const inner =
        has_part && inner_strip_.any() ? inner_strip_.row(y, column * kCore) : nothing_.data();
    const std::uint8_t* const support = has_supports ? support_strip_.row(y, column * kCore) : nothing_.data();
    find_caps(column, y, part, from, until);
    find_attached(column, y, from, until);
    const float leak = m_.tone[0], scale = static_cast<float>(m_.options.support_grey) / 255, attach = m_.attach,
                light = light_;
    const float* const field = field_.data() + at;
    const float* const h = h_.data() + at;
    const std::uint8_t* const caps = row_caps_.data();
    const std::uint8_t* const attached = attached_.data();
    float* const least_of = problem_.least.data() + at;
    float* const most_of = problem_.most.data() + at;
    float* const reference_of = problem_.reference.data() + at;
#pragma GCC ivdep
    for (std::size_t x = from; x < until; ++x) {
      const float full = light * field[x];
      const float p = static_cast<float>(part[x]) / 255, s = static_cast<float>(support[x]);
      const float within = static_cast<float>(inner[x]) / 255, cap = static_cast<float>(caps[x]) / 255;
      const float least = larger(leak, s * scale);
      const float wanted = cap * larger(within, p / 2);
      const float most = larger(least, support[x] > 0 && part[x] == 0 ? least : cap);
      const float held = larger(least, cap < attach ? cap : attach);
      least_of[x] = h[x] + full * (attached[x] == kAll ? held : least);
      most_of[x] = h[x] + full * most;
      reference_of[x] = h[x] + full * larger(least, wanted);
    }
  }
  static float larger(float a, float b) { return a < b ? b : a; }

  /// Leaves in row_caps_ what each pixel of the row may show at most: its own cap, or that of the part beside it.
  void find_caps(int column, int y, const std::uint8_t* part, std::size_t from, std::size_t until) {
    const std::uint8_t* const own = cap_row(y, 0);
    if (own == nullptr && beside_.empty()) {
      std::fill(row_caps_.begin(), row_caps_.end(), kAll);
      return;
    }
    std::uint8_t* const caps = row_caps_.data();
    if (own != nullptr)
      std::copy(own + (column * kCore - m_.halo) + static_cast<std::ptrdiff_t>(from),
                own + (column * kCore - m_.halo) + static_cast<std::ptrdiff_t>(until), caps + from);
    else
      std::fill(row_caps_.begin(), row_caps_.end(), kAll);
    if (beside_.empty()) {
      for (std::size_t x = from; x < until; ++x) caps[x] = part[x] < kSolid ? kAll : caps[x];
      return;
    }
    // Far from all that shows in the mask only splinters of the contour could ask for light; it would cure to beads.
    const std::uint16_t* const beside =
        beside_.data() + static_cast<std::size_t>(y) * static_cast<std::size_t>(m_.side);
    for (std::size_t x = from; x < until; ++x) {
      const auto near = static_cast<std::uint8_t>(beside[x] == 0 ? 0 : beside[x] - 1);
      caps[x] = part[x] < kSolid ? near : caps[x];
    }
  }

  /// Leaves in attached_ kAll where a pixel and its eight neighbours are all of the part: what is there holds the layer
  /// while it is printed.
  void find_attached(int column, int y, std::size_t from, std::size_t until) {
    std::fill(attached_.begin(), attached_.end(), std::uint8_t{0});
    if (!above_ || !part_strip_.any() || y == 0 || y + 1 == m_.side) return;
    const std::uint8_t* const front = part_strip_.row(y - 1, column * kCore);
    const std::uint8_t* const here = part_strip_.row(y, column * kCore);
    const std::uint8_t* const back = part_strip_.row(y + 1, column * kCore);
    std::uint8_t* const columns = attached_columns_.data();
    const auto side = static_cast<std::size_t>(m_.side);
    for (std::size_t x = 0; x < side; ++x) columns[x] = front[x] & here[x] & back[x];
    std::uint8_t* const attached = attached_.data();
    for (std::size_t x = std::max<std::size_t>(from, 1); x < std::min(until, side - 1); ++x)
      attached[x] = columns[x - 1] & columns[x] & columns[x + 1];
  }

  /// A pixel outside of the part may give as much light as the part's pixels around it: light beside an underside
  /// would cure what lies below just as well. Leaves in beside_ the highest cap of the part's pixels within kBeside,
  /// plus one; 0 where there are none.
  void find_caps_beside(int column) {
    const auto side = static_cast<std::size_t>(m_.side);
    const std::size_t margin = kBeside;
    beside_.resize(side * side);
    own_.assign(side * (side + 2 * margin), 0);
    for (std::size_t y = 0; y < side; ++y) {
      const std::uint8_t* part = part_strip_.row(static_cast<int>(y), column * kCore);
      const std::uint8_t* caps = cap_row(static_cast<int>(y), 0);
      std::uint16_t* own = own_.data() + y * (side + 2 * margin) + margin;
      for (int x = 0; x < m_.side; ++x)
        if (part[x] >= kSolid)
          own[x] = static_cast<std::uint16_t>((caps ? caps[column * kCore - m_.halo + x] : 255) + 1);
      const std::uint16_t* from = own - margin;
      for (std::size_t x = 0; x < side; ++x) {
        std::uint16_t most = from[x];
        for (std::size_t i = 1; i <= 2 * margin; ++i) most = std::max(most, from[x + i]);
        beside_[y * side + x] = most;
      }
    }
    own_.resize(side * side);
    std::copy(beside_.begin(), beside_.end(), own_.begin());
    for (std::size_t y = 0; y < side; ++y) {
      const std::size_t front = y > margin ? y - margin : 0, back = std::min(side - 1, y + margin);
      for (std::size_t j = front; j <= back; ++j)
        for (std::size_t x = 0; x < side; ++x)
          beside_[y * side + x] = std::max(beside_[y * side + x], own_[j * side + x]);
    }
  }

  void set_spots(int column, int row, std::span<const std::uint32_t> list) {
    const int x0 = column * kCore - m_.halo, y0 = row * kCore - m_.halo, taps = m_.weights.taps();
    problem_.clear_spots();
    for (std::size_t lane = 0; lane < kInterleave; ++lane)
      for (std::size_t i = lane; i < list.size(); i += kInterleave) {
        const EdgeSpot& spot = spots_[list[i]];
        const auto across = m_.weights.window(spot.x_px - x0), along = m_.weights.window(spot.y_px - y0);
        if (across.first < 0 || along.first < 0 || across.first + taps > m_.side || along.first + taps > m_.side)
          continue;
        const int column_px = std::min(static_cast<int>(spot.x_px) - x0, m_.side - 1);
        const int row_px = std::min(static_cast<int>(spot.y_px) - y0, m_.side - 1);
        // Where a support joins, the part's outline is no edge of what is cured.
        if (support_strip_.any() && support_strip_.row(row_px, column * kCore)[column_px] > 0) continue;
        const bool core =
            column_px >= m_.halo && column_px < m_.halo + kCore && row_px >= m_.halo && row_px < m_.halo + kCore;
        problem_.add({along.first * m_.side + across.first, across.node, along.node,
                      spot.weight / static_cast<float>(m_.edge_slope * m_.edge_slope), core ? spot.weight : 0.0F});
      }
  }

  void solve(BlendedLayer& out, int column, int row, std::span<const std::uint32_t> list) {
    if (iterations_ == 0) return;
    set_spots(column, row, list);
    if (problem_.spots.empty()) return;
    set_bounds(column, row);
    const double squares = solve_tile(problem_, iterations_);
    ++out.figures.tiles;
    out.figures.squares_px3 += squares / (m_.edge_slope * m_.edge_slope);
    for (const auto& spot : problem_.spots) out.figures.length_px += static_cast<double>(spot.inside_core);
    for (int y = 0; y < height_in(row); ++y) {
      std::uint8_t* to = grey_row(out.mask, column * kCore, row * kCore + y);
      for (int x = 0; x < width_in(column); ++x) {
        const auto at = static_cast<std::size_t>((y + m_.halo) * m_.side + x + m_.halo);
        if (problem_.touched(at)) to[x] = m_.encode((problem_.dose[at] - h_[at]) / (light_ * field_[at]));
      }
    }
  }

  /// Adds what the mask shows and lets the sum through one layer.
  void pass_on(Mask& mask, int column, int row) {
    DoseTiles::Tile& tile = above_->tile(column, row);
    const int width = width_in(column), height = height_in(row);
    const std::uint8_t grey = *grey_row(mask, column * kCore, row * kCore);
    bool even = !tile.pixels && m_.light.projection.field.empty();
    for (int y = 0; y < height && even; ++y) {
      const std::uint8_t* greys = grey_row(mask, column * kCore, row * kCore + y);
      even = greys[0] == grey && is_even(greys, static_cast<std::size_t>(width));
    }
    if (even) {
      tile.even = snapped(m_.passed * (tile.even + light_ * m_.tone[grey]));
      return;
    }
    if (!tile.pixels) {
      tile.pixels.reset(new float[kCore * kCore]);
      std::fill_n(tile.pixels.get(), kCore * kCore, tile.even);
    }
    const bool flat = m_.light.projection.field.empty();
    for (int y = 0; y < height; ++y) {
      const std::uint8_t* greys = grey_row(mask, column * kCore, row * kCore + y);
      std::array<float, kCore> light;
      for (int x = 0; x < width; ++x) light[static_cast<std::size_t>(x)] = light_ * m_.tone[greys[x]];
      for (int x = 0; x < width && !flat; ++x)
        light[static_cast<std::size_t>(x)] *=
            static_cast<float>(field_at(m_.light.projection, (column * kCore + x + 0.5) / m_.frame.size.width_px,
                                        1 - (row * kCore + y + 0.5) / m_.frame.size.height_px));
      float* const doses = tile.pixels.get() + y * kCore;
      for (int x = 0; x < width; ++x) doses[x] = snapped(m_.passed * (doses[x] + light[static_cast<std::size_t>(x)]));
    }
    keep_as_one_value(tile, width, height);
  }

  [[nodiscard]] float snapped(float dose) const {
    const float off = dose - steady_dose_;
    const float steady = (off < 0 ? -off : off) < kSnap ? steady_dose_ : dose;
    return dose < kSnap ? 0 : steady;
  }

  static void keep_as_one_value(DoseTiles::Tile& tile, int width, int height) {
    const float value = tile.pixels[0];
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        if (tile.pixels[static_cast<std::size_t>(y * kCore + x)] != value) return;
    tile.even = value;
    tile.pixels.reset();
  }

  const Model& m_;
  const BlendTask& task_;
  int iterations_;
  DoseTiles* above_;
  CoverCells part_, inner_, supports_;
  std::vector<EdgeSpot> spots_;
  Strip part_strip_, inner_strip_, support_strip_;
  float light_ = 1;
  TileProblem problem_;
  std::vector<float> h_, field_;
  std::vector<std::uint8_t> caps_;  ///< rows of the strip, without margins
  std::vector<char> capped_;        ///< by row of the strip
  std::vector<std::uint16_t> own_, beside_;
  float steady_dose_ = 0;
  std::vector<std::uint8_t> nothing_, all_;  ///< a row without cover, and one without caps
  std::vector<std::uint8_t> row_caps_, attached_, attached_columns_;
};

}  // namespace

BlendedLayer work_on_layer(const MaskBlender::Model& model, const BlendTask& task, int iterations, DoseTiles* above) {
  return LayerWork{model, task, iterations, above}.run();
}

}  // namespace telefab::fab
