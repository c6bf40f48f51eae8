// SPDX-License-Identifier: GPL-3.0-or-later
#include "pull_survey.hpp"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <numeric>
#include <telefab/base/disjoint_sets.hpp>
#include <utility>

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
  /// Cells up to so many away, nearest rings first.
  [[nodiscard]] std::vector<int> around(int cell, int reach) const {
    std::vector<int> found;
    const int row = cell / columns_, column = cell % columns_;
    for (int ring = 0; ring <= reach; ++ring)
      for (int dy = -ring; dy <= ring; ++dy)
        for (int dx = -ring; dx <= ring; ++dx) {
          if (std::max(std::abs(dx), std::abs(dy)) != ring) continue;
          const int r = row + dy, c = column + dx;
          if (r >= 0 && c >= 0 && c < columns_ && r < rows_) found.push_back(r * columns_ + c);
        }
    return found;
  }
  struct Cells {
    std::vector<int> solid;     ///< rising
    std::vector<int> enclosed;  ///< in holes of what is solid; rising
  };
  [[nodiscard]] Cells of(std::size_t layer) const {
    Cells cells;
    cells.solid = inside(layers_[layer].rings());
    std::vector<GridRing> outer;
    for (const GridRing& ring : layers_[layer].rings())
      if (area_mm2(ring) > 0) outer.push_back(ring);
    if (outer.size() == layers_[layer].rings().size()) return cells;
    const std::vector<int> filled = inside(outer);
    std::set_difference(filled.begin(), filled.end(), cells.solid.begin(), cells.solid.end(),
                        std::back_inserter(cells.enclosed));
    return cells;
  }

 private:
  [[nodiscard]] std::vector<int> inside(std::span<const GridRing> rings) const {
    ScanLines lines{origin_.y_mm, cell_, rows_};
    for (const GridRing& ring : rings) lines.add(ring);
    std::vector<int> cells;
    const auto column = [&](double x) { return static_cast<int>(std::ceil((x - origin_.x_mm) / cell_ - 0.5)); };
    lines.for_spans([&](int row, double from, double to) {
      for (int c = std::max(column(from), 0); c < std::min(column(to), columns_); ++c)
        cells.push_back(row * columns_ + c);
    });
    return cells;
  }

  std::span<const Region> layers_;
  double cell_ = 1;
  Point2 origin_;
  int columns_ = 0, rows_ = 0;
};

/// Bodies of cells as layers are added: cells of one layer that touch by a side or a corner, and cells of the same
/// place in consecutive layers, are one body.
class CellBodies {
 public:
  static constexpr std::uint32_t kNone = ~std::uint32_t{0};
  static constexpr std::uint32_t kGround = 0;  ///< a body of no cells; others may be joined to it

  explicit CellBodies(const CellLayers& cells)
      : cells_{cells}, body_at_(static_cast<std::size_t>(cells.cells()), kNone), last_at_(body_at_.size(), kNone) {}

  /// Adds a layer; those of its cells that the layer below has not.
  std::vector<int> add(std::uint32_t layer, const std::vector<int>& active) {
    std::vector<int> fresh;
    for (const int cell : active) {
      const auto c = static_cast<std::size_t>(cell);
      if (body_at_[c] == kNone || last_at_[c] + 1 != layer) {
        body_at_[c] = sets_.add();
        fresh.push_back(cell);
      }
      last_at_[c] = layer;
    }
    for (const int cell : fresh)
      for (const int n : cells_.around(cell, 1))
        if (has(n, layer)) sets_.join(body_at_[static_cast<std::size_t>(cell)], body_at_[static_cast<std::size_t>(n)]);
    return fresh;
  }
  void join_to_ground(int cell) { sets_.join(body_at_[static_cast<std::size_t>(cell)], kGround); }
  /// Whether that layer, the last one or the one before it, has the cell.
  [[nodiscard]] bool has(int cell, std::uint32_t layer) const {
    return last_at_[static_cast<std::size_t>(cell)] == layer;
  }
  [[nodiscard]] std::uint32_t body_at(int cell) const { return body_at_[static_cast<std::size_t>(cell)]; }
  [[nodiscard]] std::uint32_t root(std::uint32_t body) { return sets_.root(body); }
  [[nodiscard]] std::size_t count() const { return sets_.size(); }

 private:
  const CellLayers& cells_;
  DisjointSets sets_{1};
  std::vector<std::uint32_t> body_at_, last_at_;  ///< by cell: the body there, and the last layer that has it
};

class Survey {
 public:
  Survey(std::span<const Region> layers, std::span<const Anchor> anchors, const PullSurveyOptions& options)
      : layers_{layers},
        anchors_{anchors},
        options_{options},
        cells_{layers, options.cell_mm},
        stride_{std::max(1, static_cast<int>(std::lround(options.site_pitch_mm / cells_.cell_mm())))} {}

