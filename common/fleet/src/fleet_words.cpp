// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/fleet/fleet_words.hpp>

#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>

namespace telefab::fleet {
namespace {

constexpr std::array<std::string_view, 4> kReadinessNames{"free", "busy", "occupied", "trouble"};
constexpr std::array<std::string_view, 14> kWhyNotNames{
    "fits",        "ended",     "has-machine",    "other-machine",           "other-light",
    "other-resin", "too-large", "coarser-pixel",  "calibrated-too-long-ago", "draining",
    "not-seen",    "not-free",  "later-in-order", "goes-elsewhere"};

}  // namespace

std::string_view name_of(Readiness readiness) { return kReadinessNames.at(static_cast<std::size_t>(readiness) - 1); }
std::string_view name_of(WhyNot why) { return kWhyNotNames.at(static_cast<std::size_t>(why)); }

std::string sentence_of(WhyNot why, const Job& job, const Machine& machine, std::int64_t now_unix_ms) {
  const Needs& needs = job.needs;
  switch (why) {
    case WhyNot::Fits:
      return "nothing is against it";
    case WhyNot::Ended:
      return fmt::format("the job is {}", name_of(job.state));
    case WhyNot::HasMachine:
      return fmt::format("{} has it", job.machine);
    case WhyNot::OtherMachine:
      return fmt::format("it asks for {}", needs.machine);
    case WhyNot::OtherLight:
      return fmt::format("it was cut for other light than that of {}", machine.profile);
    case WhyNot::OtherResin:
      return fmt::format("{} is loaded, not {}", machine.resin, needs.resin);
    case WhyNot::TooLarge:
      return fmt::format("the part is {:.4g} x {:.4g} x {:.4g} mm, the machine holds {:.4g} x {:.4g} x {:.4g} mm",
                         needs.width_mm, needs.depth_mm, needs.height_mm, machine.width_mm, machine.depth_mm,
                         machine.height_mm);
    case WhyNot::CoarserPixel:
      return fmt::format("its pixel is {:.4g} mm, at most {:.4g} mm are asked for", machine.pixel_mm, needs.pixel_mm);
    case WhyNot::CalibratedTooLongAgo:
      return machine.calibrated_unix_ms == 0 ? std::string{"it was never calibrated"}
                                             : fmt::format("it was calibrated {} h ago, at most {} h are asked for",
                                                           (now_unix_ms - machine.calibrated_unix_ms) / 3'600'000,
                                                           needs.calibrated_within_ms / 3'600'000);
    case WhyNot::Draining:
      return "it is taken out of service";
    case WhyNot::NotSeen:
      return fmt::format("its fab was not heard of for {} s", (now_unix_ms - machine.seen_unix_ms) / 1000);
    case WhyNot::NotFree:
      return fmt::format("it is {}",
                         machine.readiness == Readiness::Trouble ? "in trouble" : name_of(machine.readiness));
    case WhyNot::LaterInOrder:
      return "another job comes before it";
    case WhyNot::GoesElsewhere:
      return "another machine takes it";
  }
  return {};
}

std::string to_json(const Job& job) {
  const nlohmann::ordered_json value{{"id", job.id},
                                     {"name", job.name},
                                     {"owner", job.owner},
                                     {"site", job.site},
                                     {"asks_for", job.needs.machine},
                                     {"resin", job.needs.resin},
                                     {"size_mm", {job.needs.width_mm, job.needs.depth_mm, job.needs.height_mm}},
                                     {"priority", job.priority},
                                     {"deadline_unix_ms", job.deadline_unix_ms},
                                     {"state", name_of(job.state)},
                                     {"attempt", job.attempt},
                                     {"machine", job.machine},
                                     {"message", job.message}};
  return json_text(value);
}

std::string to_json(const Machine& machine) {
  const nlohmann::ordered_json value{{"name", machine.name},
                                     {"fab", machine.fab},
                                     {"profile", machine.profile},
                                     {"resin", machine.resin},
                                     {"size_mm", {machine.width_mm, machine.depth_mm, machine.height_mm}},
                                     {"pixel_mm", machine.pixel_mm},
                                     {"calibrated_unix_ms", machine.calibrated_unix_ms},
                                     {"readiness", name_of(machine.readiness)},
                                     {"draining", machine.is_draining},
                                     {"seen_unix_ms", machine.seen_unix_ms}};
  return json_text(value);
}

}  // namespace telefab::fleet
