// SPDX-License-Identifier: GPL-3.0-or-later
#include "pull_survey.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <telefab/base/disjoint_sets.hpp>

#include "scan_lines.hpp"

namespace telefab::fab {
namespace {

constexpr double kCells = 250;  ///< along the part's longer side at most
/// Of a high part so many layers are moments: neighbours differ little, and what hangs on each is listed.
constexpr std::size_t kMoments = 600;

/// The part on cells: for each layer the cells whose middle lies inside.
class CellLayers {
 public:
  CellLayers(std::span<const Region> layers, double least_cell_mm) : layers_{layers} {
    Bounds2 box = Bounds2::nothing();
    for (const Region& region : layers)
      if (!region.empty()) box.include(region.bounds());
    if (box.is_nothing()) return;
    const double wide = box.max.x_mm - box.min.x_mm, deep = box.max.y_mm - box.min.y_mm;
    cell_ = std::max(least_cell_mm, std::max(wide, deep) / kCells);
    origin_ = {box.min.x_mm - cell_, box.min.y_mm - cell_};
    columns_ = static_cast<int>(wide / cell_) + 3;
    rows_ = static_cast<int>(deep / cell_) + 3;
  }
  [[nodiscard]] double cell_mm() const { return cell_; }
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int cells() const { return columns_ * rows_; }
  [[nodiscard]] Point2 middle(int cell) const {
    return {origin_.x_mm + (cell % columns_ + 0.5) * cell_, origin_.y_mm + (cell / columns_ + 0.5) * cell_};
  }
  [[nodiscard]] int cell_at(Point2 p) const {
    const int c = std::clamp(static_cast<int>((p.x_mm - origin_.x_mm) / cell_), 0, columns_ - 1);
    const int r = std::clamp(static_cast<int>((p.y_mm - origin_.y_mm) / cell_), 0, rows_ - 1);
    return r * columns_ + c;
  }
  /// Cells of a layer, rising.
  [[nodiscard]] std::vector<int> of(std::size_t layer) const {
    ScanLines lines{origin_.y_mm, cell_, rows_};
    lines.add(layers_[layer]);
    std::vector<int> cells;
    const auto column = [&](double x) { return static_cast<int>(std::ceil((x - origin_.x_mm) / cell_ - 0.5)); };
    lines.for_spans([&](int row, double from, double to) {
      for (int c = std::max(column(from), 0); c < std::min(column(to), columns_); ++c)
        cells.push_back(row * columns_ + c);
    });
    return cells;
  }

 private:
  std::span<const Region> layers_;
  double cell_ = 1;
  Point2 origin_;
  int columns_ = 0, rows_ = 0;
};

class Survey {
 public:
  Survey(std::span<const Region> layers, std::span<const Anchor> anchors, const PullSurveyOptions& options)
      : layers_{layers},
        anchors_{anchors},
        options_{options},
        cells_{layers, options.cell_mm},
        stride_{std::max(1, static_cast<int>(std::lround(options.site_pitch_mm / cells_.cell_mm())))},
        body_at_(static_cast<std::size_t>(cells_.cells()), kNone),
        last_at_(body_at_.size(), kNone) {}

  Result<PullSurvey> run(const std::stop_token& stop) {
    std::vector<std::uint32_t> order(anchors_.size());
    std::iota(order.begin(), order.end(), 0U);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return anchors_[a].layer < anchors_[b].layer; });
    auto next = order.begin();
    std::vector<std::vector<int>> block(kBlock);
    const std::size_t step = std::max<std::size_t>(1, layers_.size() / kMoments);
    for (std::size_t k = 0; k < layers_.size(); ++k) {
      if (k % kBlock == 0) {
        if (stop.stop_requested()) return cancelled("planning supports");
        tbb::parallel_for(std::size_t{0}, std::min(kBlock, layers_.size() - k),
                          [&](std::size_t i) { block[i] = cells_.of(k + i); });
      }
      const auto layer = static_cast<std::uint32_t>(k);
      const std::vector<int>& active = block[k % kBlock];
      grow(layer, active);
      for (; next != order.end() && anchors_[*next].layer.count() == k; ++next)
        if (const std::uint32_t body = body_near(anchors_[*next].place, layer); body != kNone)
          held_.push_back({*next, body});
      if (k % step == 0 || k + 1 == layers_.size()) note(active);
    }
    return std::move(out_);
  }

 private:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  static constexpr std::uint32_t kGround = 0;
  static constexpr std::size_t kBlock = 64;

  struct Held {
    std::uint32_t anchor = 0;
    std::uint32_t body = 0;
  };

