// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <array>
#include <limits>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/print/lease_book.hpp>

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kFormat = "telefab-fleet-hold-1";
constexpr std::string_view kSuffix = ".json";
constexpr std::uint64_t kMostBytes = 1U << 20U;
constexpr std::uint32_t kUnknown = std::numeric_limits<std::uint32_t>::max();
constexpr std::array<std::string_view, 5> kEnds{"none", "done", "failed", "cancelled", "released"};

std::string text_of(const FleetHold& hold) {
  Json ids = Json::object();
  for (const auto& [id, attempt] : hold.ids) ids[id] = attempt;
  return json_text({{"format", kFormat},
                    {"job", hold.job},
                    {"attempt", hold.attempt},
                    {"machine", hold.machine},
                    {"site", hold.site},
                    {"ids", std::move(ids)},
                    {"bound", hold.is_bound},
                    {"end", name_of(hold.end)},
                    {"reported", hold.is_reported}}) +
         "\n";
}

std::optional<FleetHold> hold_from(std::string_view text) {
  try {
    const Json json = parsed_json(text);
    if (json.at("format") != kFormat) return std::nullopt;
    FleetHold hold;
    hold.job = json.at("job").get<std::string>();
    hold.attempt = whole_number<std::uint32_t>(json.at("attempt"));
    hold.machine = json.at("machine").get<std::string>();
    hold.site = json.at("site").get<std::string>();
    for (const auto& [id, attempt] : json.at("ids").items()) hold.ids[id] = whole_number<std::uint32_t>(attempt);
    hold.is_bound = json.at("bound").get<bool>();
    const auto end = std::find(kEnds.begin(), kEnds.end(), json.at("end").get<std::string>());
    if (end == kEnds.end()) return std::nullopt;
    hold.end = static_cast<HoldEnd>(end - kEnds.begin());
    hold.is_reported = json.at("reported").get<bool>();
    return hold;
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

/// What stands for a job of which nobody can say how far it came.
FleetHold unknown_hold(const std::string& job) {
  FleetHold hold;
  hold.job = job;
  hold.attempt = kUnknown;
  hold.ids[job] = 1;
  return hold;
}

}  // namespace

std::string_view name_of(HoldEnd end) { return kEnds.at(static_cast<std::size_t>(end)); }

/// Asks the book at every question, so that what is known this moment counts.
class LeaseBook::Fence final : public LightFence {
 public:
  Fence(LeaseBook& book, std::string id, std::uint32_t attempt) : book_{book}, id_{std::move(id)}, attempt_{attempt} {}
  std::uint32_t attempt() const override { return attempt_; }
  Leave leave(LayerIndex) override { return book_.ask(id_); }

 private:
  LeaseBook& book_;
  std::string id_;
  std::uint32_t attempt_;
};

Result<std::unique_ptr<LeaseBook>> LeaseBook::open(std::filesystem::path folder, const Clock& clock) {
  std::unique_ptr<LeaseBook> book{new LeaseBook{std::move(folder), clock}};
  std::error_code error;
  if (!std::filesystem::exists(book->folder_, error) && !error) return book;
  for (const auto& entry : std::filesystem::directory_iterator{book->folder_, error}) {
    if (entry.path().extension() != kSuffix) continue;
    const auto bytes = read_file(entry.path(), kMostBytes);
    auto hold = bytes ? hold_from({reinterpret_cast<const char*>(bytes->data()), bytes->size()}) : std::nullopt;
    if (!hold) {
      book->unreadable_.push_back(fmt::format(
          "{} cannot be read{}: nothing of that job of the fleet is lit here; take the file away once its part is done "
          "or given up",
          entry.path().string(), bytes ? "" : " (" + bytes.error().what + ")"));
      hold = unknown_hold(entry.path().stem().string());
    }
    book->keep(std::move(*hold));
  }
  if (error)
    return fail(ErrorCode::StorageFailed, fmt::format("cannot read {}: {}", book->folder_.string(), error.message()));
  return book;
}

const FleetHold* LeaseBook::newest(std::string_view fleet_job) const {
  const auto found = holds_.find(fleet_job);
  return found == holds_.end() ? nullptr : &found->second;
}

std::optional<FleetHold> LeaseBook::find(std::string_view fleet_job) const {
  const std::lock_guard lock{mutex_};
  const FleetHold* const hold = newest(fleet_job);
  return hold == nullptr ? std::nullopt : std::optional{*hold};
}

std::optional<LeaseBook::Own> LeaseBook::own_locked(std::string_view id) const {
  const auto job = jobs_.find(id);
  const FleetHold* const hold = job == jobs_.end() ? nullptr : newest(job->second);
  if (hold == nullptr) return std::nullopt;
  return Own{*hold, hold->ids.at(std::string{id})};
}

std::optional<LeaseBook::Own> LeaseBook::own(std::string_view id) const {
  const std::lock_guard lock{mutex_};
  return own_locked(id);
}

std::vector<FleetHold> LeaseBook::unreported() const {
  const std::lock_guard lock{mutex_};
  std::vector<FleetHold> all;
  for (const std::string& job : unreported_) all.push_back(*newest(job));
  return all;
}

void LeaseBook::keep(FleetHold hold) {
  const std::string job = hold.job;
  for (const auto& [id, attempt] : hold.ids) jobs_[id] = job;
  if (hold.is_reported || hold.attempt == kUnknown)
    unreported_.erase(job);
  else
    unreported_.insert(job);
  holds_.insert_or_assign(job, std::move(hold));
}

// ---- on disk -------------------------------------------------------------------------------------------------------

Result<void> LeaseBook::change(const std::string& fleet_job, std::uint32_t attempt,
                               const std::function<Result<void>(FleetHold&)>& how) {
  const FleetHold* const before = newest(fleet_job);
  if (before != nullptr && before->attempt > attempt)
    return fail(ErrorCode::Conflict, fmt::format("attempt {} of job {} is over: attempt {} is known here", attempt,
                                                 fleet_job, before->attempt));
  FleetHold hold = before == nullptr ? FleetHold{} : *before;
  if (auto changed = how(hold); !changed) return changed;
  if (before != nullptr && *before == hold) return {};
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error)
    return fail(ErrorCode::StorageFailed, fmt::format("cannot make {}: {}", folder_.string(), error.message()));
  if (auto kept = write_file_atomically(folder_ / (fleet_job + std::string{kSuffix}), text_of(hold)); !kept)
    return kept;
  keep(std::move(hold));
  return {};
}

