// SPDX-License-Identifier: GPL-3.0-or-later
#include "pull.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "pull_survey.hpp"
#include "tip_shape.hpp"

namespace telefab::fab {
namespace {

/// What is pulled less is left as it is, where light tips are that wide; less where they are narrower.
constexpr double kLeastMm2 = 7, kLightTipMm = 0.2;
/// A new pin costs as much as so many light necks' areas, beside its own.
constexpr double kPinCost = 1;
/// Tips that bear less than this share of what they may count as bearing nothing too much.
constexpr double kEase = 0.9;
constexpr std::size_t kMostTips = 4000;
constexpr std::size_t kGroup = 8;  ///< tips that are looked at together
constexpr std::uint32_t kNone = ~std::uint32_t{0};

/// A tip as a spring under a rigid body.
struct Spring {
  Point2 at;
  double stiffness = 0;  ///< mm
  double area_mm2 = 0;
  double radius_mm = 0;
};

/// Sums over springs from which stresses follow.
struct Springs {
  double w = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  void add(const Spring& s, double sign = 1) {
    const double k = sign * s.stiffness;
    w += k, x += k * s.at.x_mm, y += k * s.at.y_mm;
    xx += k * (s.at.x_mm * s.at.x_mm + s.radius_mm * s.radius_mm / 4);
    xy += k * s.at.x_mm * s.at.y_mm;
    yy += k * (s.at.y_mm * s.at.y_mm + s.radius_mm * s.radius_mm / 4);
  }
};

/// How stress runs over a level section: at(place) * stiffness / area.
struct Plane {
  double lift = 0, dx = 0, dy = 0;
  double tilt = 0;  ///< length of (dx, dy)
  Plane(const Springs& s, double area_mm2, Point2 f) {
    const double gx = s.x / s.w, gy = s.y / s.w;
    const double xx = s.xx - s.w * gx * gx, xy = s.xy - s.w * gx * gy, yy = s.yy - s.w * gy * gy;
    const double det = xx * yy - xy * xy, mx = f.x_mm - gx, my = f.y_mm - gy;
    dx = area_mm2 * (yy * mx - xy * my) / det;
    dy = area_mm2 * (xx * my - xy * mx) / det;
    lift = area_mm2 / s.w - dx * gx - dy * gy;
    tilt = std::hypot(dx, dy);
  }
  /// At the rim that bears most.
  [[nodiscard]] double stress(const Spring& s) const {
    return (lift + dx * s.at.x_mm + dy * s.at.y_mm + tilt * s.radius_mm) * s.stiffness / s.area_mm2;
  }
};

/// Distance of pins, by the class of the newer one.
using ApartMm = std::array<double, 3>;

/// Eases the worst moment of all, again and again, until none bears too much or nothing helps.
class Balance {
 public:
  Balance(PullSurvey survey, std::vector<Anchor>& anchors, const std::function<Spring(const Anchor&)>& spring_of,
          const PullOptions& options, const ApartMm& apart)
      : survey_{std::move(survey)},
        anchors_{anchors},
        spring_of_{spring_of},
        most_{options.most_demand},
        keeps_tips_{options.keeps_tips},
        apart_{apart},
        pin_cost_{kPinCost * spring_of({{}, LayerIndex{0}, false, false, TipClass::Light}).area_mm2},
        own_{anchors.size()},
        nearest_mm_(survey_.sites.size(), std::numeric_limits<double>::infinity()),
        moments_of_site_(survey_.sites.size()),
        moments_of_tip_(anchors.size()),
        state_(survey_.moments.size()) {
    for (const Anchor& a : anchors_) springs_.push_back(spring_of_(a));
    for (const Anchor& a : anchors_) measure(a);
    for (std::uint32_t m = 0; m < state_.size(); ++m) {
      for (const std::uint32_t a : survey_.moments[m].anchors) moments_of_tip_[a].push_back(m);
      for (const std::uint32_t s : survey_.moments[m].sites) moments_of_site_[s].push_back(m);
      judge(m);
    }
  }

