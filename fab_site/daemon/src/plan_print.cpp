// SPDX-License-Identifier: GPL-3.0-or-later
#include "plan_print.hpp"

#include <fmt/format.h>

#include <algorithm>

#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/formats/whole_print_file.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/fab/print/admission.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/saved_message.hpp>

#include "beating_clock.hpp"
#include "print_records.hpp"

namespace telefab::fab {

Result<PlanOutcome> plan_into(const std::filesystem::path& folder, const ReceivedStack& part,
                              const MachineProfile& machine, PlanOptions options, const Clock& clock,
                              const ProgressSink& progress, std::stop_token stop) {
  if (const auto offer = saved_offer(folder)) options.registration_rms_mm = offer->registration_rms_mm;
  const auto summary =
      write_plan_folder(folder / "plan", part.layers, machine, options, clock, progress, std::move(stop), part.tfc());
  if (!summary) return tl::unexpected{summary.error()};
  // What its printer would refuse is known now, not when it is its turn.
  if (light_of(machine) == LightOf::WholePrinter)
    if (auto ok = check_whole_print(summary->plan, machine); !ok) return tl::unexpected{ok.error()};
  return PlanOutcome{static_cast<std::uint32_t>(summary->plan.layers.size()),
                     preflight_of(part.layers, machine, *summary)};
}

/// A held job is printed on the word of somebody who knew what holds it, and on no other.
Result<void> check_let_through(const std::filesystem::path& folder, const PrintJournal& journal) {
  const auto preflight = preflight_in(folder / "plan");
  if (!preflight) return tl::unexpected{preflight.error()};
  const auto orders = journal.orders();
  const bool is_known = std::any_of(orders.begin(), orders.end(), [](const OrderRecord& o) {
    return o.word == name_of(JournalStep::Approved) && !o.why.empty();
  });
  if (preflight->holds() && !is_known)
    return fail(ErrorCode::Conflict,
                fmt::format("the job is held: {}; nobody has let it through", preflight->why_held()));
  return {};
}

std::uint64_t print_room_bytes(const std::filesystem::path& folder, LayerIndex layers, LightOf light) {
  constexpr std::uint64_t kFilePerMaskByte = 2;  // 0.8 and 1.0 measured of two statues
  constexpr std::uint64_t kRecordedLayer_bytes =
      2048;  // a layer's rows in print.json and as-built.json are below 1,200
  std::error_code error;
  const bool has_journal = std::filesystem::exists(folder / "journal", error);
  const bool has_file = light == LightOf::Fab || std::filesystem::exists(printer_file_path(folder), error);
  return layers.count() * kRecordedLayer_bytes + (has_journal ? 0 : PrintJournal::room_bytes(layers)) +
         (has_file ? 0 : kFilePerMaskByte * bytes_in(folder / "plan" / "masks"));
}

Result<void> go_dark(const MachineProfile& machine) {
  const auto clock = make_clock(machine);
  return darken(machine, *clock);
}

Result<PrintRecord> print_from(const PrintTask& task, PrintControl& control, const PrintSink& sink,
                               std::atomic<std::uint64_t>& beats, std::stop_token stop) {
  const auto& folder = task.folder;
  // It can be put back, and a part may hang there: no reason to give the print up.
  if (!task.profile) return fail(ErrorCode::Conflict, task.profile.error().what);
  const MachineProfile& machine = *task.profile;
  const auto job = PlannedJob::open(folder / "plan");
  if (!job) return tl::unexpected{job.error()};
  if (const auto fits = (*job)->plan().fits(machine); !fits) return tl::unexpected{fits.error()};
  const auto clock = make_clock(machine);
  auto devices = make_devices(machine, *clock);
  if (!devices) return tl::unexpected{devices.error()};
  auto file = open_journal_file(folder / "journal");
  if (!file) return tl::unexpected{file.error()};
  auto journal = PrintJournal::open(std::move(*file));
  if (!journal) return tl::unexpected{journal.error()};
  if (auto may = check_let_through(folder, *journal); !may) return tl::unexpected{may.error()};
  PrintPolicy scaled = task.policy;
  // A machine that runs faster than real time is looked at less often in its own time.
  if (is_simulated(machine))
    scaled.slice = Nanoseconds{
        static_cast<std::int64_t>(static_cast<double>(task.policy.slice.count()) * machine.devices.speed_up)};
  if (is_simulated(machine))
    scaled.longest_leave = Nanoseconds{
        static_cast<std::int64_t>(static_cast<double>(task.policy.longest_leave.count()) * machine.devices.speed_up)};
  if (!is_simulated(machine) && journal->empty()) {
    // A job that cannot keep its plan on this projector is refused now, not slowed down unsaid.
    const auto cost = estimate_print((*job)->plan(), {}, **job, *devices->projector, *devices->stage, {}, stop);
    if (!cost) return tl::unexpected{cost.error()};
    if (const auto ok = admit(*cost, machine.devices.allowed_slowdown); !ok) return tl::unexpected{ok.error()};
  }
  // Room for the whole journal and for words of operators, so that a disk that fills ends no print and loses no word.
  if (const auto room = journal->reserve(LayerIndex{static_cast<std::uint32_t>((*job)->plan().layers.size())}); !room)
    return tl::unexpected{room.error()};
  BeatingClock beating{*clock, beats};
  if (machine.devices.hottest_celsius > 0) scaled.hottest_celsius = machine.devices.hottest_celsius;
  if (machine.devices.coldest_celsius > 0) scaled.coldest_celsius = machine.devices.coldest_celsius;
  PrintRunner runner{*devices->projector,    *devices->stage, **job, *journal, beating,
                     devices->sensors.get(), task.fence.get()};
  auto record = runner.run((*job)->plan(), scaled, control, sink, std::move(stop));
  if (!record) return record;
  record->provenance = provenance_of(folder, task.instance);
  // Why a print faulted is the news; its record is written again once it has ended.
  if (auto kept = keep_records(folder, *record); !kept && record->outcome != PrintOutcome::Faulted)
    return tl::unexpected{kept.error()};
  return record;
}

}  // namespace telefab::fab
