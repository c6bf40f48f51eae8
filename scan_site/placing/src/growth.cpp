// SPDX-License-Identifier: GPL-3.0-or-later
#include "growth.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <span>

namespace telefab::scan {
namespace {

constexpr double kPi = std::numbers::pi;
/// Arms reach so many pin radii, and so much of the height of what they hold (the planner's).
constexpr double kArmRadii = 20;
constexpr double kArmShare = 0.8;
/// An arm sinks by so much for each millimetre it goes sideways.
constexpr double kArmSlope = 1.2;
/// Pieces of the plates that join feet no farther apart than so many foot radii.
constexpr double kPlateRadii = 6;
/// An island of fewer pixels is none before it has grown: the samples are no smoother than that.
constexpr std::size_t kLeastIsland = 4;
/// A lifted part keeps its middle inside its footing by this share of its height, with so many more anchors at most, on
/// this share of its height; how much lower a place has to be to be worth a millimetre.
constexpr double kLeastLean = 0.05;
constexpr int kMostStabilising = 9;
constexpr double kStabilisedShare = 0.3;
constexpr double kStabilisedRise = 0.02;

struct Pixel {
  int x = 0, y = 0;
};

double distance_px(Pixel a, Pixel b) { return std::hypot(a.x - b.x, a.y - b.y); }

double frustum_mm3(double length, double r0, double r1) { return kPi / 3 * length * (r0 * r0 + r0 * r1 + r1 * r1); }

/// Sets of numbers that are joined two by two.
class Joined {
 public:
  std::uint32_t add() {
    parent_.push_back(static_cast<std::uint32_t>(parent_.size()));
    return parent_.back();
  }
  [[nodiscard]] std::uint32_t root(std::uint32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  /// The root of both is the lower one.
  std::uint32_t join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    if (a > b) std::swap(a, b);
    parent_[b] = a;
    return a;
  }
  [[nodiscard]] std::size_t size() const { return parent_.size(); }

 private:
  std::vector<std::uint32_t> parent_;
};

/// Pieces of the pixels that have a value: 8 neighbours where `touching`, else 4. Labels from 1, 0 elsewhere.
struct Pieces {
  std::vector<std::uint32_t> of;
  std::uint32_t count = 0;

  Pieces(std::span<const char> mask, char value, int nx, int ny, bool touching) : of(mask.size(), 0) {
    Joined sets;
    sets.add();
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x) {
        const std::size_t i = static_cast<std::size_t>(y) * static_cast<std::size_t>(nx) + static_cast<std::size_t>(x);
        if (mask[i] != value) continue;
        std::uint32_t label = 0;
        const auto meet = [&](bool is_there, std::size_t back) {
          if (!is_there || of[i - back] == 0) return;
          label = label == 0 ? of[i - back] : sets.join(label, of[i - back]);
        };
        const auto row = static_cast<std::size_t>(nx);
        meet(x > 0, 1);
        meet(y > 0, row);
        meet(touching && x > 0 && y > 0, row + 1);
        meet(touching && x + 1 < nx && y > 0, row - 1);
        of[i] = label == 0 ? sets.add() : label;
      }
    std::vector<std::uint32_t> number(sets.size(), 0);
    for (std::uint32_t& label : of) {
      if (label == 0) continue;
      std::uint32_t& n = number[sets.root(label)];
      if (n == 0) n = ++count;
      label = n;
    }
  }
};

/// Corners of the smallest convex ring around places, counter-clockwise.
std::vector<Eigen::Vector2d> hull_of(std::vector<Eigen::Vector2d> places) {
  const auto before = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y());
  };
  std::sort(places.begin(), places.end(), before);
  places.erase(std::unique(places.begin(), places.end()), places.end());
  if (places.size() < 3) return places;
  const auto turn = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
    return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
  };
  std::vector<Eigen::Vector2d> ring;
  for (int side = 0; side < 2; ++side) {
    const std::size_t first = ring.size();
    for (const Eigen::Vector2d& p : places) {
      while (ring.size() >= first + 2 && turn(ring[ring.size() - 2], ring.back(), p) <= 0) ring.pop_back();
      ring.push_back(p);
    }
    ring.pop_back();
    std::reverse(places.begin(), places.end());
  }
  return ring;
}

