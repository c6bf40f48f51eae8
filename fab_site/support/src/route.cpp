// SPDX-License-Identifier: GPL-3.0-or-later
#include "route.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>
#include <telefab/base/disjoint_sets.hpp>

#include "convex_hull.hpp"
#include "part_columns.hpp"
#include "tip_shape.hpp"

namespace telefab::fab {
namespace {

struct PinBody {
  Point2 place;
  double bottom_mm = 0;
  double top_mm = 0;
  double radius_mm = 0;
  double base_mm = 0;       ///< wanted radius at its lower end
  double contact_mm = 0;    ///< height of what it holds
  double load_n = 0;        ///< under which it must not buckle
  std::size_t element = 0;  ///< index of its Pin element
  std::size_t foot = 0;     ///< of its Foot
  bool on_platform = false;
  std::vector<double> braced_at{};
};

/// Plates that cover less of the largest layer may let go of the platform: chosen, no measurement of that was found.
constexpr double kBaseShare = 0.2;
constexpr std::uint32_t kSink = 3;  ///< layers a foot goes into the part it stands on

}  // namespace

struct PinRouter::State {
  State(std::span<const Region> layers, std::uint32_t elevation, double thickness, const MachineProfile& machine)
      : layers_{layers},
        elevation_{elevation},
        t_{thickness},
        machine_{machine},
        p_{machine.supports},
        arm_rise_{1 / std::tan(machine.supports.arm_degrees * std::numbers::pi / 180)},
        cell_{cell_of(layers, machine)},
        bare_{layers, 0, cell_},
        slim_{layers, p_.tip_radius_mm + p_.clearance_mm / 2, cell_},
        wide_{layers, p_.pin_radius_mm + p_.clearance_mm, cell_} {}

  /// Columns for wide pins are made once there are some: heavy ones, or all where tips are wider than light shafts.
  void make_room_for(TipClass tip) {
    if (wider_ || (tip == TipClass::Light && p_.tip_radius_mm <= p_.pin_radius_mm)) return;
    const double widest = std::max(1.5 * p_.pin_radius_mm, shape_of(TipClass::Heavy, 0).disc_mm);
    wider_.emplace(layers_, widest + p_.clearance_mm, cell_);
  }
  [[nodiscard]] bool can_stand(const Anchor& anchor) const {
    const double contact = (anchor.layer.count() + elevation_) * t_;
    return choose(anchor.place, contact, anchor.tip, Ground::Platform).has_value();
  }

  RoutedStructure route(std::vector<Anchor>& anchors) {
    out_ = {};
    pins_.clear();
    pairs_.clear();
    if (anchors.empty()) return {};
    for (const Anchor& anchor : anchors) make_room_for(anchor.tip);
    for (Anchor& anchor : anchors) place(anchor);
    brace();
    add_companions();
    taper();
    lay_raft();
    return std::move(out_);
  }

  static double cell_of(std::span<const Region> layers, const MachineProfile& machine) {
    double side = 0;
    for (const Region& layer : layers) {
      const Bounds2 b = layer.bounds();
      side = std::max({side, b.max.x_mm - b.min.x_mm, b.max.y_mm - b.min.y_mm});
    }
    return std::max(machine.supports.pin_radius_mm / 2, side / 300);
  }

  /// The part layer at a height of the print; negative in the elevation.
  [[nodiscard]] std::int64_t part_layer(double z_mm) const {
    return static_cast<std::int64_t>(std::floor(z_mm / t_ + 1e-6)) - elevation_;
  }
  [[nodiscard]] double top_of(std::uint32_t part_layer) const { return (part_layer + elevation_ + 1.0) * t_; }
  /// Columns in which a shaft of that radius keeps its distance; errs to a wider one.
  [[nodiscard]] const PartColumns& wide(double radius_mm = 0) const {
    return radius_mm > p_.pin_radius_mm * (1 + 1e-9) ? *wider_ : wide_;
  }
  [[nodiscard]] TipShape shape_of(TipClass tip, double contact_mm) const {
    return tip_shape(machine_, tip, contact_mm, t_);
  }

