// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_session.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>
#include <telefab/service/log.hpp>
#include <telefab/service/message_session.hpp>

#include "job_room.hpp"

namespace telefab::fab {
namespace {

constexpr auto kLookEvery = std::chrono::milliseconds{50};
constexpr std::size_t kMaxJobs = 256;

class ScanSession final : public MessageSession {
 public:
  ScanSession(net::Loop& loop, net::ConnectionPtr connection, JobService& service, StackReceiver& receiver)
      : MessageSession{loop, std::move(connection), service}, receiver_{receiver} {}

 private:
  /// A job of this site, as it was last sent.
  struct OwnJob {
    std::shared_ptr<Intake> intake;
    std::optional<Job> last_sent;
    std::uint32_t due = 0;  ///< no chunk below comes on this connection again
  };

  void on_message(const Message& message) override {
    std::visit([&](const auto& each) { handle(each); }, message);
  }
  void on_end() override { jobs_.clear(); }

  /// Looks for changes as long as there is a job that may still change.
  void look_again() {
    const bool has_any = std::any_of(jobs_.begin(), jobs_.end(), [](const auto& each) {
      return !each.second.last_sent || !is_final(each.second.last_sent->state);
    });
    if (is_looking_ || !has_any) return;
    is_looking_ = true;
    loop().after(kLookEvery, [weak = weak_from_this()] {
      const auto strong = weak.lock();
      if (!strong) return;
      auto& self = static_cast<ScanSession&>(*strong);
      self.is_looking_ = false;
      if (!self.is_open()) return;
      self.send_changes();
      self.look_again();
    });
  }

  void send_changes() {
    const std::uint64_t revision = service().store().revision();
    if (revision == seen_revision_) return;
    seen_revision_ = revision;
    for (auto each = jobs_.begin(); each != jobs_.end();) {
      const auto now = each++;
      send_if_changed(now->first, now->second);
      if (!is_open()) return;  // the connection ended, and the jobs are forgotten
      forget_if_over(now->first, now->second);
    }
  }

  /// A connection lasts for months; a job that is at its end keeps no place on it.
  void forget_if_over(const std::string& id, const OwnJob& own) {
    if (own.last_sent && is_final(own.last_sent->state)) jobs_.erase(std::string{id});
  }

  void send_if_changed(const std::string& id, OwnJob& own) {
    auto job = service().store().find(id);
    if (!job || (own.last_sent && *job == *own.last_sent)) return;
    own.last_sent = *job;
    send(JobChanged{std::move(*job)});
  }

  /// The job, if this site offered it on this connection.
  OwnJob* offered_here(const std::string& job) {
    const auto found = jobs_.find(job);
    return found == jobs_.end() ? nullptr : &found->second;
  }

  void handle(const Offer& offer) {
    if (jobs_.size() >= kMaxJobs && !offered_here(offer.job))
      return defer(receiver_.put_off(offer.job, DeferReason::Busy,
                                     fmt::format("it has {} jobs of this site that are not at their end", kMaxJobs)));
    auto answer = receiver_.take_offer(offer, peer());
    if (!answer) {
      service().note(peer().name, fmt::format("refused: offer {}: {}", offer.job, answer.error().what));
      return send_fault({}, answer.error(), offer.job);
    }
    if (const auto* deferred = std::get_if<OfferDeferred>(&*answer)) return defer(*deferred);
    const auto intake = std::get<std::shared_ptr<Intake>>(std::move(*answer));
    deferred_.erase(offer.job);
    OwnJob& own = jobs_[offer.job];
    own = {intake, {}, intake ? intake->next_sequence() : 0};
    // A job beyond its intake is whole here already.
    send(OfferAccepted{offer.job, intake ? intake->next_sequence() : 0, !intake || intake->is_complete()});
    if (is_open()) send_if_changed(offer.job, own);
    if (is_open()) forget_if_over(offer.job, own);
    look_again();
  }

  /// The job is offered again, perhaps many times; it is logged once.
  void defer(const OfferDeferred& deferred) {
    if (deferred_.insert(deferred.job).second)
      log_warning(fmt::format("{}: job {} is put off: {}", peer().name, deferred.job, deferred.what), {deferred.job});
    jobs_.erase(deferred.job);
    send(deferred);
  }