/// How far inside the hull of a footing a place lies, negative outside, and the way out at the nearest place.
std::pair<double, Eigen::Vector2d> inside_by(const std::vector<Eigen::Vector2d>& hull, const Eigen::Vector2d& place) {
  double nearest = std::numeric_limits<double>::infinity();
  Eigen::Vector2d way = Eigen::Vector2d::UnitX();
  bool is_inside = hull.size() >= 3;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const Eigen::Vector2d a = hull[i], along = hull[(i + 1) % hull.size()] - a, to = place - a;
    const double length2 = along.squaredNorm();
    const double share = length2 > 0 ? std::clamp(to.dot(along) / length2, 0.0, 1.0) : 0.0;
    const Eigen::Vector2d off = to - share * along;
    if (along.x() * to.y() - along.y() * to.x() < 0) is_inside = false;
    if (off.norm() >= nearest) continue;
    nearest = off.norm();
    if (length2 > 0)
      way = Eigen::Vector2d{along.y(), -along.x()} / std::sqrt(length2);
    else if (nearest > 0)
      way = off / nearest;
  }
  return {is_inside ? nearest : -nearest, way};
}

class Growth {
 public:
  Growth(const SolidGrid& grid, const Stance& stance, const MachineProfile& machine, double layer_mm)
      : grid_{grid},
        machine_{machine},
        s_{machine.supports},
        layer_mm_{layer_mm},
        box_{stance.box_mm},
        to_scan_{stance.to_build.inverse()},
        h_{static_cast<double>(grid.pitch()) * std::cbrt(std::abs(stance.to_build.determinant()))} {
    const Vec3 size = box_.size();
    nx_ = static_cast<int>(std::ceil(size.x() / h_)) + 2;
    ny_ = static_cast<int>(std::ceil(size.y() / h_)) + 2;
    nz_ = std::max(1, static_cast<int>(std::lround(size.z() / h_)));
    pixels_ = static_cast<std::size_t>(nx_) * static_cast<std::size_t>(ny_);
    solid_.assign(pixels_ * static_cast<std::size_t>(nz_), 0);
    for (int k = 0; k < nz_; ++k) fill((k + 0.5) * h_, layer(k));
  }

  StandingFigures run(bool in_full) {
    StandingFigures f;
    f.size_mm = box_.size();
    std::size_t solid = 0, largest = 0;
    for (int k = 0; k < nz_; ++k) {
      const auto here = static_cast<std::size_t>(std::count(layer(k).begin(), layer(k).end(), char{1}));
      solid += here;
      largest = std::max(largest, here);
    }
    f.part_mm3 = static_cast<double>(solid) * h_ * h_ * h_;
    std::vector<char> first(pixels_, 0);
    fill(layer_mm_ / 2, first);
    const auto stands = static_cast<std::size_t>(std::count(first.begin(), first.end(), char{1}));
    f.is_lifted = static_cast<double>(stands) < s_.stand_area_share * static_cast<double>(largest) || stands == 0;
    lift_mm_ = f.is_lifted ? std::max(s_.lift_off_mm, s_.base_thickness_mm + 2 * s_.tip_radius_mm + 2 * layer_mm_) : 0;
    f.layers = static_cast<std::uint32_t>(std::max(1.0, std::ceil((f.size_mm.z() + lift_mm_) / layer_mm_ - 0.5)));

    find_free_columns();
    for (int k = 0; k < nz_; ++k) hold_layer(k, f);
    weigh();
    if (f.is_lifted) stabilise();
    f.anchors = static_cast<std::uint32_t>(all_.size());
    for (const Anchor& a : all_) support(a.at, a.k);
    f.support_mm3 = volume_mm3_ + plates_mm3();
    if (!in_full) return f;
    f.trapped_mm3 = trapped_mm3(f.is_lifted);
    f.stability = stability(first, f.is_lifted);
    return f;
  }

