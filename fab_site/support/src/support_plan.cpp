// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <tbb/info.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <telefab/fab/support/support_plan.hpp>
#include <tuple>

#include "pull.hpp"
#include "route.hpp"
#include "stability.hpp"

namespace telefab::fab {
namespace {

/// Share of what a tip may bear that is planned for: masks are made of pixels, and pins grow together.
constexpr double kPlannedShare = 0.85;

/// An anchor that still has a solid column of part above it.
struct Standing {
  Point2 place;
  std::uint32_t layer = 0;
};

}  // namespace

/// Plans again and again: anchors that cover what hangs, the places where pins could stand and the columns they could
/// stand in are found once.
struct SupportPlanner::State {
  State(std::shared_ptr<const PartRegions> part, const StackHeader& header, MachineProfile machine,
        SupportOptions options)
      : part_{std::move(part)},
        machine_{std::move(machine)},
        options_{std::move(options)},
        t_{header.layer_thickness_mm},
        reach_{machine_.supports.anchor_distance_mm / std::sqrt(machine_.supports.density)} {}

  Result<SupportPlan> plan(const ProgressSink& progress, const std::stop_token& stop) {
    const PartRegions& found = *part_;
    if (!covered_) {
      if (auto ok = cover(found, progress, stop); !ok) return tl::unexpected{ok.error()};
    }
    figures_ = covered_->figures;
    anchors_ = covered_->anchors;
    const std::uint32_t elevation = covered_->elevation_layers;
    if (!router_) router_ = std::make_unique<PinRouter>(found.layers, elevation, t_, machine_);
    if (options_.mode != SupportOptions::Mode::None) {
      hold_floating(found, elevation);
      stabilise(found, elevation);
    }
    if (options_.mode == SupportOptions::Mode::Auto)
      if (auto ok = bear(found, elevation, stop); !ok) return tl::unexpected{ok.error()};
    std::stable_sort(anchors_.begin(), anchors_.end(), [](const Anchor& a, const Anchor& b) {
      return std::tie(a.layer, a.place.y_mm, a.place.x_mm) < std::tie(b.layer, b.place.y_mm, b.place.x_mm);
    });
    report(progress, WorkStage::BuildingSupports, 0);
    auto routed = router_->route(anchors_);
    figures_.feet_on_part = routed.feet_on_part;
    figures_.braces = routed.braces;
    figures_.thin_pins = routed.thin_pins;
    figures_.may_buckle = routed.may_buckle;
    figures_.unreached = routed.unreached;
    for (const Anchor& a : anchors_) {
      figures_.medium_tips += a.tip == TipClass::Medium;
      figures_.heavy_tips += a.tip == TipClass::Heavy;
    }
    StructureSections sections{std::move(routed.structure), t_,
                               elevation + static_cast<std::uint32_t>(found.layers.size()),
                               Millimetres{machine_.projection.pixel_pitch_mm / 20}};
    figures_.support_mm3 = volume_mm3(sections.structure());
    report(progress, WorkStage::BuildingSupports, 1);
    return SupportPlan{elevation, std::move(anchors_), std::move(sections), figures_};
  }

  /// Anchors of what hangs, as if there were nothing else to hold.
  Result<void> cover(const PartRegions& found, const ProgressSink& progress, const std::stop_token& stop) {
    for (const Region& layer : found.layers) figures_.part_mm3 += layer.area_mm2() * t_;
    const std::uint32_t elevation = options_.mode == SupportOptions::Mode::None ? 0 : elevation_layers(found.layers);
    if (options_.mode != SupportOptions::Mode::None)
      // What stands on the platform is held by it.
      for (std::size_t k = elevation == 0 ? 1 : 0; k < found.layers.size(); ++k) {
        if (stop.stop_requested()) return cancelled("planning supports");
        if (auto ok = cover_layer(found, k, stop); !ok) return ok;
        if (k % 16 == 0)
          report(progress, WorkStage::PlacingAnchors,
                 static_cast<double>(k) / static_cast<double>(found.layers.size()));
      }
    covered_ = Covered{elevation, std::move(anchors_), figures_};
    return {};
  }

  [[nodiscard]] bool is_removed(Point2 place, LayerIndex layer) const {
    return std::any_of(options_.hand.removed.begin(), options_.hand.removed.end(), [&](const auto& r) {
      return r.layer == layer &&
             std::hypot(place.x_mm - r.place.x_mm, place.y_mm - r.place.y_mm) <= machine_.supports.tip_radius_mm;
    });
  }

