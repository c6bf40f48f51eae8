// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <telefab/fab/cure/support_calibration.hpp>

namespace telefab::fab {
namespace {

using Kind = SupportSpecimen::Kind;

constexpr double kStep = 0.02;  ///< of ln r and ln kappa
constexpr std::array<double, 16> kScatters{0.03, 0.04, 0.05, 0.065, 0.08, 0.1, 0.125, 0.15,
                                           0.18, 0.22, 0.27, 0.33,  0.4,  0.5, 0.65,  0.8};
constexpr double kBeyond = 4;  ///< r is looked for up to so many times beyond what was read
constexpr double kLeastShare = 0.02, kMostShare = 20;
/// Half the square of Student's t for 95 % at 10 degrees of freedom: few discs stand near the threshold. Chi square
/// (1.92) held the truth in 87 of 100 prints with a scatter of 25 %.
constexpr double kRatio95 = 2.4822;
constexpr std::size_t kLeastDiscs = 4;

struct Trial {
  double log_demand = 0;
  bool held = false;
};

/// ln of the probability of all trials where the threshold is at `log_threshold`.
double log_likelihood(std::span<const Trial> trials, double log_threshold, double scatter) {
  constexpr double kLeast = 1e-300;
  double sum = 0;
  for (const Trial& t : trials) {
    const double off = (t.log_demand - log_threshold) / scatter / std::numbers::sqrt2;
    sum += std::log(std::max(kLeast, 0.5 * std::erfc(t.held ? off : -off)));
  }
  return sum;
}

/// One row a threshold, one column a scatter.
class Likelihoods {
 public:
  Likelihoods(std::span<const Trial> trials, double first_log, std::size_t count)
      : first_log_{first_log}, rows_(count) {
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t s = 0; s < kScatters.size(); ++s) rows_[i][s] = log_likelihood(trials, log_at(i), kScatters[s]);
  }
  [[nodiscard]] double log_at(std::size_t i) const { return first_log_ + kStep * static_cast<double>(i); }
  [[nodiscard]] std::size_t size() const { return rows_.size(); }
  [[nodiscard]] const std::array<double, kScatters.size()>& operator[](std::size_t i) const { return rows_[i]; }