  [[nodiscard]] bool on_platform(Point2 q, double r) const {
    return q.x_mm >= r && q.y_mm >= r && q.x_mm <= machine_.platform.width_mm - r &&
           q.y_mm <= machine_.platform.depth_mm - r;
  }

  void add(SupportElementKind kind, Point3 bottom, Point3 top, double r0, double r1) {
    if (top.z_mm - bottom.z_mm > 1e-9) out_.structure.elements.push_back({kind, bottom, top, r0, r1});
  }

  struct Choice {
    Point2 foot;
    double joint_mm = 0;  ///< height where arm meets pin
    double floor_mm = 0;  ///< top of what the pin stands on
    double sunk_mm = 0;   ///< where the foot begins
    bool stands_on_part = false;
  };

  /// Material that a mask shows right at the place: a disc of most of a pixel fits.
  [[nodiscard]] bool solid_at(Point2 q, std::uint32_t layer) const {
    const double r = 0.75 * machine_.projection.pixel_pitch_mm;
    const Region& part = layers_[layer];
    return part.contains(q) && part.contains({q.x_mm + r, q.y_mm}) && part.contains({q.x_mm - r, q.y_mm}) &&
           part.contains({q.x_mm, q.y_mm + r}) && part.contains({q.x_mm, q.y_mm - r});
  }

  /// The highest layer below `layer` whose material truly lies under the place; columns only say where to look.
  [[nodiscard]] std::optional<std::uint32_t> floor_below(Point2 q, std::int64_t layer) const {
    for (auto hit = bare_.highest_below(q, layer); hit; hit = bare_.highest_below(q, *hit))
      if (solid_at(q, *hit)) return hit;
    return std::nullopt;
  }

  /// Where a foot on that layer begins: a few layers down in the part, but never out of its lower side.
  [[nodiscard]] double sunk_mm(Point2 q, std::uint32_t floor) const {
    std::uint32_t lowest = floor;
    while (lowest > 0 && floor - lowest + 1 < kSink && solid_at(q, lowest - 1)) --lowest;
    return (lowest + elevation_) * t_;
  }

  /// True where a foot's whole disc finds material.
  [[nodiscard]] bool foot_is_held(Point2 q, std::uint32_t floor) const {
    const double r = 0.7 * p_.tip_radius_mm;
    int held = 0;
    for (const auto& [dx, dy] : {std::pair{r, r}, {r, -r}, {-r, r}, {-r, -r}})
      held += layers_[floor].contains({q.x_mm + dx, q.y_mm + dy});
    return held >= 3;
  }

  /// True where an arm from the tip's end down to the joint keeps clear of the part.
  [[nodiscard]] bool arm_is_clear(Point2 from, double from_mm, Point2 to, double to_mm, double tip_mm) const {
    const int steps = std::max(1, static_cast<int>((from_mm - to_mm) / t_));
    for (int i = 1; i <= steps; ++i) {
      const double s = static_cast<double>(i) / steps;
      const Point2 q{from.x_mm + s * (to.x_mm - from.x_mm), from.y_mm + s * (to.y_mm - from.y_mm)};
      const double z = from_mm + s * (to_mm - from_mm);
      const double below = from_mm - z;
      const PartColumns& part = below < tip_mm ? bare_ : slim_;
      if (part.occupied(q, part_layer(z))) return false;
    }
    return true;
  }

  /// True where a full pin there meets no material between two heights, by the layers themselves.
  [[nodiscard]] bool shaft_is_clear(Point2 q, double radius_mm, double from_mm, double to_mm) const {
    const double pixel = machine_.projection.pixel_pitch_mm;
    const Region body = disc(q, Millimetres{radius_mm}, Millimetres{pixel / 10});
    for (std::int64_t k = std::max<std::int64_t>(0, part_layer(from_mm)); k <= part_layer(to_mm); ++k)
      if (k < static_cast<std::int64_t>(layers_.size()) &&
          intersect(body, layers_[static_cast<std::size_t>(k)]).area_mm2() > pixel * pixel / 4)
        return false;
    return true;
  }

