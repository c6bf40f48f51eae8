// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan_session.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <telefab/service/file_sender.hpp>

namespace telefab::fab {
namespace {

constexpr auto kLookEvery = std::chrono::milliseconds{50};
constexpr std::size_t kMaxJobs = 256;

class ScanSession : public std::enable_shared_from_this<ScanSession> {
 public:
  ScanSession(net::Loop& loop, net::ConnectionPtr connection, StackReceiver& receiver)
      : loop_{loop}, connection_{std::move(connection)}, receiver_{receiver} {}

  void begin() {
    connection_->set_events({[self = shared_from_this()](const Frame& frame) { self->on_frame(frame); },
                             [self = shared_from_this()] { self->send_files(); },
                             [self = shared_from_this()](const Error& why) { self->on_closed(why); }});
  }

 private:
  /// A job of this site, as it was last sent.
  struct OwnJob {
    std::shared_ptr<Intake> intake;
    std::optional<Job> last_sent;
    std::uint32_t due = 0;  ///< no chunk below comes on this connection again
  };

  void on_frame(const Frame& frame) {
    auto message = from_frame(frame);
    if (!message) return end(message.error());
    std::visit([&](const auto& each) { handle(each); }, *message);
  }

  void on_closed(const Error& why) {
    is_open_ = false;
    if (why.code == ErrorCode::ProtocolBroken) {
      receiver_.note(connection_->peer().address, why.what);
      connection_->close(to_frame(Fault{{}, why, {}}));
    }
    jobs_.clear();
    downloads_.clear();
  }

  void end(const Error& why) {
    is_open_ = false;
    receiver_.note(connection_->peer().address, why.what);
    connection_->close(to_frame(Fault{{}, why, {}}));
    jobs_.clear();
    downloads_.clear();
  }

  void send(const Message& message) {
    if (!is_open_) return;
    if (auto sent = connection_->send(to_frame(message)); !sent) end(sent.error());
  }

  /// Looks for changes as long as there is a job that may still change.
  void look_again() {
    const bool has_any = std::any_of(jobs_.begin(), jobs_.end(), [](const auto& each) {
      return !each.second.last_sent || !is_final(each.second.last_sent->state);
    });
    if (is_looking_ || !has_any) return;
    is_looking_ = true;
    loop_.after(kLookEvery, [weak = weak_from_this()] {
      const auto self = weak.lock();
      if (!self) return;
      self->is_looking_ = false;
      if (!self->is_open_) return;
      self->send_changes();
      self->look_again();
    });
  }

  void send_changes() {
    const std::uint64_t revision = receiver_.store().revision();
    if (revision == seen_revision_) return;
    seen_revision_ = revision;
    for (auto& [id, own] : jobs_) send_if_changed(id, own);
  }

  void send_if_changed(const std::string& id, OwnJob& own) {
    auto job = receiver_.store().find(id);
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
    const net::Peer& peer = connection_->peer();
    if (jobs_.size() >= kMaxJobs && !offered_here(offer.job))
      return send(Fault{{}, {ErrorCode::TooLarge, "job-limit: too many jobs on one connection"}, offer.job});
    auto intake = receiver_.take_offer(offer, peer);
    if (!intake) {
      receiver_.note(peer.name, fmt::format("refused: offer {}: {}", offer.job, intake.error().what));
      return send(Fault{{}, intake.error(), offer.job});
    }
    OwnJob& own = jobs_[offer.job];
    own = {*intake, {}, *intake ? (*intake)->next_sequence() : 0};
    // A job beyond its intake is whole here already.
    send(OfferAccepted{offer.job, *intake ? (*intake)->next_sequence() : 0, !*intake || (*intake)->is_complete()});
    if (is_open_) send_if_changed(offer.job, own);
    look_again();
  }