  void grow(std::uint32_t layer, const std::vector<int>& active) {
    std::vector<int> fresh;
    for (const int cell : active) {
      const auto c = static_cast<std::size_t>(cell);
      if (body_at_[c] == kNone || last_at_[c] + 1 != layer) {
        body_at_[c] = bodies_.add();
        fresh.push_back(cell);
        if (layer == 0 && options_.stands) bodies_.join(body_at_[c], kGround);
      }
      last_at_[c] = layer;
    }
    for (const int cell : fresh) {
      for (const int n : around(cell, 1))
        if (last_at_[static_cast<std::size_t>(n)] == layer)
          bodies_.join(body_at_[static_cast<std::size_t>(cell)], body_at_[static_cast<std::size_t>(n)]);
      consider(cell, layer);
    }
  }

  void consider(int cell, std::uint32_t layer) {
    if (cell % cells_.columns() % stride_ != 0 || cell / cells_.columns() % stride_ != 0) return;
    if (layer == 0 && options_.stands) return;
    const Point2 at = cells_.middle(cell);
    if (!layers_[layer].contains(at)) return;
    const auto widest = options_.widest_at(at, LayerIndex{layer});
    if (!widest) return;
    out_.sites.push_back({at, LayerIndex{layer}, *widest});
    body_of_site_.push_back(body_at_[static_cast<std::size_t>(cell)]);
  }

  /// Cells up to so many away, nearest rings first.
  [[nodiscard]] std::vector<int> around(int cell, int reach) const {
    std::vector<int> found;
    const int row = cell / cells_.columns(), column = cell % cells_.columns();
    for (int ring = 0; ring <= reach; ++ring)
      for (int dy = -ring; dy <= ring; ++dy)
        for (int dx = -ring; dx <= ring; ++dx) {
          if (std::max(std::abs(dx), std::abs(dy)) != ring) continue;
          const int r = row + dy, c = column + dx;
          if (r >= 0 && c >= 0 && c < cells_.columns() && r < cells_.cells() / cells_.columns())
            found.push_back(r * cells_.columns() + c);
        }
    return found;
  }

  [[nodiscard]] std::uint32_t body_near(Point2 at, std::uint32_t layer) const {
    for (const int n : around(cells_.cell_at(at), 2))
      if (last_at_[static_cast<std::size_t>(n)] == layer) return body_at_[static_cast<std::size_t>(n)];
    return kNone;
  }

  void note(const std::vector<int>& active) {
    slot_.resize(bodies_.size(), kNone);
    std::vector<std::uint32_t> roots;
    const double cell_mm2 = cells_.cell_mm() * cells_.cell_mm();
    std::vector<PullSurvey::Moment> now;
    for (const int cell : active) {
      const std::uint32_t body = bodies_.root(body_at_[static_cast<std::size_t>(cell)]);
      if (body == kGround) continue;
      if (slot_[body] == kNone) {
        slot_[body] = static_cast<std::uint32_t>(now.size());
        now.emplace_back();
        roots.push_back(body);
      }
      PullSurvey::Moment& moment = now[slot_[body]];
      const Point2 at = cells_.middle(cell);
      moment.pulled_mm2 += cell_mm2;
      moment.middle.x_mm += cell_mm2 * at.x_mm;
      moment.middle.y_mm += cell_mm2 * at.y_mm;
    }
    for (const Held& held : held_)
      if (const std::uint32_t s = slot_[bodies_.root(held.body)]; s != kNone) now[s].anchors.push_back(held.anchor);
    for (std::uint32_t i = 0; i < out_.sites.size(); ++i)
      if (const std::uint32_t s = slot_[bodies_.root(body_of_site_[i])]; s != kNone) now[s].sites.push_back(i);
    for (const std::uint32_t body : roots) slot_[body] = kNone;
    for (PullSurvey::Moment& moment : now) {
      if (moment.pulled_mm2 < options_.least_mm2) continue;
      moment.middle.x_mm /= moment.pulled_mm2;
      moment.middle.y_mm /= moment.pulled_mm2;
      out_.moments.push_back(std::move(moment));
    }
  }

  std::span<const Region> layers_;
  std::span<const Anchor> anchors_;
  const PullSurveyOptions& options_;
  CellLayers cells_;
  int stride_;
  DisjointSets bodies_{1};                        ///< the ground first
  std::vector<std::uint32_t> body_at_, last_at_;  ///< by cell: the body there, and the last layer that has it
  std::vector<Held> held_;
  std::vector<std::uint32_t> body_of_site_;
  std::vector<std::uint32_t> slot_;  ///< by body; all none between layers
  PullSurvey out_;
};

}  // namespace

Result<PullSurvey> survey_pull(std::span<const Region> layers, std::span<const Anchor> anchors,
                               const PullSurveyOptions& options, const std::stop_token& stop) {
  return Survey{layers, anchors, options}.run(stop);
}

}  // namespace telefab::fab