 private:
  struct Anchor {
    Pixel at;
    int k = 0;
  };
  struct Mass {
    double pixels = 0;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();  ///< pixels times millimetres
  };

  [[nodiscard]] std::span<char> layer(int k) {
    return std::span{solid_}.subspan(pixels_ * static_cast<std::size_t>(k), pixels_);
  }
  [[nodiscard]] std::size_t index(Pixel p) const {
    return static_cast<std::size_t>(p.y) * static_cast<std::size_t>(nx_) + static_cast<std::size_t>(p.x);
  }
  [[nodiscard]] bool is_on_grid(Pixel p) const { return p.x >= 0 && p.y >= 0 && p.x < nx_ && p.y < ny_; }
  [[nodiscard]] bool is_solid(Pixel p, int k) const {
    return k >= 0 && k < nz_ && is_on_grid(p) && solid_[pixels_ * static_cast<std::size_t>(k) + index(p)] != 0;
  }
  /// Relative to the origin of the cloud.
  [[nodiscard]] Vec3 scan_place(double x, double y, double z_mm) const {
    return to_scan_ * (box_.min + Vec3{(x - 0.5) * h_, (y - 0.5) * h_, z_mm});
  }

  void fill(double z_mm, std::span<char> into) const {
    const Eigen::Vector3f step = (to_scan_.col(0) * h_).cast<float>();
    // Where the distance is cut off, the surface is at least so many pixels away.
    constexpr int kSkip = static_cast<int>(SolidGrid::kBand) - 1;
    const float far = 0.999F * SolidGrid::kBand * grid_.pitch();
    for (int y = 0; y < ny_; ++y) {
      const Eigen::Vector3f start = scan_place(0, y, z_mm).cast<float>();
      for (int x = 0; x < nx_; ++x) {
        const float d = grid_.distance(start + static_cast<float>(x) * step);
        const int last = std::abs(d) >= far ? std::min(nx_ - 1, x + kSkip - 1) : x;
        if (d < 0) std::fill_n(into.begin() + static_cast<std::ptrdiff_t>(index({x, y})), last - x + 1, char{1});
        x = last;
      }
    }
  }

  /// The lowest layer that has material within a pin's clearance of each column.
  void find_free_columns() {
    std::vector<int> lowest(pixels_, nz_);
    for (int k = nz_ - 1; k >= 0; --k)
      for (std::size_t i = 0; i < pixels_; ++i)
        if (layer(k)[i]) lowest[i] = k;
    free_below_ = lowest;
    const double reach = (s_.pin_radius_mm + s_.clearance_mm) / h_;
    const int r = static_cast<int>(reach);
    std::vector<Pixel> near;
    for (int dy = -r; dy <= r; ++dy)
      for (int dx = -r; dx <= r; ++dx)
        if (std::hypot(dx, dy) <= reach) near.push_back({dx, dy});
    for (int y = 0; y < ny_; ++y)
      for (int x = 0; x < nx_; ++x)
        for (const Pixel d : near)
          if (is_on_grid({x + d.x, y + d.y}))
            free_below_[index({x, y})] = std::min(free_below_[index({x, y})], lowest[index({x + d.x, y + d.y})]);
  }

  /// How far a piece carries an overhang in one layer of the print, beside that much of it that is attached.
  [[nodiscard]] double reach_mm(std::size_t attached) const {
    return machine_.self_support_reach_mm(static_cast<double>(attached) * h_ * h_);
  }

  /// Whether an underside comes forward by no more than its reach from layer to layer of the print.
  [[nodiscard]] bool is_steep(Pixel p, int k, double reach) const {
    const auto at = grid_.at(scan_place(p.x, p.y, (k + 0.5) * h_).cast<float>());
    const Vec3 normal = to_scan_.transpose() * at.gradient.cast<double>();
    return std::abs(normal.z()) * layer_mm_ <= normal.head<2>().norm() * reach;
  }