  /// What a pin is to stand on.
  enum class Ground : std::uint8_t { Platform, Any };

  /// The nearest free column to the platform, else, if that will do, the nearest on which a pin can stand on the part.
  [[nodiscard]] std::optional<Choice> choose(Point2 at, double contact_mm, TipClass tip, Ground ground) const {
    std::optional<Choice> on_part;
    const TipShape shape = shape_of(tip, contact_mm);
    const double radius = shape.pin_mm, reach = std::min(20 * p_.pin_radius_mm, contact_mm * 0.8);
    const double step = std::max(cell_, p_.pin_radius_mm / 2);
    for (double rho = 0; rho <= reach; rho += step) {
      const int turns = rho == 0 ? 1 : std::clamp(static_cast<int>(2 * std::numbers::pi * rho / step), 8, 32);
      for (int i = 0; i < turns; ++i) {
        const double angle = 2 * std::numbers::pi * i / turns;
        const Point2 q{at.x_mm + rho * std::cos(angle), at.y_mm + rho * std::sin(angle)};
        if (!on_platform(q, radius)) continue;
        const double joint = contact_mm - shape.tip_mm - std::max(shape.cone_mm, rho * arm_rise_);
        if (joint <= p_.base_thickness_mm) continue;
        const auto clear = [&] { return arm_is_clear(at, contact_mm - t_, q, joint, shape.length_mm()); };
        const auto hit = wide(radius).highest_below(q, part_layer(joint) + 1);
        if (!hit) {
          if (!clear()) continue;
          return Choice{q, joint, 0, 0, false};
        }
        if (ground == Ground::Platform || on_part || p_.ground == PinGround::Platform) continue;
        if (rho > 0 && !clear()) continue;
        const auto floor = floor_below(q, part_layer(joint) + 1);
        if (!floor || !foot_is_held(q, *floor)) continue;
        const double floor_mm = top_of(*floor);
        // Room for a full pin on the part: the pin body's clearance is broken only close above its foot.
        if (joint - floor_mm < 2 * radius) continue;
        if (top_of(*hit) - floor_mm > 2 * radius + p_.clearance_mm) continue;
        if (!shaft_is_clear(q, radius, floor_mm + 2 * radius, top_of(*hit))) continue;
        if (rho == 0 || clear()) on_part = Choice{q, joint, floor_mm, sunk_mm(q, *floor), true};
      }
    }
    return on_part;
  }

  /// As deep as wanted, but one layer at least, and never out of the part's upper side.
  [[nodiscard]] double depth_mm(Point2 at, std::uint32_t layer, double wanted_mm) const {
    std::uint32_t inside = 1;
    while ((inside + 1) * t_ <= wanted_mm + 1e-9 && layer + inside + 1 < layers_.size() &&
           layers_[layer + inside + 1].contains(at))
      ++inside;
    return inside * t_;
  }