  Result<PullFigures> run(const std::stop_token& stop) {
    while (anchors_.size() < kMostTips) {
      if (stop.stop_requested()) return cancelled("planning supports");
      std::uint32_t worst = kNone;
      for (std::uint32_t m = 0; m < state_.size(); ++m)
        if (!state_[m].is_given_up && state_[m].worst > 1 && (worst == kNone || state_[m].worst > state_[worst].worst))
          worst = m;
      if (worst == kNone) break;
      // Wide tips first: the fewest pins. Narrow ones fit where those do not.
      if (!ease(worst, TipClass::Heavy) && !ease(worst, TipClass::Light)) state_[worst].is_given_up = true;
    }
    if (!keeps_tips_) thin_out();
    PullFigures figures;
    for (std::uint32_t m = 0; m < state_.size(); ++m)
      if (std::isfinite(state_[m].worst)) figures.demand = std::max(figures.demand, state_[m].worst * most_);
    note_demands();
    std::vector<Anchor> kept;
    for (std::size_t a = 0; a < anchors_.size(); ++a) {
      if (springs_[a].stiffness <= 0) continue;
      kept.push_back(anchors_[a]);
      figures.added += a >= own_;
    }
    anchors_ = std::move(kept);
    return figures;
  }

 private:
  struct State {
    Springs sums;
    double worst = 0;   ///< most stress of a tip over what it may bear
    double excess = 0;  ///< what all bear beyond kEase of it, squared
    bool is_given_up = false;
  };
  struct Verdict {
    double worst = 0, excess = 0;
  };

  void measure(const Anchor& a) {
    for (std::size_t i = 0; i < nearest_mm_.size(); ++i) {
      const Point2 p = survey_.sites[i].place;
      nearest_mm_[i] = std::min(nearest_mm_[i], std::hypot(p.x_mm - a.place.x_mm, p.y_mm - a.place.y_mm));
    }
  }

  static void count(double over, Verdict& verdict) {
    verdict.worst = std::max(verdict.worst, over);
    if (over > kEase) verdict.excess += (over - kEase) * (over - kEase);
  }

  [[nodiscard]] Verdict verdict_of(const Springs& sums, const PullSurvey::Moment& moment) const {
    if (!(sums.w > 0)) return {std::numeric_limits<double>::infinity(), 1e30};
    const Plane plane{sums, moment.pulled_mm2, moment.middle};
    Verdict verdict;
    for (const std::uint32_t a : moment.anchors)
      if (springs_[a].stiffness > 0) count(plane.stress(springs_[a]) / most_, verdict);
    return verdict;
  }

  void judge(std::uint32_t m) {
    State& state = state_[m];
    state.sums = {};
    for (const std::uint32_t a : survey_.moments[m].anchors) state.sums.add(springs_[a]);
    const Verdict verdict = verdict_of(state.sums, survey_.moments[m]);
    state.worst = verdict.worst, state.excess = verdict.excess;
  }

  /// What each tip bears in the end, at its worst moment.
  void note_demands() {
    for (std::uint32_t m = 0; m < state_.size(); ++m) {
      const PullSurvey::Moment& moment = survey_.moments[m];
      if (!(state_[m].sums.w > 0)) continue;
      const Plane plane{state_[m].sums, moment.pulled_mm2, moment.middle};
      for (const std::uint32_t a : moment.anchors)
        if (springs_[a].stiffness > 0) anchors_[a].demand = std::max(anchors_[a].demand, plane.stress(springs_[a]));
    }
  }

  [[nodiscard]] static TipClass next(TipClass tip, int by) { return static_cast<TipClass>(static_cast<int>(tip) + by); }

  /// The springs that hold a moment's body, in the order of its anchors, in rows of numbers: all candidates of a moment
  /// are judged by them.
  struct Held {
    std::vector<std::uint32_t> anchors;
    std::vector<double> x, y, radius, stiffness;
    std::vector<double> ease;   ///< forces up to which a tip surely bears no more than kEase of what it may
    std::vector<double> force;  ///< of the candidate that is looked at
    /// Those that bear beyond kEase without any candidate, most first: their places, radii, and what a force is to
    /// what they may bear. In whole groups, the last filled up with what bears nothing.
    std::vector<double> first_x, first_y, first_radius, first_share;
  };
  [[nodiscard]] Held held_by(std::uint32_t m) const {
    constexpr double kSurely = 1 - 1e-12;  // far more than three roundings
    const PullSurvey::Moment& moment = survey_.moments[m];
    Held held;
    for (const std::uint32_t a : moment.anchors) {
      const Spring& s = springs_[a];
      if (s.stiffness <= 0) continue;
      held.anchors.push_back(a);
      held.x.push_back(s.at.x_mm), held.y.push_back(s.at.y_mm);
      held.radius.push_back(s.radius_mm), held.stiffness.push_back(s.stiffness);
      held.ease.push_back(kEase * most_ * s.area_mm2 * kSurely);
    }
    held.force.resize(held.x.size());
    if (!(state_[m].sums.w > 0)) return held;
    const Plane plane{state_[m].sums, moment.pulled_mm2, moment.middle};
    std::vector<std::pair<double, std::uint32_t>> bearing;
    for (const std::uint32_t a : held.anchors)
      if (const double over = plane.stress(springs_[a]) / most_; over > kEase) bearing.emplace_back(-over, a);
    std::sort(bearing.begin(), bearing.end());
    const std::size_t size = (bearing.size() + kGroup - 1) / kGroup * kGroup;
    for (auto* row : {&held.first_x, &held.first_y, &held.first_radius, &held.first_share}) row->resize(size);
    for (std::size_t i = 0; i < bearing.size(); ++i) {
      const Spring& s = springs_[bearing[i].second];
      held.first_x[i] = s.at.x_mm, held.first_y[i] = s.at.y_mm, held.first_radius[i] = s.radius_mm;
      held.first_share[i] = s.stiffness / (s.area_mm2 * most_);
    }
    return held;
  }