Result<void> LeaseBook::hold(const std::string& fleet_job, std::uint32_t attempt, const std::string& id,
                             const std::string& machine) {
  const std::lock_guard lock{mutex_};
  return change(fleet_job, attempt, [&](FleetHold& hold) -> Result<void> {
    if (hold.attempt == attempt) return {};
    hold.job = fleet_job;
    hold.attempt = attempt;
    hold.machine = machine;
    hold.ids[id] = attempt;
    hold.is_bound = hold.is_reported = false;
    hold.end = HoldEnd::None;
    return {};
  });
}

Result<void> LeaseBook::set_site(const std::string& fleet_job, std::uint32_t attempt, const std::string& site) {
  const std::lock_guard lock{mutex_};
  return change(fleet_job, attempt, [&](FleetHold& hold) -> Result<void> {
    if (hold.attempt != attempt)
      return fail(ErrorCode::Conflict, fmt::format("attempt {} of job {} is not this fab's", attempt, fleet_job));
    if (!hold.site.empty() && hold.site != site)
      return fail(ErrorCode::Conflict, fmt::format("job {} of the fleet is of another site", fleet_job));
    hold.site = site;
    return {};
  });
}

Result<void> LeaseBook::bind(const std::string& fleet_job, std::uint32_t attempt) {
  const std::lock_guard lock{mutex_};
  auto bound = change(fleet_job, attempt, [&](FleetHold& hold) -> Result<void> {
    if (hold.attempt != attempt || hold.end != HoldEnd::None)
      return fail(ErrorCode::Conflict, fmt::format("attempt {} of job {} is not this fab's", attempt, fleet_job));
    hold.is_bound = true;
    return {};
  });
  if (bound) asked_.erase(fleet_job);
  return bound;
}