  void place(Anchor& anchor) {
    const double contact = (anchor.layer.count() + elevation_) * t_;
    const Point2 at = anchor.place;
    auto choice = choose(at, contact, anchor.tip, Ground::Any);
    // Where there is no room for a wide one, or only on the part, a narrower one may still do.
    while (anchor.tip != TipClass::Light && (!choice || choice->stands_on_part)) {
      anchor.tip = static_cast<TipClass>(static_cast<int>(anchor.tip) - 1);
      choice = choose(at, contact, anchor.tip, Ground::Any);
    }
    if (!choice) return stand_thin_pin(anchor, contact);
    const TipShape shape = shape_of(anchor.tip, contact);
    const double neck_mm = contact - shape.tip_mm, radius = shape.pin_mm;
    // The contact disc goes into the part, the waist just below it is where the pin breaks off.
    const double top_mm = contact + depth_mm(at, anchor.layer.count(), shape.depth_mm);
    add(SupportElementKind::Tip, {at.x_mm, at.y_mm, neck_mm}, {at.x_mm, at.y_mm, top_mm}, shape.neck_mm, shape.disc_mm);
    add(SupportElementKind::Arm, {choice->foot.x_mm, choice->foot.y_mm, choice->joint_mm}, {at.x_mm, at.y_mm, neck_mm},
        radius, shape.neck_mm);
    PinBody body{choice->foot,
                 choice->floor_mm,
                 choice->joint_mm,
                 radius,
                 shape.base_mm,
                 contact,
                 load_n(shape, anchor.demand),
                 0,
                 0,
                 !choice->stands_on_part};
    anchor.on_part = choice->stands_on_part;
    anchor.foot = choice->foot;
    const Point3 top{choice->foot.x_mm, choice->foot.y_mm, choice->joint_mm};
    double bottom = choice->floor_mm;
    body.foot = out_.structure.elements.size();
    if (anchor.on_part) {
      ++out_.feet_on_part;
      // A small foot, sunk a few layers into the part so that it is welded on, as easy to break off as a tip.
      const double height = std::min(2 * radius, choice->joint_mm - bottom);
      add(SupportElementKind::Foot, {top.x_mm, top.y_mm, choice->sunk_mm}, {top.x_mm, top.y_mm, bottom + height},
          std::min(radius, 1.25 * shape.disc_mm), radius);
      bottom += height;
    } else {
      bottom = add_foot(choice->foot, choice->joint_mm, radius);
    }
    body.element = out_.structure.elements.size();
    add(SupportElementKind::Pin, {top.x_mm, top.y_mm, bottom}, top, radius, radius);
    if (out_.structure.elements.size() > body.element) pins_.push_back(std::move(body));
  }

  /// With what the tip is pulled, as planned or at most, and so pushed when the part goes down again, with the safety
  /// of its strength.
  [[nodiscard]] double load_n(const TipShape& shape, double demand) const {
    constexpr double kKilo = 1000;
    const double stress_mpa = (demand > 0 ? demand : machine_.carried_demand()) * machine_.pull_of_film_kpa() / kKilo;
    return p_.safety * stress_mpa * shape.neck_area_mm2();
  }

  /// On the platform, below a pin of that height; where it ends.
  double add_foot(Point2 q, double pin_mm, double radius_mm) {
    const double height = std::min(foot_height_mm(p_), pin_mm);
    const double foot = p_.foot_radius_mm + radius_mm - p_.pin_radius_mm;
    add(SupportElementKind::Foot, {q.x_mm, q.y_mm, 0}, {q.x_mm, q.y_mm, height}, foot, radius_mm);
    return height;
  }

  /// Where nothing wider fits: straight down, as thin as a tip, to whatever lies below.
  void stand_thin_pin(Anchor& anchor, double contact) {
    const Point2 at = anchor.place;
    const auto floor = floor_below(at, anchor.layer.count());
    if (floor && p_.ground == PinGround::Platform) {
      ++out_.unreached;
      return;
    }
    ++out_.thin_pins;
    anchor.on_part = floor.has_value();
    anchor.foot = at;
    const double r = p_.tip_radius_mm;
    const double bottom = floor ? sunk_mm(at, *floor) : 0;
    out_.feet_on_part += floor.has_value();
    const double length = contact - bottom;
    const double waist = std::min(p_.pin_radius_mm, std::max(r, length / (2 * p_.slenderness)));
    add(SupportElementKind::ThinPin, {at.x_mm, at.y_mm, bottom}, {at.x_mm, at.y_mm, contact + t_}, floor ? r : waist,
        r);
    if (!floor)
      add(SupportElementKind::Foot, {at.x_mm, at.y_mm, 0}, {at.x_mm, at.y_mm, std::min(contact, p_.foot_radius_mm)},
          p_.foot_radius_mm, r);
  }