  void handle(const SendChunk& chunk) {
    OwnJob* own = offered_here(chunk.job);
    // Chunks of a job that was refused or cancelled may still be on their way.
    if (!own || !own->intake) return;
    auto taken = chunk.sequence >= own->due
                     ? own->intake->take(chunk)
                     : fail(ErrorCode::ProtocolBroken, fmt::format("chunk-order: chunk {} came again", chunk.sequence));
    if (!taken) {
      receiver_.broken(chunk.job, taken.error());
      send(Fault{{}, taken.error(), chunk.job});
      return end(taken.error());
    }
    own->due = chunk.sequence + 1;
    receiver_.received(chunk.job, own->intake->spool().layer_count(), kFrameHeaderBytes + chunk.payload.size());
    send(ChunkStored{chunk.job, chunk.sequence});
  }

  void handle(const StackEnd& stack) {
    OwnJob* own = offered_here(stack.job);
    if (!own || !own->intake) return;
    if (auto finished = own->intake->finish(stack); !finished) {
      receiver_.broken(stack.job, finished.error());
      send(Fault{{}, finished.error(), stack.job});
      return end(finished.error());
    }
    own->intake.reset();
    send(StackStored{stack.job});
    receiver_.completed(stack.job);
  }

  /// The job as far as this site may ask about it.
  [[nodiscard]] Result<Job> own_job(const std::string& id) {
    auto job = receiver_.store().find(id);
    if (job && job->owner != connection_->peer().name) return fail(ErrorCode::NotFound, fmt::format("no job {}", id));
    return job;
  }

  void handle(const Command& command) {
    if (const auto job = own_job(command.job); !job) return send(Fault{command.request, job.error(), command.job});
    if (command.command == JobCommand::Approve)
      return send(
          Fault{command.request,
                {ErrorCode::NotPermitted, "only an operator of the fab may approve: telefab approve --site FAB"},
                command.job});
    Command named = command;
    named.who = fmt::format("{} at {}", command.who.substr(0, 100), connection_->peer().name);
    receiver_.note(named.who, fmt::format("{} {}", name_of(command.command), command.job));
    receiver_.command(named, [weak = weak_from_this(), request = command.request, id = command.job](Result<Job> job) {
      const auto self = weak.lock();
      if (!self) return;
      if (job)
        self->send(Jobs{request, {std::move(*job)}});
      else
        self->send(Fault{request, job.error(), id});
    });
  }

  void handle(const AskFiles& question) {
    if (const auto job = own_job(question.job); !job) return send(Fault{question.request, job.error(), question.job});
    receiver_.files(question.job, [weak = weak_from_this(), question](Result<std::vector<FileEntry>> files) {
      const auto self = weak.lock();
      if (!self) return;
      if (files)
        self->send(Files{question.request, std::move(*files)});
      else
        self->send(Fault{question.request, files.error(), question.job});
    });
  }

  void handle(const AskFile& question) {
    if (const auto job = own_job(question.job); !job) return send(Fault{question.request, job.error(), question.job});
    receiver_.file(question.job, question.name,
                   [weak = weak_from_this(), question](Result<std::filesystem::path> path) {
                     const auto self = weak.lock();
                     if (!self) return;
                     if (!path) return self->send(Fault{question.request, path.error(), question.job});
                     if (auto added = self->downloads_.add(question.request, *path); !added)
                       return self->send(Fault{question.request, added.error(), question.job});
                     self->send_files();
                   });
  }

  void send_files() {
    if (is_open_) downloads_.pump(*connection_, [this](const Message& block) { send(block); });
  }

  /// What a scan site does not send to a fab.
  template <class Other>
  void handle(const Other&) {
    end({ErrorCode::ProtocolBroken, "message-order: a scan site does not send this message"});
  }

  net::Loop& loop_;
  net::ConnectionPtr connection_;
  StackReceiver& receiver_;
  bool is_open_ = true;
  bool is_looking_ = false;
  std::uint64_t seen_revision_ = 0;
  std::map<std::string, OwnJob> jobs_;
  FileSender downloads_;
};

}  // namespace

void serve_scan_site(net::Loop& loop, const net::ConnectionPtr& connection, StackReceiver& receiver) {
  std::make_shared<ScanSession>(loop, connection, receiver)->begin();
}

}  // namespace telefab::fab