Result<void> LeaseBook::end(const std::string& fleet_job, std::uint32_t attempt, HoldEnd end) {
  const std::lock_guard lock{mutex_};
  asked_.erase(fleet_job);
  return change(fleet_job, attempt, [&](FleetHold& hold) -> Result<void> {
    if (hold.attempt == attempt && hold.end == HoldEnd::None) hold.end = end;
    return {};
  });
}

Result<void> LeaseBook::set_reported(const std::string& fleet_job, std::uint32_t attempt) {
  const std::lock_guard lock{mutex_};
  return change(fleet_job, attempt, [&](FleetHold& hold) -> Result<void> {
    if (hold.attempt == attempt) hold.is_reported = true;
    return {};
  });
}

// ---- leases --------------------------------------------------------------------------------------------------------

void LeaseBook::extend(const std::string& fleet_job, std::uint32_t attempt, Nanoseconds until) {
  const std::lock_guard lock{mutex_};
  leases_[fleet_job] = {attempt, until, FenceRefusal::None};
}

void LeaseBook::withdraw(const std::string& fleet_job, std::uint32_t attempt, FenceRefusal why) {
  const std::lock_guard lock{mutex_};
  Lease& lease = leases_[fleet_job];
  if (lease.attempt <= attempt) lease = {attempt, {}, why};
  asked_.erase(fleet_job);
}

Leave LeaseBook::leave_locked(const Own& own) const {
  const auto refused = [](FenceRefusal why, std::string what) {
    return Leave{LeaveState::Refused, why, std::move(what)};
  };
  if (!own.is_newest())
    return refused(FenceRefusal::Superseded,
                   fmt::format("attempt {} of it is over, attempt {} is known here", own.attempt, own.hold.attempt));
  if (own.hold.end != HoldEnd::None)
    return refused(FenceRefusal::Superseded, fmt::format("attempt {} of it has ended here", own.attempt));
  const auto lease = leases_.find(own.hold.job);
  const bool is_known = lease != leases_.end() && lease->second.attempt == own.attempt;
  if (is_known && lease->second.withdrawn != FenceRefusal::None)
    return refused(lease->second.withdrawn, lease->second.withdrawn == FenceRefusal::Superseded
                                                ? "the fleet has given it to another machine"
                                                : "the fleet has ended its lease");
  if (own.hold.is_bound) return {};
  if (!is_known || clock_.now() >= lease->second.until)
    return refused(FenceRefusal::LeaseEnded,
                   "nothing shows that the fleet still has it printed here: its database is not reached");
  return {LeaveState::Awaited, FenceRefusal::None, "the fleet's database has not bound it to this machine yet"};
}

Leave LeaseBook::leave(std::string_view id) const {
  const std::lock_guard lock{mutex_};
  const auto own = own_locked(id);
  return own ? leave_locked(*own) : Leave{};
}

Leave LeaseBook::ask(std::string_view id) {
  std::function<void()> notify;
  Leave leave;
  {
    const std::lock_guard lock{mutex_};
    const auto own = own_locked(id);
    if (!own) return {LeaveState::Refused, FenceRefusal::LeaseEnded, "its record of the fleet is gone"};
    leave = leave_locked(*own);
    if (leave.state == LeaveState::Awaited && asked_.insert(own->hold.job).second) notify = notify_;
  }
  if (notify) notify();
  return leave;
}

std::shared_ptr<LightFence> LeaseBook::fence_of(std::string_view id) {
  const auto found = own(id);
  return found ? std::make_shared<Fence>(*this, std::string{id}, found->attempt) : nullptr;
}

std::vector<LeaseBook::Asked> LeaseBook::asked() const {
  const std::lock_guard lock{mutex_};
  std::vector<Asked> all;
  for (const std::string& job : asked_) all.push_back({job, newest(job)->attempt});
  return all;
}

void LeaseBook::on_asked(std::function<void()> notify) {
  const std::lock_guard lock{mutex_};
  notify_ = std::move(notify);
}

}  // namespace telefab::fab