  /// Zigzag of slanted struts between near neighbours, every brace pitch, where the way is clear of the part.
  void brace() {
    const double far = 2 * p_.brace_pitch_mm;
    for (std::size_t i = 0; i < pins_.size(); ++i) {
      if (!is_slender(pins_[i])) continue;
      std::vector<std::pair<double, std::size_t>> near;
      for (std::size_t j = 0; j < pins_.size(); ++j) {
        const double d =
            std::hypot(pins_[i].place.x_mm - pins_[j].place.x_mm, pins_[i].place.y_mm - pins_[j].place.y_mm);
        if (j != i && d > 2 * p_.pin_radius_mm && d <= far) near.emplace_back(d, j);
      }
      std::sort(near.begin(), near.end());
      int joined = 0;
      for (const auto& [d, j] : near) {
        if (joined >= 2) break;
        const std::pair<std::size_t, std::size_t> pair = std::minmax(i, j);
        if (pairs_.contains(pair)) {
          ++joined;
          continue;
        }
        if (join(pins_[i], pins_[j], d)) {
          pairs_.insert(pair);
          ++joined;
        }
      }
    }
  }

  bool join(PinBody& a, PinBody& b, double apart) {
    const double low = std::max(a.bottom_mm, b.bottom_mm) + p_.foot_radius_mm + p_.base_thickness_mm;
    const double high = std::min(a.top_mm, b.top_mm);
    bool any = false;
    int turn = 0;
    for (double z = low; z + apart <= high; z += p_.brace_pitch_mm, ++turn) {
      PinBody& from = turn % 2 ? b : a;
      PinBody& to = turn % 2 ? a : b;
      if (!strut_is_clear(from.place, to.place, z, apart)) continue;
      add_strut(from, to, z, apart);
      any = true;
    }
    return any;
  }

  [[nodiscard]] bool strut_is_clear(Point2 from, Point2 to, double z_mm, double rise_mm) const {
    const int steps = std::max(2, static_cast<int>(rise_mm / t_));
    for (int i = 0; i <= steps; ++i) {
      const double s = static_cast<double>(i) / steps;
      const Point2 q{from.x_mm + s * (to.x_mm - from.x_mm), from.y_mm + s * (to.y_mm - from.y_mm)};
      if (wide().occupied(q, part_layer(z_mm + s * rise_mm))) return false;
    }
    return true;
  }

  /// Heights at which a pin is held, and its ends.
  [[nodiscard]] static std::vector<double> held_at(const PinBody& body, double top_mm) {
    std::vector<double> at{body.bottom_mm, top_mm};
    at.insert(at.end(), body.braced_at.begin(), body.braced_at.end());
    std::sort(at.begin(), at.end());
    return at;
  }
  /// The longest piece of a pin between its ends and struts.
  [[nodiscard]] static double free_mm(const PinBody& body) {
    const auto at = held_at(body, body.top_mm);
    double free = 0;
    for (std::size_t i = 1; i < at.size(); ++i) free = std::max(free, at[i] - at[i - 1]);
    return free;
  }
  /// Whether a pin with that radius at its lower end stands its load between struts, by Euler: hinged, a cone as a
  /// shaft of its ends' geometric mean (exact where the second moment goes with the fourth power of the place,
  /// Timoshenko and Gere).
  [[nodiscard]] bool stands_load(const PinBody& body, double base_mm) const {
    if (body.load_n <= 0) return true;
    const double pi = std::numbers::pi, length = body.top_mm - body.bottom_mm;
    const double per_radii = std::sqrt(pi * pi * pi * machine_.modulus_of_green_mpa() / (4 * body.load_n));
    const auto radius_at = [&](double z) {
      const double below = length > 0 ? std::clamp((body.top_mm - z) / length, 0.0, 1.0) : 0.0;
      return body.radius_mm + below * (std::max(base_mm, body.radius_mm) - body.radius_mm);
    };
    const auto at = held_at(body, std::max(body.contact_mm, body.top_mm));
    for (std::size_t i = 1; i < at.size(); ++i)
      if (at[i] - at[i - 1] > per_radii * radius_at(at[i]) * radius_at(at[i - 1])) return false;
    return true;
  }
  [[nodiscard]] bool is_slender(const PinBody& body) const {
    return free_mm(body) > p_.slenderness * 2 * body.radius_mm || !stands_load(body, body.base_mm);
  }