  static double beyond_ease(double over) { return over > kEase ? (over - kEase) * (over - kEase) : 0; }

  /// True where springs as they are, but for one that goes, surely bear more beyond kEase than that: known after a look
  /// at those that bear most. But for roundings.
  [[nodiscard]] bool exceeds(double excess, const Plane& plane, const Held& held, const Spring* without) const {
    if (without) excess += beyond_ease(plane.stress(*without) / most_);
    const double lift = plane.lift, dx = plane.dx, dy = plane.dy, tilt = plane.tilt;
    std::array<double, kGroup> sums{};
    for (std::size_t from = 0; from < held.first_x.size(); from += kGroup) {
      const double *const x = held.first_x.data() + from, *const y = held.first_y.data() + from,
                          *const radius = held.first_radius.data() + from,
                          *const share = held.first_share.data() + from;
      for (std::size_t i = 0; i < kGroup; ++i) {
        const double beyond = (lift + dx * x[i] + dy * y[i] + tilt * radius[i]) * share[i] - kEase;
        const double counts = beyond > 0 ? beyond : 0;
        sums[i] += counts * counts;
      }
      double sum = 0;
      for (const double some : sums) sum += some;
      if (sum > excess) return true;
    }
    return false;
  }

  /// verdict_of(...).excess to the last bit; the spring of `other`, if any, being another.
  [[nodiscard]] double excess_of(const Plane& plane, Held& held, std::uint32_t other, const Spring& instead) const {
    const std::size_t size = held.x.size();
    const double lift = plane.lift, dx = plane.dx, dy = plane.dy, tilt = plane.tilt;
    const double *const x = held.x.data(), *const y = held.y.data(), *const radius = held.radius.data(),
                        *const stiffness = held.stiffness.data();
    double* const force = held.force.data();
#pragma GCC ivdep
    for (std::size_t i = 0; i < size; ++i) force[i] = (lift + dx * x[i] + dy * y[i] + tilt * radius[i]) * stiffness[i];
    Verdict verdict;
    for (std::size_t i = 0; i < size; ++i) {
      const std::uint32_t a = held.anchors[i];
      if (a == other)
        count(plane.stress(instead) / most_, verdict);
      else if (!(force[i] <= held.ease[i]))
        count(force[i] / springs_[a].area_mm2 / most_, verdict);
    }
    return verdict.excess;
  }

  /// What a moment would gain of a candidate, for its area; nothing where that is surely less than `least`.
  [[nodiscard]] std::optional<double> gain_of_site(std::uint32_t m, std::uint32_t s, TipClass tip, double least,
                                                   Held& held) const {
    const Spring spring = spring_of_(anchor_at(s, tip));
    Springs sums = state_[m].sums;
    sums.add(spring);
    return gain_of(m, sums, spring.area_mm2 + pin_cost_, least, held, kNone, spring);
  }
  [[nodiscard]] std::optional<double> gain_of_wider(std::uint32_t m, std::uint32_t a, double least, Held& held) const {
    Anchor wider = anchors_[a];
    wider.tip = next(wider.tip, 1);
    const Spring& thin = springs_[a];
    const Spring wide = spring_of_(wider);
    Springs sums = state_[m].sums;
    sums.add(thin, -1);
    sums.add(wide);
    return gain_of(m, sums, wide.area_mm2 - thin.area_mm2, least, held, a, wide);
  }
  /// `other`: the anchor whose spring becomes `spring`; none: it is one more.
  [[nodiscard]] std::optional<double> gain_of(std::uint32_t m, const Springs& sums, double cost, double least,
                                              Held& held, std::uint32_t other, const Spring& spring) const {
    const double excess = state_[m].excess;
    if (!(sums.w > 0)) return (excess - 1e30) / cost;
    const Plane plane{sums, survey_.moments[m].pulled_mm2, survey_.moments[m].middle};
    constexpr double kSurely = 1e-9;  // of sums in another order
    if (exceeds(excess - least * cost + kSurely * excess, plane, held, other == kNone ? nullptr : &springs_[other]))
      return std::nullopt;
    Verdict verdict{0, excess_of(plane, held, other, spring)};
    if (other == kNone) count(plane.stress(spring) / most_, verdict);
    return (excess - verdict.excess) / cost;
  }