 private:
  double first_log_;
  std::vector<std::array<double, kScatters.size()>> rows_;
};

/// Where a profile of likelihood is highest, and where it stays within the ratio; places in steps.
struct Peak {
  double at = 0;  ///< the middle of a level top
  std::size_t least = 0, most = 0;
  double height = 0;
};

Peak peak_of(std::span<const double> profile) {
  constexpr double kLevel = 1e-6;
  Peak peak;
  peak.height = *std::max_element(profile.begin(), profile.end());
  const auto first_above = [&](double level) {
    return static_cast<std::size_t>(std::find_if(profile.begin(), profile.end(), [&](double p) { return p >= level; }) -
                                    profile.begin());
  };
  const auto last_above = [&](double level) {
    return profile.size() - 1 -
           static_cast<std::size_t>(
               std::find_if(profile.rbegin(), profile.rend(), [&](double p) { return p >= level; }) - profile.rbegin());
  };
  peak.at = static_cast<double>(first_above(peak.height - kLevel) + last_above(peak.height - kLevel)) / 2;
  peak.least = first_above(peak.height - kRatio95);
  peak.most = last_above(peak.height - kRatio95);
  return peak;
}

KnownEnds ends_of(const Peak& peak, std::size_t size) {
  if (peak.most + 1 >= size) return KnownEnds::Least;
  return peak.least == 0 ? KnownEnds::Most : KnownEnds::Both;
}

/// The middle of what held must be below the middle of what tore.
bool is_reversed(std::span<const Trial> trials) {
  double held = 0, torn = 0;
  int n_held = 0, n_torn = 0;
  for (const Trial& t : trials)
    if (t.held)
      held += t.log_demand, ++n_held;
    else
      torn += t.log_demand, ++n_torn;
  return n_held > 0 && n_torn > 0 && held / n_held >= torn / n_torn;
}

/// Trials of a kind; shelves by 3 (l / t)^2.
std::vector<Trial> trials_of(std::span<const SupportReading> readings, Kind kind, double thickness_mm) {
  std::vector<Trial> out;
  for (const SupportReading& r : readings) {
    if (r.specimen.kind != kind) continue;
    const double reach = r.specimen.overhang_mm / thickness_mm;
    out.push_back({std::log(kind == Kind::Shelf ? 3 * reach * reach : r.specimen.demand), r.held});
  }
  return out;
}

Result<void> check(std::span<const Trial> discs, std::span<const Trial> shelves) {
  const auto refuse = [](std::string what) { return fail(ErrorCode::InvalidInput, std::move(what)); };
  if (discs.size() < kLeastDiscs)
    return refuse(fmt::format("ladder: {} discs were read; at least {} are needed", discs.size(), kLeastDiscs));
  if (std::none_of(discs.begin(), discs.end(), [](const Trial& t) { return t.held; }))
    return refuse(
        "ladder: no disc held, so not even the widest necks carry here. Look at exposure, resin and film, and print it "
        "again");
  if (is_reversed(discs))
    return refuse(
        "ladder: discs of higher demand held where discs of lower tore. Look whether the numbers were read from the "
        "right side of the map");
  if (is_reversed(shelves))
    return refuse(
        "shelf: longer shelves are whole where shorter are not. Look whether the numbers were read from the right side "
        "of the map");
  return {};
}

/// For each ln kappa the best of all thresholds and scatters: a shelf tears at r kappa.
std::vector<double> profile_of_share(const Likelihoods& discs, const Likelihoods& shelves, std::size_t shares) {
  std::vector<double> profile(shares, -std::numeric_limits<double>::infinity());
  for (std::size_t k = 0; k < shares; ++k)
    for (std::size_t i = 0; i < discs.size(); ++i)
      for (std::size_t s = 0; s < kScatters.size(); ++s)
        profile[k] = std::max(profile[k], discs[i][s] + shelves[i + k][s]);
  return profile;
}

void fit_share(SupportCalibration& out, std::span<const Trial> shelves, const Likelihoods& discs) {
  if (shelves.empty()) return;
  double shortest_torn = std::numeric_limits<double>::infinity(), shortest = shortest_torn;
  for (const Trial& t : shelves) {
    shortest = std::min(shortest, t.log_demand);
    if (!t.held) shortest_torn = std::min(shortest_torn, t.log_demand);
  }
  double longest_whole = -std::numeric_limits<double>::infinity();
  for (const Trial& t : shelves)
    if (t.held && t.log_demand < shortest_torn) longest_whole = std::max(longest_whole, t.log_demand);
  if (!std::isfinite(longest_whole)) {
    out.overhang_share_below = std::exp(shortest) / out.demand.value;
    return;
  }
  const double first = std::log(kLeastShare);
  const auto shares = static_cast<std::size_t>(std::log(kMostShare / kLeastShare) / kStep) + 1;
  const Likelihoods products{shelves, discs.log_at(0) + first, discs.size() + shares};
  const Peak peak = peak_of(profile_of_share(discs, products, shares));
  const auto share_at = [&](double step) { return std::exp(first + kStep * step); };
  const double value = std::exp(longest_whole) / out.demand.value;
  // Ends of the interval lie a step outward: likelihood was looked at every step.
  out.overhang_share = FittedFigure{value, std::min(value, share_at(static_cast<double>(peak.least) - 1)),
                                    std::max(value, share_at(static_cast<double>(peak.most) + 1))};
  out.overhang_ends = ends_of(peak, shares);
}

std::string interval_of(const FittedFigure& f, KnownEnds ends) {
  switch (ends) {
    case KnownEnds::Least:
      return fmt::format("a lower bound: 95 %: at least {:.3g}; nothing tore that bounds it from above", f.least);
    case KnownEnds::Most:
      return fmt::format("an upper bound: 95 %: at most {:.3g}; nothing held that bounds it from below", f.most);
    case KnownEnds::Both:
      break;
  }
  return fmt::format("95 %: {:.3g} to {:.3g}", f.least, f.most);
}

/// Strength at which this machine's pull tears at the demand.
double strength_mpa(const MachineProfile& machine, double demand) {
  constexpr double kKilo = 1000;
  return demand * machine.pull_of_film_kpa() / (kKilo * machine.supports.fresh_share);
}

/// Whether the lever rule, by which a disc off centre asks for its demand, agrees with what the ladder tells.
std::string off_centre_text(const SupportCalibration& c) {
  std::string text;
  for (const SupportReading& r : c.off_centre) {
    const double demand = r.specimen.demand;
    std::string verdict = "as r says or leaves open";
    if (r.held && demand > c.demand.most && c.demand_ends != KnownEnds::Least)
      verdict = "so it bears more there than the lever rule says";
    if (!r.held && demand < c.demand.least && c.demand_ends != KnownEnds::Most)
      verdict = "so it bears less there than the lever rule says: plan with a larger supports.safety";
    text += fmt::format("# Off centre by {:.2f} of the radius, number {}: demand {:.0f} by the lever, {}, {}.\n",
                        r.specimen.offset_share, r.specimen.number, demand, r.held ? "held" : "tore", verdict);
  }
  return text;
}

}  // namespace