  /// A pin on the platform that stands free for too long and has no neighbour gets a companion: a pin beside it that
  /// holds nothing but its struts, and ends in the last of them.
  void add_companions() {
    const double apart = 0.75 * p_.brace_pitch_mm;
    const std::size_t count = pins_.size();
    for (std::size_t i = 0; i < count; ++i) {
      if (!pins_[i].on_platform || !is_slender(pins_[i])) continue;
      const Point2 at = pins_[i].place;
      for (int turn = 0; turn < 16; ++turn) {
        const double angle = 2 * std::numbers::pi * turn / 16;
        const Point2 q{at.x_mm + apart * std::cos(angle), at.y_mm + apart * std::sin(angle)};
        if (on_platform(q, p_.pin_radius_mm) && stand_companion(i, q, apart)) break;
      }
    }
  }

  /// False where part or pins are in the way, or where the struts would not do.
  bool stand_companion(std::size_t i, Point2 q, double apart) {
    const double low = p_.foot_radius_mm + p_.base_thickness_mm, high = pins_[i].top_mm;
    // Struts lead to the companion and back in turn; the last one leads back.
    const int pairs = static_cast<int>(std::floor((high - apart - low) / p_.brace_pitch_mm + 1)) / 2;
    if (pairs < 1) return false;
    const double top = low + (2 * pairs - 1) * p_.brace_pitch_mm;
    if (wide().highest_below(q, part_layer(top) + 1)) return false;
    for (const PinBody& other : pins_)
      if (std::hypot(other.place.x_mm - q.x_mm, other.place.y_mm - q.y_mm) < 4 * p_.pin_radius_mm) return false;
    const Point2 at = pins_[i].place;
    for (int s = 0; s < 2 * pairs; ++s) {
      const double z = low + s * p_.brace_pitch_mm;
      if (!strut_is_clear(s % 2 ? q : at, s % 2 ? at : q, z, apart)) return false;
    }
    PinBody companion{
        q, 0, top + t_, p_.pin_radius_mm, p_.pin_radius_mm, top + t_, 0, 0, out_.structure.elements.size(), true};
    const double foot = add_foot(q, companion.top_mm, p_.pin_radius_mm);
    companion.element = out_.structure.elements.size();
    add(SupportElementKind::Pin, {q.x_mm, q.y_mm, foot}, {q.x_mm, q.y_mm, companion.top_mm}, p_.pin_radius_mm,
        p_.pin_radius_mm);
    for (int s = 0; s < 2 * pairs; ++s)
      add_strut(s % 2 ? companion : pins_[i], s % 2 ? pins_[i] : companion, low + s * p_.brace_pitch_mm, apart);
    pins_.push_back(std::move(companion));
    return true;
  }

  void add_strut(PinBody& from, PinBody& to, double z_mm, double rise_mm) {
    const double r = std::max(p_.tip_radius_mm, 0.6 * p_.pin_radius_mm);
    add(SupportElementKind::Brace, {from.place.x_mm, from.place.y_mm, z_mm},
        {to.place.x_mm, to.place.y_mm, z_mm + rise_mm}, r, r);
    from.braced_at.push_back(z_mm);
    to.braced_at.push_back(z_mm + rise_mm);
    ++out_.braces;
  }