  [[nodiscard]] bool is_forbidden(Point2 place, LayerIndex layer) const {
    if (is_removed(place, layer)) return true;
    const double z = cut_height_mm(layer, t_);
    return std::any_of(options_.hand.forbidden.begin(), options_.hand.forbidden.end(), [&](const auto& f) {
      return z >= f.from_z_mm && z <= f.to_z_mm &&
             std::hypot(place.x_mm - f.place.x_mm, place.y_mm - f.place.y_mm) <= f.radius_mm;
    });
  }

  /// After the covering, which therefore stays as it was: what held before still holds.
  void hold_floating(const PartRegions& found, std::uint32_t elevation) {
    const double pixel = machine_.projection.pixel_pitch_mm;
    for (const SupportOptions::Floating& floating : options_.floating) {
      std::size_t k = floating.layer.count();
      if (k >= found.layers.size()) continue;
      Point2 place = floating.place;
      if (!found.layers[k].contains(place)) {
        const Region near = intersect(found.layers[k], disc(place, Millimetres{2 * pixel}, Millimetres{pixel / 20}));
        if (near.empty()) continue;
        place = inner_point(near);
      }
      // Within the part's own column nothing would be built: down to its underside.
      while (k > 0 && found.layers[k - 1].contains(place)) --k;
      const LayerIndex underside{static_cast<std::uint32_t>(k)};
      if ((k == 0 && elevation == 0) || is_forbidden(place, underside)) continue;
      anchors_.push_back({place, underside, false, false});
      ++figures_.floating;
    }
  }

  Result<void> bear(const PartRegions& found, std::uint32_t elevation, const std::stop_token& stop) {
    for (const SupportOptions::Bearing& earlier : options_.bearing) {
      const auto known = std::find_if(anchors_.begin(), anchors_.end(), [&](const Anchor& a) {
        return a.layer == earlier.layer && a.place == earlier.place;
      });
      Anchor& anchor =
          known != anchors_.end() ? *known : anchors_.emplace_back(Anchor{earlier.place, earlier.layer, false, false});
      figures_.bearing += known == anchors_.end();
      anchor.tip = earlier.tip;
      anchor.strength = earlier.strength;
    }
    PullOptions options;
    options.elevation_layers = elevation;
    options.thickness_mm = t_;
    options.most_demand = kPlannedShare / std::max(1.0, machine_.supports.density) * machine_.carried_demand();
    options.keeps_tips = !options_.bearing.empty();
    for (const TipClass tip : {TipClass::Light, TipClass::Heavy}) router_->make_room_for(tip);
    options.can_stand = [&](const Anchor& a) { return !is_forbidden(a.place, a.layer) && router_->can_stand(a); };
    const auto borne = bear_pull(found.layers, anchors_, machine_, options, sites_, stop);
    if (!borne) return tl::unexpected{borne.error()};
    figures_.bearing += borne->added;
    figures_.bearing_demand = borne->demand;
    return {};
  }

  void stabilise(const PartRegions& found, std::uint32_t elevation) {
    if (elevation > 0) {
      for (Anchor& anchor : stabilising_anchors(found.layers, anchors_, machine_)) {
        if (is_forbidden(anchor.place, anchor.layer)) continue;
        anchors_.push_back(anchor);
        ++figures_.stabilising;
      }
    }
    const Stability stands = stability_of(found.layers, anchors_, elevation == 0, machine_);
    figures_.stability_mm = stands.slack_mm;
    figures_.least_stable = stands.layer;
  }

  [[nodiscard]] std::uint32_t elevation_layers(const std::vector<Region>& layers) const {
    double largest = 0;
    for (const Region& layer : layers) largest = std::max(largest, layer.area_mm2());
    if (largest == 0) return 0;
    const double stands = layers.front().area_mm2() / largest;
    const bool lifted = options_.stand == SupportOptions::Stand::Never ||
                        (options_.stand == SupportOptions::Stand::Auto && stands < machine_.supports.stand_area_share);
    if (!lifted) return 0;
    const auto& s = machine_.supports;
    const double least = s.base_thickness_mm + 2 * s.tip_radius_mm + 2 * t_;
    return static_cast<std::uint32_t>(std::ceil(std::max(s.lift_off_mm, least) / t_ - 1e-6));
  }

