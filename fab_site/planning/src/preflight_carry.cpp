// SPDX-License-Identifier: GPL-3.0-or-later
#include "preflight_carry.hpp"

#include <fmt/format.h>

namespace telefab::fab {
namespace {

using Verdict = PreflightItem::Verdict;
constexpr double kKilo = 1000;  // kPa * mm2 = mN; kPa to MPa

/// Beyond so many times what is allowed no stress builds up: the piece tilts.
constexpr double kTilts = 100;

/// What a place bears and by which check.
std::string text_of(const CarryPlace& place, const MachineProfile& machine) {
  const double kpa = machine.pull_of_film_kpa();
  const double most = kTilts * machine.carried_demand();
  const std::string stress = place.demand > most
                                 ? fmt::format("more than {:.0f} MPa, so that the piece tilts", most * kpa / kKilo)
                                 : fmt::format("{:.2f} MPa", place.demand * kpa / kKilo);
  return fmt::format(
      "{:.2f} mm2 in layer {} at ({:.1f}, {:.1f}) mm bear {} (by {}) while layer {} is pulled with {:.1f} N from "
      "{:.0f} mm2",
      place.section_mm2, place.layer.count(), place.place.x_mm, place.place.y_mm, stress, name_of(place.check),
      place.moment.count(), place.held_mm2 * kpa / kKilo, place.held_mm2);
}

}  // namespace

PreflightItem carry_of(const MachineProfile& machine, const PlanSummary& summary) {
  const CarryReport& carry = summary.carry;
  const double most = machine.carried_demand();
  const double allowed_mpa = most * machine.pull_of_film_kpa() / kKilo;
  const std::string limit = fmt::format("allowed are {:.2f} MPa, that is {:.0f} times the pull of {} kPa", allowed_mpa,
                                        most, machine.pull_of_film_kpa());
  PreflightItem item{"carry", Verdict::Passed, {}, {}, "times the pull", {}, {}};
  const auto show = [&](const CarryPlace& place) {
    item.value = place.demand;
    item.layer = place.layer;
    item.place = place.place;
    item.text = text_of(place, machine);
  };
  const CarryPlace* worst = carry.worst();
  if (worst) show(*worst);
  if (worst && worst->demand > most && carry.without_weak) {
    item.verdict = Verdict::Warning;
    item.text += fmt::format(
        "; {}; {} too weak and may tear: the print is made all the same, and what is left bears {:.2f} MPa at most",
        limit, carry.weak.size() == 1 ? "this place is" : fmt::format("{} places are", carry.weak.size()),
        carry.without_weak->demand * machine.pull_of_film_kpa() / kKilo);
  } else if (worst && worst->demand > most) {
    item.verdict = Verdict::Held;
    item.text += fmt::format(
        "; {}; {} too weak and may tear, and more or wider pins were not found to help. Turn or hollow the part, or "
        "give "
        "anchors there by hand{}",
        limit, carry.weak.size() == 1 ? "this place is" : fmt::format("{} places are", carry.weak.size()),
        machine.states_what_carries() ? ""
                                      : "; pull and strength are assumed: state motion.pull_kpa and "
                                        "resin.green_strength_mpa where they are known");
  } else if (carry.afloat_mm2 > 0) {
    item.verdict = Verdict::NotKnown;
    item.text = fmt::format(
        "up to {:.2f} mm2 of a layer hang on nothing that stands on the platform, and what they will bear was not "
        "judged{}{}",
        carry.afloat_mm2, worst ? "; of the rest " : "", item.text);
  } else if (!carry.weak_small.empty()) {
    const CarryPlace& first = carry.weak_small.front();
    item.verdict = Verdict::Warning;
    show(first);
    item.text +=
        fmt::format("; {}; {} such places hold little each. They may tear off", limit, carry.weak_small.size());
  } else if (const std::uint32_t pins = summary.figures.may_buckle; pins > 0) {
    item.verdict = Verdict::Warning;
    item.text = fmt::format("{} of the pins stand free for so long that they may buckle; at most: {}; {}", pins,
                            worst ? item.text : "nothing is pulled", limit);
  } else if (worst) {
    item.text = fmt::format("at most: {}; {}", item.text, limit);
  } else {
    item.text = "nothing is pulled";
  }
  return item;
}

}  // namespace telefab::fab