  /// What came of a job was not taken: it was wrong, or could not be stored.
  void refuse(const std::string& job, const Error& why) {
    if (is_storage_trouble(why)) return defer(receiver_.put_off(job, DeferReason::StorageFault, why.what));
    receiver_.broken(job, why);
    send_fault({}, why, job);
    end(why);
  }

  void handle(const SendChunk& chunk) {
    OwnJob* own = offered_here(chunk.job);
    // Chunks of a job that was refused or cancelled may still be on their way.
    if (!own || !own->intake) return;
    auto taken = chunk.sequence >= own->due
                     ? own->intake->take(chunk)
                     : fail(ErrorCode::ProtocolBroken, fmt::format("chunk-order: chunk {} came again", chunk.sequence));
    if (!taken) return refuse(chunk.job, taken.error());
    own->due = chunk.sequence + 1;
    receiver_.received(chunk.job, own->intake->spool().layer_count(), kFrameHeaderBytes + chunk.payload.size());
    send(ChunkStored{chunk.job, chunk.sequence});
  }

  void handle(const StackEnd& stack) {
    OwnJob* own = offered_here(stack.job);
    if (!own || !own->intake) return;
    if (auto finished = own->intake->finish(stack); !finished) {
      if (const auto again = receiver_.send_again(stack.job)) return defer(*again);
      return refuse(stack.job, finished.error());
    }
    own->intake.reset();
    send(StackStored{stack.job});
    receiver_.completed(stack.job);
  }

  /// The job as far as this site may ask about it.
  [[nodiscard]] Result<Job> own_job(const std::string& id) {
    auto job = service().store().find(id);
    if (job && job->owner != peer().name) return fail(ErrorCode::NotFound, fmt::format("no job {}", id));
    return job;
  }

  void handle(const Command& command) {
    if (const auto job = own_job(command.job); !job) return send_fault(command.request, job.error(), command.job);
    if (command.command == JobCommand::Approve)
      return send_fault(
          command.request,
          {ErrorCode::NotPermitted, "only an operator of the fab may approve: telefab approve --site FAB"},
          command.job);
    if (command.command == JobCommand::Forget)
      return send_fault(command.request,
                        {ErrorCode::NotPermitted, "only an operator of the fab may forget: telefab forget --site FAB"},
                        command.job);
    Command named = command;
    named.who = fmt::format("{} at {}", command.who.substr(0, 100), peer().name);
    carry_out(named);
  }

  /// What its operators are to see of the machines; nothing of other sites' jobs.
  void handle(const AskMachines& question) {
    service().machines([weak = weak_from_this(), request = question.request](const Machines& known) {
      Machines answer;
      answer.request = request;
      answer.origin = known.origin;
      answer.standing = known.standing;
      if (const auto self = weak.lock()) static_cast<ScanSession&>(*self).answer(std::move(answer));
    });
  }
  void answer(Machines machines) {
    for (MachineStatus& status : machines.standing)
      if (!own_job(status.job)) {
        status.job.clear();
        status.job_name.clear();
        status.message.clear();
      }
    send(machines);
  }

  void handle(const AskFiles& question) {
    if (const auto job = own_job(question.job); !job) return send_fault(question.request, job.error(), question.job);
    send_list(question);
  }

  void handle(const AskFile& question) {
    if (const auto job = own_job(question.job); !job) return send_fault(question.request, job.error(), question.job);
    send_file(question);
  }

  /// What a scan site does not send to a fab.
  template <class Other>
  void handle(const Other&) {
    refuse_message("scan site");
  }

  StackReceiver& receiver_;
  bool is_looking_ = false;
  std::uint64_t seen_revision_ = 0;
  std::map<std::string, OwnJob> jobs_;
  std::set<std::string> deferred_;  ///< jobs that were put off and are not taken yet
};

}  // namespace

void serve_scan_site(net::Loop& loop, const net::ConnectionPtr& connection, JobService& service,
                     StackReceiver& receiver) {
  std::make_shared<ScanSession>(loop, connection, service, receiver)->begin();
}

}  // namespace telefab::fab
