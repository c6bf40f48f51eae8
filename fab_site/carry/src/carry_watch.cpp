// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <telefab/fab/carry/carry_watch.hpp>
#include <tuple>

#include "least_cut.hpp"
#include "level_bending.hpp"

namespace telefab::fab {
namespace {

using Check = CarryPlace::Check;

/// Moments are judged in batches: in each by what was the worst before it, so that any number of threads finds the
/// same.
constexpr std::uint32_t kBatch = 32;
/// The cut of the worst lever need not be the least cut: those are looked at that bear these shares of the worst in the
/// mean.
constexpr std::array kShares{0.25, 0.5, 1.0};
/// Of a high print beams are looked at about so many times, and at every merge of pieces.
constexpr std::uint32_t kBeamMoments = 600;
constexpr std::int64_t kFine = 1024;

struct Found {
  CarryPlace place;
  std::uint32_t section = 0;
};

/// What is known so far: floors below which nothing is of interest.
struct Worst {
  Ratio cut{kPullUnits, 1};
  std::array<double, 3> large{};  ///< by check
  double small = 0;
};

struct Judge {
  const LoadPath& path;
  const CarryOptions& options;
  Worst worst;
  std::vector<Found> found{};
  std::vector<std::uint32_t> ways_through{};  ///< by piece; all 0 between cuts

  [[nodiscard]] bool is_large(double held_mm2) const { return held_mm2 >= options.least_held_mm2; }

  void note(Check check, std::uint32_t moment, std::uint32_t section, const Pull& pull, double demand) {
    const bool large = is_large(pull.area_mm2);
    double& floor = large ? worst.large[static_cast<std::size_t>(check) - 1] : worst.small;
    if (demand <= floor && demand <= options.limit) return;
    floor = std::max(floor, demand);
    const Section& s = path.sections()[section];
    found.push_back({{check, LayerIndex{moment}, LayerIndex{path.pieces()[s.upper].layer}, s.middle, s.area_mm2,
                      pull.area_mm2, pull.middle, demand},
                     section});
  }

  /// The sections of a cut with what they stand on: the ways down from it, until all have joined. What some share is as
  /// soft for each as if it had a share of it.
  [[nodiscard]] std::vector<CutPart> parts_of(const Moment& moment, const Hanging& hanging) {
    std::vector<char> in(moment.pieces.size());
    for (const std::uint32_t node : hanging.nodes) in[node] = 1;
    std::vector<std::uint32_t> ends;
    for (const std::uint32_t e : hanging.edges) {
      const CoreEdge& edge = moment.edges[e];
      ends.push_back(moment.pieces[in[edge.a] ? edge.b : edge.a]);
    }
    ways_through.resize(path.pieces().size());
    const auto walk = [&](std::uint32_t end, const auto& visit) {
      for (std::uint32_t p = end; p != LoadPath::kPlatform; p = path.step_down(p).next) visit(p);
    };
    for (const std::uint32_t end : ends) walk(end, [&](std::uint32_t p) { ++ways_through[p]; });
    std::vector<CutPart> parts;
    for (std::size_t i = 0; i < ends.size(); ++i) {
      const CoreEdge& edge = moment.edges[hanging.edges[i]];
      const Section& s = path.sections()[edge.section];
      double softness = edge.softness;
      walk(ends[i], [&](std::uint32_t p) {
        if (ways_through[p] < ends.size()) softness += ways_through[p] * path.step_down(p).softness;
      });
      const double below = (moment.layer + 1 - path.pieces()[s.upper].layer) * path.thickness_mm();
      parts.push_back({&s, 1 / softness, below});
    }
    for (const std::uint32_t end : ends) walk(end, [&](std::uint32_t p) { ways_through[p] = 0; });
    return parts;
  }

  void look_at(const Moment& moment, const Hanging& hanging) {
    Pull pull{path.pull_mm2(hanging.pulled), {}, options.sideways_share};
    for (const std::uint32_t l : hanging.loads) {
      const Moment::Load& load = moment.loads[l];
      const double share = static_cast<double>(load.pulled) / static_cast<double>(hanging.pulled);
      pull.middle.x_mm += share * load.at.x_mm;
      pull.middle.y_mm += share * load.at.y_mm;
    }
    const auto parts = parts_of(moment, hanging);
    const CutStress stress = stress_of(parts, pull);
    const auto section = [&](std::size_t part) {
      return static_cast<std::uint32_t>(parts[part].section - path.sections().data());
    };
    note(Check::Cut, moment.layer, section(stress.lever_at), pull, stress.mean);
    note(Check::Lever, moment.layer, section(stress.lever_at), pull, stress.lever);
    note(Check::Bending, moment.layer, section(stress.bending_at), pull, stress.bending);
  }