Result<SupportCalibration> fit_supports(std::span<const SupportReading> readings, double thickness_mm) {
  if (!(thickness_mm > 0)) return fail(ErrorCode::InvalidInput, "the thickness of a layer must be above 0 mm");
  const auto discs = trials_of(readings, Kind::Ladder, thickness_mm);
  const auto shelves = trials_of(readings, Kind::Shelf, thickness_mm);
  if (auto ok = check(discs, shelves); !ok) return tl::unexpected{ok.error()};
  const auto [lowest, highest] = std::minmax_element(
      discs.begin(), discs.end(), [](const Trial& a, const Trial& b) { return a.log_demand < b.log_demand; });
  const double first = lowest->log_demand - std::log(kBeyond);
  const auto count = static_cast<std::size_t>((highest->log_demand + std::log(kBeyond) - first) / kStep) + 1;
  const Likelihoods likelihoods{discs, first, count};
  std::vector<double> profile(count);
  for (std::size_t i = 0; i < count; ++i) profile[i] = *std::max_element(likelihoods[i].begin(), likelihoods[i].end());
  const Peak peak = peak_of(profile);
  SupportCalibration out;
  out.discs = discs.size();
  out.shelves = shelves.size();
  const auto demand_at = [&](double step) { return std::exp(first + kStep * step); };
  out.demand = {demand_at(peak.at), demand_at(static_cast<double>(peak.least) - 1),
                demand_at(static_cast<double>(peak.most) + 1)};
  out.demand_ends = ends_of(peak, count);
  // Where all held, any threshold above is as likely: what is known is that the largest held.
  if (std::all_of(discs.begin(), discs.end(), [](const Trial& t) { return t.held; }))
    out.demand.value = std::max(out.demand.least, std::exp(highest->log_demand));
  const auto& best = likelihoods[static_cast<std::size_t>(peak.at)];
  out.scatter = kScatters[static_cast<std::size_t>(std::max_element(best.begin(), best.end()) - best.begin())];
  fit_share(out, shelves, likelihoods);
  for (const SupportReading& r : readings)
    if (r.specimen.kind == Kind::OffCentre) out.off_centre.push_back(r);
  return out;
}

MachineProfile with_supports(MachineProfile machine, const SupportCalibration& c) {
  machine.motion.pull_kpa = machine.pull_of_film_kpa();
  machine.resin.green_strength_mpa = strength_mpa(machine, c.demand.value);
  if (c.overhang_share) machine.supports.overhang_share = c.overhang_share->value;
  std::erase_if(machine.assumed, [&](const std::string& key) {
    return key == "motion.pull_kpa" || key == "resin.green_strength_mpa" ||
           (key == "supports.overhang_share" && c.overhang_share);
  });
  return machine;
}

std::string to_toml_fragment(const SupportCalibration& c, const MachineProfile& machine) {
  const MachineProfile after = with_supports(machine, c);
  std::string text = fmt::format(
      "# {} discs of the ladder, {} shelves. Discs tear at r = {:.3g} times the pull of the film ({}), with a scatter "
      "of "
      "{:.0f} %.\n"
      "# A print tells strength over pull, not the two apart: the pull is {} kPa, {}, and the strength is what it "
      "takes "
      "for r.\n"
      "# With supports.fresh_share = {:g} and supports.safety = {:g} a plan may ask for {:.3g} times the pull.\n"
      "# Both keys belong together: take them off the list `assumed` together, and change neither alone.\n",
      c.discs, c.shelves, c.demand.value, interval_of(c.demand, c.demand_ends), 100 * c.scatter,
      machine.pull_of_film_kpa(),
      machine.motion.pull_kpa > 0 && !machine.is_assumed("motion.pull_kpa") ? "as the profile states"
                                                                            : "which is assumed",
      machine.supports.fresh_share, machine.supports.safety, after.carried_demand());
  text += off_centre_text(c);
  const auto strength = [&](double demand) { return strength_mpa(machine, demand); };
  const FittedFigure mpa{strength(c.demand.value), strength(c.demand.least), strength(c.demand.most)};
  text += fmt::format("[resin]\ngreen_strength_mpa = {:.4g}  # {}\n[motion]\npull_kpa = {:.6g}\n", mpa.value,
                      interval_of(mpa, c.demand_ends), after.motion.pull_kpa);
  if (c.overhang_share)
    text += fmt::format("[supports]\noverhang_share = {:.4g}  # {}\n", c.overhang_share->value,
                        interval_of(*c.overhang_share, c.overhang_ends));
  else if (c.overhang_share_below)
    text += fmt::format("# No shelf is whole: supports.overhang_share is below {:.3g}, and no key is given.\n",
                        *c.overhang_share_below);
  else
    text += "# No shelf was read: nothing is known of supports.overhang_share.\n";
  if (c.overhang_share && machine.supports.self_support_mm > 0)
    text += fmt::format(
        "# supports.self_support_mm = {:g} of the profile goes before overhang_share; 0 lets the reach follow from "
        "it.\n",
        machine.supports.self_support_mm);
  return text;
}

}  // namespace telefab::fab