  /// A pin that stands free for too long in spite of all struts grows towards its foot until its slenderness is legal
  /// and it bears its load, as far as the part leaves room; on the platform its foot grows with it.
  void taper() {
    for (const PinBody& body : pins_) {
      SupportElement& pin = out_.structure.elements[body.element];
      double wanted = std::max(body.on_platform ? body.base_mm : 0, free_mm(body) / (2 * p_.slenderness));
      constexpr double kMostGrowth = 4;
      while (!stands_load(body, wanted) && wanted < kMostGrowth * body.radius_mm)
        wanted = 1.05 * std::max(wanted, body.radius_mm);
      while (wanted > pin.bottom_radius_mm && !has_room(pin, wanted, body.on_platform)) wanted *= 0.8;
      out_.may_buckle += !stands_load(body, wanted);
      if (wanted <= pin.bottom_radius_mm) continue;
      // The arm's end stays as it was: the pin tapers to it.
      pin.bottom_radius_mm = wanted;
      if (!body.on_platform) continue;
      SupportElement& foot = out_.structure.elements[body.foot];
      foot.top_radius_mm = wanted;
      foot.bottom_radius_mm = std::max(foot.bottom_radius_mm, wanted + p_.foot_radius_mm - p_.pin_radius_mm);
    }
  }

  /// True where a pin with that radius at its bottom keeps the part's distance; but for the lowest tenth of one that
  /// stands on the part.
  [[nodiscard]] bool has_room(const SupportElement& pin, double bottom_radius_mm, bool on_platform) const {
    const double length = pin.top.z_mm - pin.bottom.z_mm;
    const int steps = std::max(2, static_cast<int>(length / t_));
    for (int i = on_platform ? 0 : steps / 10; i <= steps; ++i) {
      const double s = static_cast<double>(i) / steps;
      const double beyond = (1 - s) * (bottom_radius_mm - pin.top_radius_mm);
      const std::int64_t layer = part_layer(pin.bottom.z_mm + s * length);
      const int turns = std::clamp(static_cast<int>(2 * std::numbers::pi * beyond / cell_), 4, 64);
      for (double rho = beyond; rho > 0; rho -= cell_)
        for (int turn = 0; turn < turns; ++turn) {
          const double angle = 2 * std::numbers::pi * turn / turns;
          if (wide().occupied({pin.top.x_mm + rho * std::cos(angle), pin.top.y_mm + rho * std::sin(angle)}, layer))
            return false;
        }
    }
    return true;
  }

  struct Footing {
    Point2 place;
    double radius_mm = 0;
  };

  /// Corners of the plates of a group each: of feet that stand near each other, in the order of their first.
  [[nodiscard]] std::vector<std::vector<Point2>> groups_of(std::span<const Footing> feet) const {
    DisjointSets joined{feet.size()};
    for (std::uint32_t i = 0; i < feet.size(); ++i)
      for (std::uint32_t j = 0; j < i; ++j)
        if (apart_mm(feet[i].place, feet[j].place) < near_mm()) joined.join(i, j);
    const auto numbers = joined.numbers();
    std::vector<std::vector<Point2>> groups;
    for (std::size_t i = 0; i < feet.size(); ++i) {
      groups.resize(std::max(groups.size(), std::size_t{numbers[i]} + 1));
      groups[numbers[i]].push_back(feet[i].place);
    }
    for (auto& group : groups) group = convex_hull(std::move(group));
    return groups;
  }
  [[nodiscard]] static double apart_mm(Point2 a, Point2 b) { return std::hypot(a.x_mm - b.x_mm, a.y_mm - b.y_mm); }
  /// Feet so near to each other are of one group.
  [[nodiscard]] double near_mm() const { return 6 * p_.foot_radius_mm; }

  /// Whether plates of that radius cover enough of the largest layer to hold it on the platform.
  [[nodiscard]] bool suffice(const std::vector<std::vector<Point2>>& plates, double radius_mm) const {
    double covered = 0, largest = 0;
    for (const auto& corners : plates) covered += area_mm2({corners, radius_mm, 0, 0});
    for (const Region& layer : layers_) largest = std::max(largest, layer.area_mm2());
    return covered >= kBaseShare * largest;
  }

