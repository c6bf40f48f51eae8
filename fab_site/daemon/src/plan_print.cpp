// SPDX-License-Identifier: GPL-3.0-or-later
#include "plan_print.hpp"

#include <fmt/format.h>

#include <algorithm>

#include <telefab/base/file.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/base/signature.hpp>
#include <telefab/base/version.hpp>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/fab/print/admission.hpp>
#include <telefab/fab/print/print_record.hpp>
#include <telefab/fab/print/provenance.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/store/audit_log.hpp>

namespace telefab::fab {

Result<PlanOutcome> plan_into(const std::filesystem::path& folder, const ReceivedStack& part,
                              const MachineProfile& machine, PlanOptions options, const Clock& clock,
                              const ProgressSink& progress, std::stop_token stop) {
  if (const auto offer = saved_offer(folder)) options.registration_rms_mm = offer->registration_rms_mm;
  const auto summary =
      write_plan_folder(folder / "plan", part.layers, machine, options, clock, progress, std::move(stop), part.tfc());
  if (!summary) return tl::unexpected{summary.error()};
  return PlanOutcome{static_cast<std::uint32_t>(summary->plan.layers.size()),
                     preflight_of(part.layers, machine, *summary)};
}

namespace {

/// A clock whose waits are counted.
class BeatingClock final : public Clock {
 public:
  BeatingClock(Clock& inner, std::atomic<std::uint64_t>& beats) : inner_{inner}, beats_{beats} {}
  Nanoseconds now() const override { return inner_.now(); }
  Nanoseconds wall() const override { return inner_.wall(); }
  void sleep_for(Nanoseconds duration) override {
    ++beats_;
    inner_.sleep_for(duration);
  }

 private:
  Clock& inner_;
  std::atomic<std::uint64_t>& beats_;
};

constexpr std::uint64_t kLargestPlanFile = 1U << 30U;

/// Where the part comes from: what the scan site said and signed, what was received, what was planned.
std::map<std::string, std::string> provenance_of(const std::filesystem::path& folder) {
  std::map<std::string, std::string> known{{provenance::kSoftware, fmt::format("telefab-fab {}", kVersion)}};
  if (const auto offer = saved_offer(folder)) {
    known[provenance::kScanName] = offer->header.scan_name;
    if (offer->scan != Digest{}) known[provenance::kScan] = to_hex(offer->scan);
    if (offer->registration_rms_mm > 0)
      known[provenance::kRegistration] = fmt::format("{:.6g}", offer->registration_rms_mm);
    known[provenance::kProfile] = to_hex(offer->profile);
    known[provenance::kParameters] = offer->parameters;
    known[provenance::kTransform] = fmt::format("{}", fmt::join(offer->header.scan_to_build, " "));
    std::string key;
    for (const std::byte b : offer->public_key) key += fmt::format("{:02x}", std::to_integer<unsigned>(b));
    if (!key.empty()) known[provenance::kSignedBy] = key;
  }
  if (const auto spool = ChunkSpool::open(folder / "chunks"); spool && spool->finished())
    known[provenance::kContours] = to_hex(*spool->finished());
  if (const auto supports = read_file(folder / "plan" / "supports.json", kLargestPlanFile))
    known[provenance::kSupports] = to_hex(digest_of(*supports));
  if (const auto part = read_file(folder / "plan" / "part.tfc", kLargestPlanFile))
    known[provenance::kPart] = to_hex(digest_of(*part));
  return known;
}

/// The key that as-built records are signed with, as-built-key.pem beside the jobs; made with its public half,
/// as-built-key.pub, for the first record.
Result<std::string> as_built_key(const std::filesystem::path& site) {
  return kept_ed25519_key(site / "as-built-key.pem", site / "as-built-key.pub");
}

/// The record sealed and signed, in report/as-built.json, with the head of the site's audit log in it.
Result<void> keep_as_built(const std::filesystem::path& folder, PrintRecord record) {
  const auto site = folder.parent_path().parent_path();
  const auto key = as_built_key(site);
  if (!key) return tl::unexpected{key.error()};
  if (const auto head = audit_head(site / "audit.log")) {
    record.provenance[provenance::kAuditEntries] = std::to_string(head->entries);
    record.provenance[provenance::kAuditHead] = to_hex(head->line);
  } else if (head.error().code != ErrorCode::NotFound) {
    record.provenance[provenance::kAuditHead] = "unreadable";  // a print that is over has its record all the same
  }
  const auto sealed = seal(record, *key);
  if (!sealed) return tl::unexpected{sealed.error()};
  return write_file_atomically(folder / "report" / "as-built.json", *sealed);
}

/// Both records of a print that has ended, or faulted.
Result<void> keep_records(const std::filesystem::path& folder, const PrintRecord& record) {
  if (auto made = make_folder(folder / "report"); !made) return made;
  if (auto kept = write_file_atomically(folder / "report" / "print.json", to_json(record) + "\n"); !kept) return kept;
  return keep_as_built(folder, record);
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

}  // namespace

std::uint64_t print_room_bytes(const std::filesystem::path& folder, LayerIndex layers) {
  constexpr std::uint64_t kRecordedLayer_bytes =
      2048;  // a layer's rows in print.json and as-built.json are below 1,200
  std::error_code error;
  const bool has_journal = std::filesystem::exists(folder / "journal", error);
  return layers.count() * kRecordedLayer_bytes + (has_journal ? 0 : PrintJournal::room_bytes(layers));
}

Result<void> go_dark(const MachineProfile& machine) {
  const auto clock = make_clock(machine);
  return darken(machine, *clock);
}

Result<PrintRecord> print_from(const PrintTask& task, PrintControl& control, const PrintSink& sink,
                               std::atomic<std::uint64_t>& beats, std::stop_token stop) {
  const auto& [folder, machine, instance, policy] = task;
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
  PrintPolicy scaled = policy;
  // A machine that runs faster than real time is looked at less often in its own time.
  if (is_simulated(machine))
    scaled.slice =
        Nanoseconds{static_cast<std::int64_t>(static_cast<double>(policy.slice.count()) * machine.devices.speed_up)};
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
  PrintRunner runner{*devices->projector, *devices->stage, **job, *journal, beating, devices->sensors.get()};
  auto record = runner.run((*job)->plan(), scaled, control, sink, std::move(stop));
  if (!record) return record;
  record->provenance = provenance_of(folder);
  record->provenance[provenance::kInstance] = instance;
  // Why a print faulted is the news; its record is written again once it has ended.
  if (auto kept = keep_records(folder, *record); !kept && record->outcome != PrintOutcome::Faulted)
    return tl::unexpected{kept.error()};
  return record;
}

}  // namespace telefab::fab