  void cuts(const Moment& moment) {
    if (moment.loads.empty()) return;
    LeastCut flow{moment, path};
    const double lever = std::min(std::max(worst.large[1], worst.large[0]), options.limit);
    const double lowest = std::max(kShares.front() * lever, 1.0 / kFine);
    bool any = false;
    for (const double share : kShares) {
      const double demand = std::max(lowest, share * lever);
      const auto hanging = flow.beyond({std::max<std::int64_t>(1, std::llround(demand * kFine)) * kPullUnits, kFine});
      for (const Hanging& h : hanging) look_at(moment, h);
      any = !hanging.empty();
      if (!any) break;
    }
    // The largest ratio of all, by Dinkelbach: each cut found is the next demand. What is small is taken out on its
    // way.
    while (any) {
      const auto hanging = flow.beyond(worst.cut);
      any = !hanging.empty();
      Ratio most = worst.cut;
      for (const Hanging& h : hanging) {
        look_at(moment, h);
        if (is_large(path.pull_mm2(h.pulled))) {
          if (h.pulled * most.under > most.over * h.cut) most = h.ratio();
        } else {
          for (const std::uint32_t load : h.loads) flow.release(load);
        }
      }
      worst.cut = most;
    }
  }

  void beams(std::uint32_t moment) {
    const LevelFloors floors{std::min(worst.large[2], options.limit), std::min(worst.small, options.limit)};
    const auto levels = worst_levels(path, moment, options.sideways_share, options.least_held_mm2, floors);
    for (const auto* list : {&levels.large, &levels.small})
      for (const LevelStress& level : *list) note(Check::Bending, moment, level.section, level.pull, level.stress);
  }
};

/// Moments at which level sections are looked at.
std::vector<char> beam_moments(const LoadPath& path) {
  const std::uint32_t layers = path.layers(), step = std::max(1U, layers / kBeamMoments);
  std::vector<char> is_one(layers);
  std::vector<std::uint32_t> ways_down(path.pieces().size());
  for (std::uint32_t k = 1; k < layers; ++k) {
    is_one[k] = k % step == 0 || k + 1 == layers;
    for (std::uint32_t s = path.first_section(k); s < path.first_section(k + 1); ++s)
      if (++ways_down[path.sections()[s].upper] == 2) {
        is_one[k] = 1;
        is_one[k - 1] = k > 1;
      }
  }
  return is_one;
}

/// What was found of a print, and, by moment, what of it hangs on nothing then, in kPullUnits of a pixel.
struct Judged {
  std::vector<Found> found;
  std::vector<std::int64_t> afloat;
};

/// How far a print is judged: to its end, or until something is found too weak.
enum class Until : std::uint8_t { End, FirstWeak };

/// Judges the moments from `from` on. Fails: Cancelled.
Result<Judged> judge(const LoadPath& path, const CarryOptions& options, std::uint32_t from, Until until,
                     const std::stop_token& stop) {
  const auto has_beams = beam_moments(path);
  LoadCore core{path};
  Worst worst;
  Judged judged;
  for (std::uint32_t first = 0; first < path.layers(); first += kBatch) {
    if (stop.stop_requested()) return cancelled("judging loads");
    const std::uint32_t count = std::min(kBatch, path.layers() - first);
    std::vector<Moment> moments;
    for (std::uint32_t i = 0; i < count; ++i) {
      moments.push_back(core.add());
      judged.afloat.push_back(moments.back().afloat);
    }
    std::vector<Judge> judges(count, Judge{path, options, worst});
    tbb::parallel_for(std::uint32_t{0}, count, [&](std::uint32_t i) {
      if (first + i < from) return;
      judges[i].cuts(moments[i]);
      if (has_beams[first + i]) judges[i].beams(first + i);
      judges[i].ways_through = {};
    });
    for (Judge& each : judges) {
      judged.found.insert(judged.found.end(), each.found.begin(), each.found.end());
      if (each.worst.cut.value() > worst.cut.value()) worst.cut = each.worst.cut;
      for (std::size_t c = 0; c < worst.large.size(); ++c)
        worst.large[c] = std::max(worst.large[c], each.worst.large[c]);
      worst.small = std::max(worst.small, each.worst.small);
    }
    if (until == Until::FirstWeak && *std::max_element(worst.large.begin(), worst.large.end()) > options.limit) break;
  }
  return judged;
}

/// The worst of each section, worst first.
std::vector<CarryPlace> worst_of_each(const std::vector<Found>& found, const CarryOptions& options, bool large) {
  std::map<std::uint32_t, CarryPlace> by_section;
  for (const Found& f : found) {
    if (f.place.demand <= options.limit || (f.place.held_mm2 >= options.least_held_mm2) != large) continue;
    const auto [at, is_new] = by_section.try_emplace(f.section, f.place);
    if (!is_new && f.place.demand > at->second.demand) at->second = f.place;
  }
  std::vector<CarryPlace> places;
  for (const auto& [section, place] : by_section) places.push_back(place);
  std::stable_sort(places.begin(), places.end(), [](const auto& a, const auto& b) { return a.demand > b.demand; });
  return places;
}

void keep_worst(std::optional<CarryPlace>& kept, const CarryPlace& place) {
  if (!kept || place.demand > kept->demand) kept = place;
}

/// Follows the print in time: at each moment at which something is too weak it tears, and what is left is judged from
/// there on. What that bears at most; nothing where the print is lost: what tears is not small, or ever more, or
/// something floats.
Result<std::optional<CarryPlace>> without_weak(const LoadPath& path, const CarryOptions& options, const Judged& whole,
                                               const std::stop_token& stop) {
  constexpr std::size_t kMostTorn = 16;
  const auto is_large = [&](const Found& f) { return f.place.held_mm2 >= options.least_held_mm2; };
  const auto is_weak = [&](const Found& f) { return is_large(f) && f.place.demand > options.limit; };
  std::vector<std::uint32_t> torn;
  std::optional<CarryPlace> worst;
  /// What tears first of what was found, `kept` being the numbers of its sections: its moment; none: nothing does.
  const auto tear = [&](const std::vector<Found>& found, const std::vector<std::uint32_t>* kept) {
    std::optional<std::uint32_t> moment;
    for (const Found& f : found)
      if (is_weak(f)) moment = std::min(moment.value_or(path.layers()), f.place.moment.count());
    for (const Found& f : found) {
      if (is_large(f) && !is_weak(f) && f.place.moment.count() < moment.value_or(path.layers()))
        keep_worst(worst, f.place);
      if (!is_weak(f) || f.place.moment.count() != *moment) continue;
      const std::uint32_t section = kept ? (*kept)[f.section] : f.section;
      if (std::find(torn.begin(), torn.end(), section) == torn.end()) torn.push_back(section);
    }
    return moment;
  };
  auto from = tear(whole.found, nullptr);
  if (!from) return std::optional<CarryPlace>{};
  while (from) {
    const bool is_small = std::all_of(torn.begin(), torn.end(), [&](std::uint32_t s) {
      return path.sections()[s].area_mm2 <= options.most_torn_mm2;
    });
    if (!is_small || torn.size() > kMostTorn) return std::optional<CarryPlace>{};
    std::vector<std::uint32_t> kept;
    const auto judged = judge(path.without(torn, kept), options, *from, Until::FirstWeak, stop);
    if (!judged) return tl::unexpected{judged.error()};
    for (std::size_t k = *from; k < judged->afloat.size(); ++k)
      if (judged->afloat[k] > whole.afloat[k]) return std::optional<CarryPlace>{};
    from = tear(judged->found, &kept);
  }
  return worst;
}

}  // namespace

struct CarryWatch::State {
  CarryOptions options;
  LoadPath path;
};

CarryWatch::CarryWatch(const CarryOptions& options)
    : state_{std::make_unique<State>(State{options, LoadPath{options}})} {}
CarryWatch::~CarryWatch() = default;
CarryWatch::CarryWatch(CarryWatch&&) noexcept = default;
CarryWatch& CarryWatch::operator=(CarryWatch&&) noexcept = default;

Result<void> CarryWatch::add(const LayerRuns& solid, const LayerRuns& firm, const LayerLight* light,
                             double pull_share) {
  LoadPath& path = state_->path;
  const PixelSize size = solid.size();
  if ((path.layers() > 0 && !(size == path.size())) || !(size == firm.size()))
    return fail(ErrorCode::InvalidInput, "judging loads: the layers differ in size");
  if (light && !(light->joined.size() == size && light->lit.size() == size))
    return fail(ErrorCode::InvalidInput, "judging loads: a layer and its light differ in size");
  path.add(solid, firm, light, pull_share);
  return {};
}

Result<CarryReport> CarryWatch::finish(const std::stop_token& stop) {
  const CarryOptions& options = state_->options;
  LoadPath& path = state_->path;
  path.close();
  CarryReport report;
  report.layers = path.layers();
  for (std::uint32_t p = 0; p < path.first_piece(1) && path.layers() > 0; ++p)
    report.base_mm2 += static_cast<double>(path.pieces()[p].pixels) * path.pixel_mm2();
  const auto judged = judge(path, options, 0, Until::End, stop);
  if (!judged) return tl::unexpected{judged.error()};
  for (const std::int64_t afloat : judged->afloat)
    report.afloat_mm2 = std::max(report.afloat_mm2, path.pull_mm2(afloat));
  for (const Found& f : judged->found) {
    if (f.place.held_mm2 < options.least_held_mm2)
      keep_worst(report.small, f.place);
    else
      keep_worst(f.place.check == Check::Cut     ? report.cut
                 : f.place.check == Check::Lever ? report.lever
                                                 : report.bending,
                 f.place);
  }
  report.weak = worst_of_each(judged->found, options, true);
  report.weak_small = worst_of_each(judged->found, options, false);
  const auto rest = without_weak(path, options, *judged, stop);
  if (!rest) return tl::unexpected{rest.error()};
  report.without_weak = *rest;
  state_ = std::make_unique<State>(State{options, LoadPath{options}});
  return report;
}

}  // namespace telefab::fab