  Result<PullSurvey> run(const std::stop_token& stop) {
    std::vector<std::uint32_t> order(anchors_.size());
    std::iota(order.begin(), order.end(), 0U);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return anchors_[a].layer < anchors_[b].layer; });
    auto next = order.begin();
    std::vector<CellLayers::Cells> block(kBlock);
    const std::size_t step = std::max<std::size_t>(1, layers_.size() / kMoments);
    for (std::size_t k = 0; k < layers_.size(); ++k) {
      if (k % kBlock == 0) {
        if (stop.stop_requested()) return cancelled("planning supports");
        tbb::parallel_for(std::size_t{0}, std::min(kBlock, layers_.size() - k),
                          [&](std::size_t i) { block[i] = cells_.of(k + i); });
      }
      const auto layer = static_cast<std::uint32_t>(k);
      const CellLayers::Cells& cells = block[k % kBlock];
      follow_hollows(layer, cells.enclosed);
      grow(layer, cells.solid);
      for (; next != order.end() && anchors_[*next].layer.count() == k; ++next)
        if (const std::uint32_t body = body_near(anchors_[*next].place, layer); body != kNone)
          held_.push_back({*next, body});
      if (k % step == 0 || k + 1 == layers_.size()) note(layer, cells);
    }
    return std::move(out_);
  }

 private:
  static constexpr std::uint32_t kNone = CellBodies::kNone;
  static constexpr std::size_t kBlock = 64;

  struct Held {
    std::uint32_t anchor = 0;
    std::uint32_t body = 0;
  };
  /// As so much area is pulled, and times it its place.
  struct Load {
    double mm2 = 0, x = 0, y = 0;
    void add(double more_mm2, Point2 at) { mm2 += more_mm2, x += more_mm2 * at.x_mm, y += more_mm2 * at.y_mm; }
    void add(const Load& other) { mm2 += other.mm2, x += other.x, y += other.y; }
  };

  [[nodiscard]] double cell_mm2() const { return cells_.cell_mm() * cells_.cell_mm(); }

  void grow(std::uint32_t layer, const std::vector<int>& active) {
    const std::vector<int> fresh = part_.add(layer, active);
    if (layer == 0 && options_.stands)
      for (const int cell : fresh) part_.join_to_ground(cell);
    if (options_.known_sites)
      recall_sites(layer);
    else
      find_sites(fresh, layer);
    weight_.resize(part_.count());
    if (options_.weight_share == 0) return;
    for (const int cell : active) {
      Load& load = weight_[part_.body_at(cell)];
      if (load.mm2 == 0) weighing_.push_back(part_.body_at(cell));
      load.add(options_.weight_share * cell_mm2(), cells_.middle(cell));
    }
  }

  /// A hollow is open where the layer below has neither it nor the part, and the platform closes the first layer.
  void follow_hollows(std::uint32_t layer, const std::vector<int>& enclosed) {
    if (options_.vacuum_share == 0) return;
    fresh_hollow_ = hollows_.add(layer, enclosed);
    for (const int cell : fresh_hollow_)
      if (layer == 0 ? !options_.stands : !part_.has(cell, layer - 1)) hollows_.join_to_ground(cell);
  }

  void find_sites(const std::vector<int>& fresh, std::uint32_t layer) {
    if (layer == 0 && options_.stands) return;
    std::vector<int> cells;
    for (const int cell : fresh)
      if (cell % cells_.columns() % stride_ == 0 && cell / cells_.columns() % stride_ == 0) cells.push_back(cell);
    std::vector<std::optional<TipClass>> widest(cells.size());
    tbb::parallel_for(std::size_t{0}, cells.size(), [&](std::size_t i) {
      const Point2 at = cells_.middle(cells[i]);
      if (layers_[layer].contains(at)) widest[i] = options_.widest_at(at, LayerIndex{layer});
    });
    for (std::size_t i = 0; i < cells.size(); ++i)
      if (widest[i]) add_site({cells_.middle(cells[i]), LayerIndex{layer}, *widest[i]});
  }
  void recall_sites(std::uint32_t layer) {
    const std::vector<PinSite>& known = *options_.known_sites;
    while (out_.sites.size() < known.size() && known[out_.sites.size()].layer.count() == layer)
      add_site(known[out_.sites.size()]);
  }
  void add_site(const PinSite& site) {
    out_.sites.push_back(site);
    body_of_site_.push_back(part_.body_at(cells_.cell_at(site.place)));
  }

  [[nodiscard]] std::uint32_t body_near(Point2 at, std::uint32_t layer) const {
    for (const int n : cells_.around(cells_.cell_at(at), 2))
      if (part_.has(n, layer)) return part_.body_at(n);
    return kNone;
  }

  /// What each body's part of the layer is pulled with, in the order of their first cells.
  struct Pulled {
    std::uint32_t body = 0;
    Load area, vacuum;
    double perimeter_mm = 0;
  };
  [[nodiscard]] std::vector<Pulled> pulled_in(std::uint32_t layer, const CellLayers::Cells& cells) {
    std::vector<Pulled> all;
    for (const int cell : cells.solid) {
      const std::uint32_t body = part_.root(part_.body_at(cell));
      if (body == CellBodies::kGround) continue;
      if (slot_[body] == kNone) {
        slot_[body] = static_cast<std::uint32_t>(all.size());
        all.push_back({body, {}, {}, 0});
      }
      Pulled& pulled = all[slot_[body]];
      pulled.area.add(cell_mm2(), cells_.middle(cell));
      if (options_.doubled_at_mm > 0)
        for (const int n : {cell - 1, cell + 1, cell - cells_.columns(), cell + cells_.columns()})
          pulled.perimeter_mm += part_.has(n, layer) ? 0 : cells_.cell_mm() * std::numbers::pi / 4;
    }
    // What is solid to the left of an opening is around it, or stands in it.
    auto fresh = fresh_hollow_.begin();
    for (const int cell : cells.enclosed) {
      if (options_.vacuum_share == 0) break;
      while (fresh != fresh_hollow_.end() && *fresh < cell) ++fresh;
      const bool is_dimple = fresh != fresh_hollow_.end() && *fresh == cell;
      if (is_dimple || hollows_.root(hollows_.body_at(cell)) == CellBodies::kGround) continue;
      int wall = cell - 1;
      while (wall % cells_.columns() != 0 && !part_.has(wall, layer)) --wall;
      if (!part_.has(wall, layer)) continue;  // a wall thinner than a cell
      if (const std::uint32_t s = slot_[part_.root(part_.body_at(wall))]; s != kNone)
        all[s].vacuum.add(options_.vacuum_share * cell_mm2(), cells_.middle(cell));
    }
    return all;
  }

  /// Weights of bodies that have become one are added.
  void join_weights() {
    std::vector<std::uint32_t> roots;
    for (const std::uint32_t body : weighing_) {
      const std::uint32_t root = part_.root(body);
      if (root != body) weight_[root].add(std::exchange(weight_[body], {}));
      roots.push_back(root);
    }
    std::sort(roots.begin(), roots.end());
    roots.erase(std::unique(roots.begin(), roots.end()), roots.end());
    weighing_ = std::move(roots);
  }

  void note(std::uint32_t layer, const CellLayers::Cells& cells) {
    slot_.resize(part_.count(), kNone);
    join_weights();
    const std::vector<Pulled> pulled = pulled_in(layer, cells);
    const double layer_mm2 = cell_mm2() * static_cast<double>(cells.solid.size());
    const double share = options_.pull_share ? options_.pull_share(LayerIndex{layer}, layer_mm2) : 1;
    std::vector<PullSurvey::Moment> now(pulled.size());
    for (std::size_t i = 0; i < pulled.size(); ++i) {
      const Pulled& p = pulled[i];
      const double by_size = options_.doubled_at_mm > 0 ? 1 + p.area.mm2 / p.perimeter_mm / options_.doubled_at_mm : 1;
      Load load = weight_[p.body];
      load.add({share * by_size * p.area.mm2, share * by_size * p.area.x, share * by_size * p.area.y});
      load.add({share * p.vacuum.mm2, share * p.vacuum.x, share * p.vacuum.y});
      now[i].pulled_mm2 = load.mm2;
      now[i].middle = {load.x / load.mm2, load.y / load.mm2};
    }
    for (const Held& held : held_)
      if (const std::uint32_t s = slot_[part_.root(held.body)]; s != kNone) now[s].anchors.push_back(held.anchor);
    for (std::uint32_t i = 0; i < out_.sites.size(); ++i)
      if (const std::uint32_t s = slot_[part_.root(body_of_site_[i])]; s != kNone) now[s].sites.push_back(i);
    for (const Pulled& p : pulled) slot_[p.body] = kNone;
    for (PullSurvey::Moment& moment : now)
      if (moment.pulled_mm2 >= options_.least_mm2) out_.moments.push_back(std::move(moment));
  }

  std::span<const Region> layers_;
  std::span<const Anchor> anchors_;
  const PullSurveyOptions& options_;
  CellLayers cells_;
  int stride_;
  CellBodies part_{cells_};
  CellBodies hollows_{cells_};  ///< open ones are joined to the ground
  std::vector<int> fresh_hollow_;
  std::vector<Held> held_;
  std::vector<std::uint32_t> body_of_site_;
  std::vector<Load> weight_;             ///< by body
  std::vector<std::uint32_t> weighing_;  ///< bodies that may have one
  std::vector<std::uint32_t> slot_;      ///< by body; all none between layers
  PullSurvey out_;
};

}  // namespace

Result<PullSurvey> survey_pull(std::span<const Region> layers, std::span<const Anchor> anchors,
                               const PullSurveyOptions& options, const std::stop_token& stop) {
  return Survey{layers, anchors, options}.run(stop);
}

}  // namespace telefab::fab