  /// One more pin, or a wider one: what gains most for its area at that moment. False where nothing does.
  bool ease(std::uint32_t m, TipClass first) {
    const PullSurvey::Moment& moment = survey_.moments[m];
    Held held = held_by(m);
    const auto has_room = [&](std::uint32_t s) {
      return first <= survey_.sites[s].widest && nearest_mm_[s] >= apart_[static_cast<std::size_t>(first) - 1];
    };
    // What nearly won the last time is a good measure of what is not worth a closer look.
    double least = 0, best = 0, second = 0;
    std::uint32_t site = kNone, tip = kNone, next_best = kNone;
    if (next_best_ != kNone && has_room(next_best_) &&
        std::binary_search(moments_of_site_[next_best_].begin(), moments_of_site_[next_best_].end(), m))
      least = std::max(0.0, gain_of_site(m, next_best_, first, 0, held).value_or(0));
    for (const std::uint32_t s : moment.sites) {
      if (!has_room(s)) continue;
      const auto gain = gain_of_site(m, s, first, std::max(least, second), held);
      if (!gain) continue;
      if (*gain > best) {
        second = best, next_best = site;
        best = *gain, site = s;
      } else if (*gain > second) {
        second = *gain, next_best = s;
      }
    }
    for (const std::uint32_t a : moment.anchors) {
      if (anchors_[a].tip == TipClass::Heavy || springs_[a].stiffness <= 0) continue;
      const auto gain = gain_of_wider(m, a, std::max(least, best), held);
      if (!gain || !(*gain > best)) continue;
      best = *gain, tip = a;
    }
    if (tip != kNone)
      widen(tip, 1);
    else if (site != kNone)
      add(site, first);
    next_best_ = next_best;
    return site != kNone || tip != kNone;
  }

  [[nodiscard]] Anchor anchor_at(std::uint32_t site, TipClass tip) const {
    return {survey_.sites[site].place, survey_.sites[site].layer, false, false, tip};
  }

  void add(std::uint32_t s, TipClass tip) {
    const auto a = static_cast<std::uint32_t>(anchors_.size());
    anchors_.push_back(anchor_at(s, tip));
    springs_.push_back(spring_of_(anchors_.back()));
    moments_of_tip_.push_back(moments_of_site_[s]);
    measure(anchors_.back());
    for (const std::uint32_t m : moments_of_site_[s]) {
      survey_.moments[m].anchors.push_back(a);
      judge(m);
    }
  }
  void widen(std::uint32_t a, int by) {
    anchors_[a].tip = next(anchors_[a].tip, by);
    springs_[a] = spring_of_(anchors_[a]);
    for (const std::uint32_t m : moments_of_tip_[a]) judge(m);
  }

  /// Puts another spring in the place of a tip's where all its moments bear that; false, and nothing changed, where one
  /// does not. A moment that was too weak must not become weaker.
  [[nodiscard]] bool replace(std::uint32_t a, const Spring& spring) {
    const Spring was = std::exchange(springs_[a], spring);
    const auto bears = [&](std::uint32_t m) {
      Springs sums = state_[m].sums;
      sums.add(was, -1);
      sums.add(spring);
      return verdict_of(sums, survey_.moments[m]).worst <= std::max(1.0, state_[m].worst * (1 + 1e-9));
    };
    const auto& moments = moments_of_tip_[a];
    if (!std::all_of(moments.begin(), moments.end(), bears)) {
      springs_[a] = was;
      return false;
    }
    for (const std::uint32_t m : moments) judge(m);
    return true;
  }

  /// Takes away and thins what the others bear as well, the latest first: what came early stands where most is asked.
  void thin_out() {
    for (std::size_t i = anchors_.size(); i-- > 0;) {
      const auto a = static_cast<std::uint32_t>(i);
      if (i >= own_ && replace(a, Spring{springs_[a].at, 0, 1, 0})) continue;
      while (anchors_[a].tip != TipClass::Light) {
        Anchor thinner = anchors_[a];
        thinner.tip = next(thinner.tip, -1);
        if (!replace(a, spring_of_(thinner))) break;
        anchors_[a] = thinner;
      }
    }
  }