  /// Whether something lies within the reach that has material below it: that carries the pixel at once.
  [[nodiscard]] bool is_carried(Pixel p, int k, double reach) const {
    const double reach_px = reach / h_;
    const int r = static_cast<int>(reach_px);
    for (int dy = -r; dy <= r; ++dy)
      for (int dx = -r; dx <= r; ++dx)
        if (dx * dx + dy * dy <= reach_px * reach_px && is_solid({p.x + dx, p.y + dy}, k) &&
            is_solid({p.x + dx, p.y + dy}, k - 1))
          return true;
    return false;
  }

  void hold_layer(int k, StandingFigures& f) {
    if (k == 0 && !f.is_lifted) return;
    const auto here = layer(k);
    const auto is_attached = [&](std::size_t i) { return k > 0 && here[i] && layer(k - 1)[i]; };
    const Pieces pieces{here, 1, nx_, ny_, true};
    std::vector<std::size_t> attached(pieces.count + 1, 0);
    bool any = false;
    for (std::size_t i = 0; i < pixels_; ++i) {
      if (!here[i]) continue;
      if (is_attached(i))
        ++attached[pieces.of[i]];
      else
        any = true;
    }
    const double reach_px = s_.anchor_distance_mm / h_;
    std::erase_if(standing_, [&](const Anchor& a) { return k - a.k >= reach_px || !here[index(a.at)]; });
    if (!any) return;
    std::vector<std::vector<Pixel>> open(pieces.count + 1);
    for (int y = 0; y < ny_; ++y)
      for (int x = 0; x < nx_; ++x) {
        const std::size_t i = index({x, y});
        if (!here[i] || is_attached(i)) continue;
        const std::uint32_t piece = pieces.of[i];
        if (attached[piece] > 0)
          if (const double reach = reach_mm(attached[piece]);
              is_steep({x, y}, k, reach) || is_carried({x, y}, k, reach))
            continue;
        open[piece].push_back({x, y});
      }
    for (std::uint32_t piece = 1; piece <= pieces.count; ++piece) {
      std::vector<Pixel>& rest = open[piece];
      if (rest.empty()) continue;
      if (attached[piece] == 0 && rest.size() < kLeastIsland) {
        for (const Pixel p : rest) here[index(p)] = 0;
        continue;
      }
      f.overhang_mm2 += static_cast<double>(rest.size()) * h_ * h_;
      bool is_held = attached[piece] > 0;
      for (const Anchor& a : standing_) {
        if (pieces.of[index(a.at)] != piece) continue;
        is_held = true;
        const double rise = k - a.k, across = std::sqrt(reach_px * reach_px - rise * rise);
        std::erase_if(rest, [&](Pixel p) { return distance_px(p, a.at) <= across; });
      }
      // Held by the part or an anchor, and nothing beyond their reach.
      if (rest.empty() && is_held) continue;
      while (!rest.empty()) {
        const Pixel at = middle_about(rest, reach_px);
        std::erase_if(rest, [&](Pixel p) { return distance_px(p, at) <= reach_px; });
        standing_.push_back({at, k});
        all_.push_back({at, k});
      }
    }
  }

  /// The place near the first of the pixels that holds most of them around it: their middle, on one of them.
  [[nodiscard]] static Pixel middle_about(const std::vector<Pixel>& rest, double reach_px) {
    const Pixel first = rest.front();
    double x = 0, y = 0, n = 0;
    for (const Pixel p : rest)
      if (distance_px(p, first) <= reach_px) x += p.x, y += p.y, ++n;
    Pixel best = first;
    double least = std::numeric_limits<double>::infinity();
    for (const Pixel p : rest)
      if (const double d = std::hypot(p.x - x / n, p.y - y / n); d < least && distance_px(p, first) <= reach_px)
        least = d, best = p;
    return best;
  }

  [[nodiscard]] double tip_mm() const { return 2.5 * (s_.pin_radius_mm - s_.tip_radius_mm) + 2 * layer_mm_; }