  Result<void> cover_layer(const PartRegions& found, std::size_t k, const std::stop_token& stop) {
    const Region& layer = found.layers[k];
    const double span = reach_ * reach_;
    std::erase_if(standing_, [&](const Standing& s) {
      const double rise = (static_cast<double>(k) - s.layer) * t_;
      return rise * rise >= span || !layer.contains(s.place);
    });
    add_by_hand(layer, k);
    Region wanted = found.to_support[k];
    if (wanted.empty()) return {};
    ++figures_.layers_with_regions;
    figures_.to_support_mm2 += wanted.area_mm2();
    if (const Region closed = forbidden_at(k); !closed.empty()) {
      const Region open = subtract(wanted, closed);
      figures_.waived_mm2 += wanted.area_mm2() - open.area_mm2();
      wanted = open;
    }
    const auto pieces = layer.pieces();
    for (const Region& piece : pieces) {
      Region rest = pieces.size() == 1 ? wanted : intersect(wanted, piece);
      if (rest.empty()) continue;
      std::vector<Region> held;
      for (const Standing& s : standing_) {
        if (pieces.size() > 1 && !piece.contains(s.place)) continue;
        const double rise = (static_cast<double>(k) - s.layer) * t_;
        held.push_back(disc(s.place, Millimetres{std::sqrt(span - rise * rise) * 0.999}, Millimetres{reach_ / 500}));
      }
      if (!held.empty()) rest = subtract(rest, unite(held));
      if (rest.empty()) continue;
      CoveringOptions options;
      options.anchor_distance = Millimetres{reach_};
      auto covering = cover_region(rest, options, stop);
      if (!covering) return tl::unexpected{covering.error()};
      for (const Point2& place : covering->anchors)
        if (const auto kept = under_what_ends(place, piece, found.layers, k)) anchor(*kept, k, false);
    }
    // What shows in the mask as a body of its own must stand on an anchor of its own, however near the next one.
    const Region closed = forbidden_at(k);
    for (const Region& island : found.islands[k]) {
      const Region open = closed.empty() ? island : subtract(island, closed);
      if (open.empty()) continue;
      if (std::any_of(standing_.begin(), standing_.end(), [&](const Standing& s) { return island.contains(s.place); }))
        continue;
      const Point2 place = inner_point(open);
      const auto piece = std::find_if(pieces.begin(), pieces.end(), [&](const Region& p) { return p.contains(place); });
      const auto kept = piece == pieces.end() ? place : under_what_ends(place, *piece, found.layers, k);
      if (kept) anchor(*kept, k, false);
    }
    return {};
  }

  /// Where a pin to `place` in a piece of layer k really ends in material. Above most places there is more of it. Where
  /// the piece ends with its layer, it is the pin's only hold, and what lies on the layer below needs none: then the
  /// place is one beyond the layer below, or none at all if less than 0.6 pixels of that would be held.
  [[nodiscard]] std::optional<Point2> under_what_ends(Point2 place, const Region& piece,
                                                      const std::vector<Region>& layers, std::size_t k) const {
    if (k == 0 || (k + 1 < layers.size() && layers[k + 1].contains(place))) return place;
    const double pixel = machine_.projection.pixel_pitch_mm;
    const Millimetres tip{machine_.supports.tip_radius_mm}, tolerance{pixel / 20};
    if (k + 1 < layers.size() && !intersect(layers[k + 1], disc(place, tip, tolerance)).empty()) return place;
    const Region fresh = subtract(piece, layers[k - 1]);
    const auto hold = [&](Point2 at) { return intersect(fresh, disc(at, tip, tolerance)).area_mm2(); };
    if (hold(place) >= pixel * pixel) return place;
    if (fresh.area_mm2() < pixel * pixel) return std::nullopt;
    // Where it reaches widest, of the places that are allowed.
    std::vector<Point2> places{place};
    for (const double inwards : {0.0, pixel / 4, pixel / 2})
      for (const Region& part : offset(fresh, Millimetres{-inwards}, tolerance).pieces())
        places.push_back(inner_point(part));
    std::optional<Point2> best;
    double most = 0.6 * pixel * pixel;
    for (const Point2 at : places) {
      if (is_forbidden(at, LayerIndex{static_cast<std::uint32_t>(k)}) || hold(at) <= most) continue;
      best = at;
      most = hold(at);
    }
    return best;
  }