  PullSurvey survey_;
  std::vector<Anchor>& anchors_;
  const std::function<Spring(const Anchor&)>& spring_of_;
  double most_;
  bool keeps_tips_;
  ApartMm apart_;
  double pin_cost_;                  ///< mm2, beside a tip's own
  std::uint32_t next_best_ = kNone;  ///< site that the last easing would have taken instead
  std::size_t own_;                  ///< so many anchors were there before
  std::vector<double> nearest_mm_;   ///< anchor, by site
  std::vector<std::vector<std::uint32_t>> moments_of_site_, moments_of_tip_;
  std::vector<Spring> springs_;  ///< by anchor; without stiffness: taken away
  std::vector<State> state_;     ///< by moment
};

struct Pin {
  TipShape shape;
  double softness = 0;  ///< 1/mm
};

/// The pin of every class under every layer; a balance asks for the same ones again and again.
class PinsByHeight {
 public:
  PinsByHeight(const MachineProfile& machine, const PullOptions& options, std::size_t layers) : layers_{layers} {
    for (const TipClass tip : {TipClass::Light, TipClass::Medium, TipClass::Heavy})
      for (std::size_t layer = 0; layer < layers; ++layer) {
        const double height_mm = static_cast<double>(layer + options.elevation_layers) * options.thickness_mm;
        const TipShape shape = tip_shape(machine, tip, height_mm, options.thickness_mm);
        pins_.push_back({shape, shape.softness(height_mm)});
      }
  }
  [[nodiscard]] const Pin& of(const Anchor& a) const {
    return pins_[(static_cast<std::size_t>(a.tip) - 1) * layers_ + a.layer.count()];
  }

 private:
  std::size_t layers_;
  std::vector<Pin> pins_;
};

}  // namespace

Result<PullFigures> bear_pull(std::span<const Region> layers, std::vector<Anchor>& anchors,
                              const MachineProfile& machine, const PullOptions& options,
                              std::optional<std::vector<PinSite>>& sites, const std::stop_token& stop) {
  const auto& s = machine.supports;
  const double gap_mm = s.clearance_mm + 2 * machine.projection.pixel_pitch_mm;
  // So that shafts stand clear of each other.
  const ApartMm apart{2 * s.pin_radius_mm + gap_mm / 2, 2.5 * s.pin_radius_mm + gap_mm / 2,
                      3 * s.pin_radius_mm + gap_mm};
  const PinsByHeight pins{machine, options, layers.size()};
  PullSurveyOptions look;
  look.cell_mm = s.pin_radius_mm;
  look.site_pitch_mm = apart[0] / 2;
  look.least_mm2 = kLeastMm2 * std::min(1.0, s.tip_radius_mm * s.tip_radius_mm / (kLightTipMm * kLightTipMm));
  look.weight_share = machine.weight_share();
  look.vacuum_share = machine.vacuum_of_hollow_kpa() / machine.pull_of_film_kpa();
  look.doubled_at_mm = machine.motion.pull_size_mm;
  look.pull_share = [&](LayerIndex layer, double area_mm2) {
    return machine.pull_share_of_layer(layer.count() + options.elevation_layers, area_mm2);
  };
  look.stands = options.elevation_layers == 0;
  look.widest_at = [&](Point2 at, LayerIndex layer) -> std::optional<TipClass> {
    for (const TipClass tip : {TipClass::Heavy, TipClass::Light}) {
      const Anchor anchor{at, layer, false, false, tip};
      // A tip finds material nearly all over its disc before it ends.
      const double r = pins.of(anchor).shape.disc_mm;
      const auto deep = static_cast<std::size_t>(r / options.thickness_mm + 1);
      const Region& part = layers[std::min(layers.size() - 1, layer.count() + deep)];
      int held = 0;
      for (const auto& [dx, dy] : {std::pair{r, 0.0}, {-r, 0.0}, {0.0, r}, {0.0, -r}})
        held += part.contains({at.x_mm + dx, at.y_mm + dy});
      if (held >= 3 && options.can_stand(anchor)) return tip;
    }
    return std::nullopt;
  };
  if (sites) look.known_sites = &*sites;
  auto survey = survey_pull(layers, anchors, look, stop);
  if (!survey) return tl::unexpected{survey.error()};
  if (!sites) sites = survey->sites;
  const std::function<Spring(const Anchor&)> spring_of = [&](const Anchor& a) {
    const Pin& pin = pins.of(a);
    return Spring{a.place, 1 / pin.softness, a.strength * pin.shape.neck_area_mm2(), pin.shape.neck_mm};
  };
  return Balance{std::move(*survey), anchors, spring_of, options, apart}.run(stop);
}

}  // namespace telefab::fab