  [[nodiscard]] bool arm_is_clear(Pixel from, double from_mm, Pixel to, double to_mm) const {
    const int steps = std::max(1, static_cast<int>(std::ceil((from_mm - to_mm) / h_)));
    for (int i = 1; i <= steps; ++i) {
      const double s = static_cast<double>(i) / steps;
      const Pixel q{static_cast<int>(std::lround(from.x + s * (to.x - from.x))),
                    static_cast<int>(std::lround(from.y + s * (to.y - from.y)))};
      const double z = from_mm + s * (to_mm - from_mm) - lift_mm_;
      if (is_solid(q, static_cast<int>(std::floor(z / h_)))) return false;
    }
    return true;
  }

  /// The pin of an anchor under layer k: its volume, and its foot.
  void support(Pixel at, int k) {
    const double contact = k * h_ + lift_mm_, r = s_.pin_radius_mm;
    const double reach = std::min(kArmRadii * r, kArmShare * contact), step = std::max(h_, r / 2);
    for (double rho = 0; rho <= reach; rho += step) {
      const int turns = rho == 0 ? 1 : std::clamp(static_cast<int>(2 * kPi * rho / step), 8, 32);
      for (int i = 0; i < turns; ++i) {
        const double angle = 2 * kPi * i / turns;
        const Pixel q{static_cast<int>(std::lround(at.x + rho * std::cos(angle) / h_)),
                      static_cast<int>(std::lround(at.y + rho * std::sin(angle) / h_))};
        const double joint = contact - std::max(tip_mm(), kArmSlope * rho);
        if (joint <= s_.base_thickness_mm) continue;
        // Beyond the grid nothing is in the way.
        if (is_on_grid(q) && free_below_[index(q)] * h_ + lift_mm_ < joint) continue;
        if (!arm_is_clear(at, contact - layer_mm_, q, joint)) continue;
        const double foot = std::min(s_.base_thickness_mm + s_.foot_radius_mm, joint);
        volume_mm3_ += frustum_mm3(std::hypot(rho, contact - joint), r, s_.tip_radius_mm) +
                       frustum_mm3(foot, s_.foot_radius_mm, r) + pin_mm3(joint - foot, r);
        feet_.push_back(place_mm(q));
        return;
      }
    }
    int floor = k - 1;
    while (floor >= 0 && !is_solid(at, floor)) --floor;
    const double length = floor >= 0 ? (k - 1 - floor) * h_ : contact;
    const bool is_thin = length - tip_mm() < 2 * r;
    volume_mm3_ += is_thin ? kPi * s_.tip_radius_mm * s_.tip_radius_mm * length
                           : frustum_mm3(tip_mm(), r, s_.tip_radius_mm) + pin_mm3(length - tip_mm(), r);
  }

  /// A pin, with its share of the braces that one needs beyond its slenderness.
  [[nodiscard]] double pin_mm3(double length, double r) const {
    double volume = kPi * r * r * length;
    if (length > s_.slenderness * 2 * r) {
      const double brace = std::max(s_.tip_radius_mm, 0.6 * r), apart = 0.75 * s_.brace_pitch_mm;
      volume += std::floor(length / s_.brace_pitch_mm) * kPi * brace * brace * std::numbers::sqrt2 * apart;
    }
    return volume;
  }

  [[nodiscard]] double plates_mm3() const {
    const double r = 1.5 * s_.foot_radius_mm;
    double area = 0;
    for (std::size_t i = 0; i < feet_.size(); ++i) {
      double nearest = kPlateRadii * s_.foot_radius_mm;
      bool is_joined = false;
      for (std::size_t j = 0; j < i; ++j)
        if (const double d = (feet_[i] - feet_[j]).norm(); d < nearest) nearest = d, is_joined = true;
      // The disc of its own, as far as the neighbour's does not hold it already, and what joins them.
      area += is_joined ? std::min(kPi * r * r, 2 * r * nearest) + std::max(0.0, nearest - 2 * r) * 2 * r : kPi * r * r;
    }
    return area * s_.base_thickness_mm;
  }