  void anchor(Point2 place, std::size_t k, bool by_hand) {
    const LayerIndex layer{static_cast<std::uint32_t>(k)};
    if (!by_hand && is_removed(place, layer))
      ++figures_.removed;  // it still counts as standing, or its neighbours would be placed otherwise
    else
      anchors_.push_back({place, layer, by_hand, false});
    standing_.push_back({place, static_cast<std::uint32_t>(k)});
  }

  void add_by_hand(const Region& layer, std::size_t k) {
    placed_.resize(options_.hand.extra.size(), 0);
    for (std::size_t i = 0; i < options_.hand.extra.size(); ++i) {
      const HandList::Extra& extra = options_.hand.extra[i];
      if (placed_[i] || cut_height_mm(LayerIndex{static_cast<std::uint32_t>(k)}, t_) < extra.z_mm) continue;
      if (!layer.contains(extra.place)) continue;
      placed_[i] = 1;
      anchor(extra.place, k, true);
    }
  }

  [[nodiscard]] Region forbidden_at(std::size_t k) const {
    const double z = cut_height_mm(LayerIndex{static_cast<std::uint32_t>(k)}, t_);
    std::vector<Region> closed;
    for (const HandList::Forbidden& f : options_.hand.forbidden)
      if (z >= f.from_z_mm && z <= f.to_z_mm)
        closed.push_back(disc(f.place, Millimetres{f.radius_mm}, Millimetres{f.radius_mm / 500}));
    return unite(closed);
  }

  struct Covered {
    std::uint32_t elevation_layers = 0;
    std::vector<Anchor> anchors;
    SupportFigures figures;
  };

  std::shared_ptr<const PartRegions> part_;
  MachineProfile machine_;
  SupportOptions options_;
  double t_;
  double reach_;
  std::optional<Covered> covered_;
  std::unique_ptr<PinRouter> router_;
  std::optional<std::vector<PinSite>> sites_;
  SupportFigures figures_;
  std::vector<Anchor> anchors_;
  std::vector<Standing> standing_;
  std::vector<char> placed_;
};

Result<void> SupportOptions::validate() const {
  if (threads < 0 || threads > 1024) return fail(ErrorCode::InvalidInput, "supports: threads must be 0 to 1024");
  const auto finite = [](double v) { return std::isfinite(v) && std::abs(v) <= 1e5; };
  for (const auto& e : hand.extra)
    if (!finite(e.place.x_mm) || !finite(e.place.y_mm) || !finite(e.z_mm))
      return fail(ErrorCode::InvalidInput, "supports: an extra place by hand is not a finite number");
  for (const auto& r : hand.removed)
    if (!finite(r.place.x_mm) || !finite(r.place.y_mm))
      return fail(ErrorCode::InvalidInput, "supports: an anchor removed by hand is not at a finite place");
  for (const auto& f : floating)
    if (!finite(f.place.x_mm) || !finite(f.place.y_mm))
      return fail(ErrorCode::InvalidInput, "supports: a place where material floats is not a finite number");
  for (const auto& b : bearing)
    if (!finite(b.place.x_mm) || !finite(b.place.y_mm) || !(b.strength > 0 && b.strength <= 1))
      return fail(ErrorCode::InvalidInput,
                  "supports: an anchor that stays needs a finite place and a strength in (0, 1]");
  for (const auto& f : hand.forbidden)
    if (!finite(f.place.x_mm) || !finite(f.place.y_mm) || !finite(f.from_z_mm) || !finite(f.to_z_mm) ||
        !(f.radius_mm > 0 && f.radius_mm <= 1e4) || f.from_z_mm > f.to_z_mm)
      return fail(ErrorCode::InvalidInput,
                  "supports: a forbidden place by hand needs a radius above 0 and from_z_mm <= to_z_mm");
  return {};
}

std::string_view name_of(TipClass tip) {
  switch (tip) {
    case TipClass::Light:
      return "light";
    case TipClass::Medium:
      return "medium";
    case TipClass::Heavy:
      return "heavy";
  }
  return "light";
}

std::vector<Contour> SupportPlan::section(LayerIndex print_layer) const {
  return sections_.section(print_layer).to_contours();
}

namespace {

/// On as many threads as the options say.
template <class Work>
auto on_threads(const SupportOptions& options, const Work& work) {
  const int cores = tbb::info::default_concurrency();
  const int threads = options.threads == 0 ? cores : std::min(cores, options.threads);
  std::optional<decltype(work())> done;
  tbb::task_arena{threads}.execute([&] { done.emplace(work()); });
  return std::move(*done);
}

}  // namespace

SupportPlanner::SupportPlanner(std::unique_ptr<State> state) : state_{std::move(state)} {}
SupportPlanner::~SupportPlanner() = default;
SupportPlanner::SupportPlanner(SupportPlanner&&) noexcept = default;
SupportPlanner& SupportPlanner::operator=(SupportPlanner&&) noexcept = default;

Result<SupportPlanner> SupportPlanner::make(std::shared_ptr<const PartRegions> part, const StackHeader& header,
                                            const MachineProfile& machine, const SupportOptions& options) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (auto ok = header.validate(); !ok) return tl::unexpected{ok.error()};
  if (part->layers.size() != header.layer_count)
    return fail(ErrorCode::InvalidInput, fmt::format("planning supports: {} layers were analysed of {}",
                                                     part->layers.size(), header.layer_count));
  if (!(part->law == self_support_law(machine)))
    return fail(ErrorCode::InvalidInput,
                fmt::format("planning supports: the layers were analysed by another law than {}'s", machine.name));
  return SupportPlanner{std::make_unique<State>(std::move(part), header, machine, options)};
}