  void lay_raft() {
    if (p_.base_thickness_mm <= 0 || p_.raft == RaftKind::None) return;
    std::vector<Footing> feet;
    for (const PinBody& body : pins_)
      if (body.on_platform) feet.push_back({body.place, out_.structure.elements[body.foot].bottom_radius_mm});
    if (feet.empty()) return;
    const double lip = std::tan(p_.raft_lip_degrees * std::numbers::pi / 180);
    // As wide on the platform as it says; the lip is beyond.
    const auto lay = [&](std::vector<Point2> corners, double radius_mm) {
      out_.structure.plates.push_back(
          {std::move(corners), radius_mm + lip * p_.base_thickness_mm / 2, p_.base_thickness_mm, lip});
    };
    double widest = 0;
    for (const Footing& foot : feet) widest = std::max(widest, foot.radius_mm);
    const auto lay_one = [&] {
      std::vector<Point2> places;
      for (const Footing& foot : feet) places.push_back(foot.place);
      lay(convex_hull(std::move(places)), widest + p_.raft_margin_mm);
    };
    switch (p_.raft) {
      case RaftKind::Auto: {
        // Beside a part that stands a plate would grow to it; under a lifted one bars would enclose resin.
        if (elevation_ == 0) return lay_plates(feet, lay);
        const double radius_mm = std::max(widest, 1.5 * p_.foot_radius_mm);
        auto groups = groups_of(feet);
        if (!suffice(groups, radius_mm)) return lay_one();
        for (auto& corners : groups) lay(std::move(corners), radius_mm);
        return;
      }
      case RaftKind::Plate:
        return lay_one();
      case RaftKind::Skate:
        for (const Footing& foot : feet) lay({foot.place}, foot.radius_mm + p_.raft_margin_mm);
        return;
      case RaftKind::Plates:
        return lay_plates(feet, lay);
      case RaftKind::None:
        return;
    }
  }

  void lay_plates(std::span<const Footing> feet, const auto& lay) {
    for (std::size_t i = 0; i < feet.size(); ++i) {
      // Each foot is joined to its nearest earlier foot of the group; the plates of a group hang together.
      double best = near_mm();
      std::size_t found = i;
      for (std::size_t j = 0; j < i; ++j) {
        const double d = apart_mm(feet[i].place, feet[j].place);
        if (d < best) best = d, found = j;
      }
      std::vector<Point2> corners{feet[i].place};
      if (found != i && !(feet[i].place == feet[found].place)) corners.push_back(feet[found].place);
      lay(std::move(corners), p_.foot_radius_mm * 1.5);
    }
  }

  std::span<const Region> layers_;
  std::uint32_t elevation_;
  double t_;
  const MachineProfile& machine_;
  const MachineProfile::Supports& p_;
  double arm_rise_;  ///< of an arm, over how far it reaches
  double cell_;
  PartColumns bare_, slim_, wide_;
  std::optional<PartColumns> wider_;  ///< where there are pins wider than light ones
  RoutedStructure out_;
  std::vector<PinBody> pins_;
  std::set<std::pair<std::size_t, std::size_t>> pairs_;
};

PinRouter::PinRouter(std::span<const Region> layers, std::uint32_t elevation_layers, double thickness_mm,
                     const MachineProfile& machine)
    : state_{std::make_unique<State>(layers, elevation_layers, thickness_mm, machine)} {}
PinRouter::~PinRouter() = default;

void PinRouter::make_room_for(TipClass tip) { state_->make_room_for(tip); }

bool PinRouter::can_stand(const Anchor& anchor) const { return state_->can_stand(anchor); }

RoutedStructure PinRouter::route(std::vector<Anchor>& anchors) { return state_->route(anchors); }

}  // namespace telefab::fab