  /// The most that lies in cups and hollows while the part grows: what is empty, below the layer that grows, and joined
  /// to the outside nowhere up to there.
  double trapped_mm3(bool is_lifted) {
    Joined sets;
    std::vector<std::size_t> pixels;
    std::vector<char> is_open;
    const auto add = [&] {
      pixels.push_back(0);
      is_open.push_back(0);
      return sets.add();
    };
    std::size_t trapped = 0, most = 0;
    const auto count = [&](std::uint32_t set) { return is_open[set] ? std::size_t{0} : pixels[set]; };
    std::vector<std::uint32_t> below(pixels_, 0);
    std::vector<std::uint32_t> first;
    for (int k = 0; k < nz_; ++k) {
      const Pieces empty{layer(k), 0, nx_, ny_, false};
      first.assign(empty.count + 1, 0);
      for (std::uint32_t piece = 1; piece <= empty.count; ++piece) first[piece] = add();
      for (std::size_t i = 0; i < pixels_; ++i)
        if (empty.of[i] > 0) ++pixels[first[empty.of[i]]];
      is_open[first[empty.of[0]]] = 1;  // the rim of the grid is empty
      if (k == 0 && is_lifted) std::fill(is_open.begin(), is_open.end(), char{1});
      for (std::uint32_t piece = 1; piece <= empty.count; ++piece) trapped += count(first[piece]);
      for (std::size_t i = 0; k > 0 && i < pixels_; ++i) {
        if (empty.of[i] == 0 || below[i] == 0) continue;
        const std::uint32_t a = sets.root(first[empty.of[i]]), b = sets.root(below[i] - 1);
        if (a == b) continue;
        trapped -= count(a) + count(b);
        const std::uint32_t both = sets.join(a, b);
        const std::size_t all = pixels[a] + pixels[b];
        const char open = is_open[a] || is_open[b];
        pixels[both] = all;
        is_open[both] = open;
        trapped += count(both);
      }
      for (std::size_t i = 0; i < pixels_; ++i) below[i] = empty.of[i] > 0 ? first[empty.of[i]] + 1 : 0;
      most = std::max(most, trapped);
    }
    return static_cast<double>(most) * h_ * h_ * h_;
  }

  /// The layer up to which a growing part leans over most.
  struct Lean {
    double slack_mm = std::numeric_limits<double>::infinity();
    int k = 0;
    Eigen::Vector2d centre = Eigen::Vector2d::Zero(), way = Eigen::Vector2d::UnitX();
  };

  [[nodiscard]] Eigen::Vector2d place_mm(Pixel p) const { return {(p.x - 0.5) * h_, (p.y - 0.5) * h_}; }

  void weigh() {
    for (int k = 0; k < nz_; ++k) {
      Mass& mass = masses_.emplace_back();
      for (int y = 0; y < ny_; ++y)
        for (int x = 0; x < nx_; ++x)
          if (layer(k)[index({x, y})]) {
            mass.moment += place_mm({x, y});
            ++mass.pixels;
          }
    }
  }

  /// As the planner does: the middle of what has grown against the hull of what holds it, a share of its height inside.
  [[nodiscard]] Lean worst_lean(std::vector<Anchor> anchors, std::vector<Eigen::Vector2d> hull) const {
    std::stable_sort(anchors.begin(), anchors.end(), [](const Anchor& a, const Anchor& b) { return a.k < b.k; });
    Lean worst;
    std::size_t next = 0;
    double pixels = 0, rise = 0;
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    for (int k = 0; k < nz_; ++k) {
      const std::size_t before = next;
      for (; next < anchors.size() && anchors[next].k <= k; ++next) hull.push_back(place_mm(anchors[next].at));
      if (next != before) hull = hull_of(std::move(hull));
      const Mass& mass = masses_[static_cast<std::size_t>(k)];
      pixels += mass.pixels;
      rise += mass.pixels * (k + 0.5) * h_;
      moment += mass.moment;
      if (!(pixels > 0) || hull.empty()) continue;
      const Eigen::Vector2d centre = moment / pixels;
      const auto [inside, way] = inside_by(hull, centre);
      const double slack = inside + s_.tip_radius_mm - kLeastLean * rise / pixels;
      if (slack < worst.slack_mm) worst = {slack, k, centre, way};
    }
    return worst;
  }