Result<SupportPlanner> SupportPlanner::make(std::span<const Layer> layers, const StackHeader& header,
                                            const MachineProfile& machine, const SupportOptions& options,
                                            const ProgressSink& progress, const std::stop_token& stop) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (auto ok = header.validate(); !ok) return tl::unexpected{ok.error()};
  report(progress, WorkStage::FindingRegions, 0);
  auto part = on_threads(options, [&] { return analyse_part(layers, machine, stop); });
  if (!part) return tl::unexpected{part.error()};
  return make(std::make_shared<const PartRegions>(std::move(*part)), header, machine, options);
}

Result<SupportPlan> SupportPlanner::plan(std::vector<SupportOptions::Floating> floating,
                                         std::vector<SupportOptions::Bearing> bearing, const ProgressSink& progress,
                                         const std::stop_token& stop) {
  State& state = *state_;
  state.options_.floating = std::move(floating);
  state.options_.bearing = std::move(bearing);
  if (auto ok = state.options_.validate(); !ok) return tl::unexpected{ok.error()};
  return on_threads(state.options_, [&] { return state.plan(progress, stop); });
}

Result<SupportPlan> plan_supports(std::span<const Layer> layers, const StackHeader& header,
                                  const MachineProfile& machine, const SupportOptions& options,
                                  const ProgressSink& progress, std::stop_token stop) {
  auto planner = SupportPlanner::make(layers, header, machine, options, progress, stop);
  if (!planner) return tl::unexpected{planner.error()};
  return planner->plan(options.floating, options.bearing, progress, stop);
}

Result<SupportPlan> plan_supports(const PartRegions& part, const StackHeader& header, const MachineProfile& machine,
                                  const SupportOptions& options, const ProgressSink& progress, std::stop_token stop) {
  // Only looked into, and only by the planner, which is gone first.
  auto planner = SupportPlanner::make({std::shared_ptr<void>{}, &part}, header, machine, options);
  if (!planner) return tl::unexpected{planner.error()};
  return planner->plan(options.floating, options.bearing, progress, stop);
}

Result<LayerRegions> regions_of_layer(std::span<const Layer> layers, LayerIndex layer, const MachineProfile& machine) {
  const std::size_t k = layer.count();
  if (k >= layers.size())
    return fail(ErrorCode::NotFound, fmt::format("no layer {}; the part has {}", k, layers.size()));
  const Millimetres tolerance{machine.projection.pixel_pitch_mm / 10};
  const auto current = Region::from_contours(layers[k].contours);
  if (!current) return tl::unexpected{current.error()};
  Region below;
  if (k > 0) {
    auto read = Region::from_contours(layers[k - 1].contours);
    if (!read) return tl::unexpected{read.error()};
    below = simplified(*read, tolerance);
  }
  return analyse_layer(below, simplified(*current, tolerance), self_support_law(machine));
}

}  // namespace telefab::fab