  /// Anchors on the underside of a lifted part that would lean over.
  void stabilise() {
    Lean now = worst_lean(all_, {});
    if (!(now.slack_mm < 0)) return;
    const double most_mm = std::max(kStabilisedShare * box_.size().z(), 2 * s_.anchor_distance_mm);
    std::vector<Anchor> places;
    for (int k = 1; k < nz_ && k * h_ <= most_mm; ++k)
      for (int y = 1; y + 1 < ny_; ++y)
        for (int x = 1; x + 1 < nx_; ++x)
          if (is_solid({x, y}, k) && !is_solid({x, y}, k - 1) &&
              (!is_solid({x - 1, y}, k) || !is_solid({x + 1, y}, k) || !is_solid({x, y - 1}, k) ||
               !is_solid({x, y + 1}, k)))
            places.push_back({{x, y}, k});
    for (int added = 0; added < kMostStabilising && now.slack_mm < 0; ++added) {
      const Anchor* best = nullptr;
      double most = 0;
      for (const Anchor& place : places) {
        if (place.k > now.k) continue;
        const double gain = (place_mm(place.at) - now.centre).dot(now.way);
        const double worth =
            std::min(gain, 2 * std::abs(now.slack_mm) + 4 * s_.tip_radius_mm) - kStabilisedRise * place.k * h_;
        if (best == nullptr || worth > most) best = &place, most = worth;
      }
      if (best == nullptr) return;
      all_.push_back(*best);
      const Lean then = worst_lean(all_, {});
      if (then.slack_mm <= now.slack_mm && added >= 2 && then.k == now.k) {
        all_.pop_back();
        return;
      }
      std::erase_if(places, [&, at = all_.back().at](const Anchor& place) {
        return distance_px(place.at, at) * h_ < 4 * s_.tip_radius_mm;
      });
      now = then;
    }
  }

  [[nodiscard]] double stability(const std::vector<char>& first, bool is_lifted) const {
    Eigen::Vector2d moment = Eigen::Vector2d::Zero();
    double pixels = 0, rise = 0;
    for (int k = 0; k < nz_; ++k) {
      const Mass& mass = masses_[static_cast<std::size_t>(k)];
      moment += mass.moment;
      pixels += mass.pixels;
      rise += mass.pixels * (k + 0.5) * h_;
    }
    std::vector<Eigen::Vector2d> footing = feet_;
    for (int y = 0; !is_lifted && y < ny_; ++y)
      for (int x = 0; x < nx_; ++x)
        if (first[index({x, y})]) footing.push_back(place_mm({x, y}));
    if (footing.empty() || pixels == 0) return 0;
    return inside_by(hull_of(std::move(footing)), moment / pixels).first / (rise / pixels + lift_mm_);
  }

  const SolidGrid& grid_;
  const MachineProfile& machine_;
  const MachineProfile::Supports& s_;
  double layer_mm_;
  Box3 box_;
  Eigen::Matrix3d to_scan_;
  double h_;  ///< side of a pixel and height of a layer here
  int nx_ = 0, ny_ = 0, nz_ = 0;
  std::size_t pixels_ = 0;
  std::vector<char> solid_;
  std::vector<int> free_below_;
  double lift_mm_ = 0;
  std::vector<Anchor> standing_;  ///< that still have material over them
  std::vector<Anchor> all_;
  std::vector<Mass> masses_;  ///< of the layers
  std::vector<Eigen::Vector2d> feet_;
  double volume_mm3_ = 0;
};

}  // namespace

StandingFigures grown(const SolidGrid& grid, const Stance& stance, const MachineProfile& machine, double layer_mm,
                      bool in_full) {
  return Growth{grid, stance, machine, layer_mm}.run(in_full);
}

}  // namespace telefab::scan
