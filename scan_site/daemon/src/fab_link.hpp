// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <optional>
#include <telefab/machine/profile_catalogue.hpp>
#include <telefab/net/listener.hpp>
#include <telefab/wire/message.hpp>

#include <telefab/transfer/spool_registry.hpp>

namespace telefab::scan {

struct FabLinkEvents {
  std::function<void(bool is_up, const std::string& why)> changed;
  /// So many layers are durable at the fab; so many bytes went out for this job since the last call.
  std::function<void(const std::string& job, std::uint32_t layers, std::uint64_t bytes)> acknowledged;
  std::function<void(const std::string& job)> kept;  ///< the whole stack is at the fab, checked
  std::function<void(const Job& theirs)> job_changed;
  std::function<void(const std::string& job, const Error& why)> refused;  ///< by the fab, for good
  /// The job's spool could not be read; nothing more of it is sent before pump().
  std::function<void(const std::string& job, const Error& why)> unreadable;
  /// The fab puts the job off, and it is offered again; empty: it is taken now.
  std::function<void(const std::string& job, const std::string& why)> deferred;
};

/// The scan site's end of the wire: keeps a connection to the fab, offers jobs, sends their chunks as they come into
/// the spools and goes on behind the last acknowledged one after any cut. Threads: the loop's only.
class FabLink {
 public:
  /// The answer to a question, possibly in several messages; returns true when it was the last.
  using Answer = std::function<bool(Result<Message>)>;

  /// `site_key`: private Ed25519 key in PEM; signs the ends of stacks.
  FabLink(net::Loop& loop, net::ConnectOptions options, std::string site_key, FabLinkEvents events);
  ~FabLink();
  FabLink(const FabLink&) = delete;
  FabLink& operator=(const FabLink&) = delete;
  void start();

  [[nodiscard]] bool is_up() const { return is_ready_; }
  /// Whether it may be asked what its machines are at.
  [[nodiscard]] bool answers_machines() const { return is_ready_ && answers_machines_; }
  [[nodiscard]] const std::string& why_down() const { return why_down_; }
  /// What the fab said last; nothing until it was reached once.
  [[nodiscard]] const std::optional<ProfileCatalogue>& profiles() const { return profiles_; }

  /// Why a job does not go out now: the fab is not reached, or puts it off; empty: it does.
  [[nodiscard]] std::string why_waiting(const std::string& job) const;

  void add(const Offer& offer, std::shared_ptr<SharedSpool> spool);
  [[nodiscard]] bool knows(const std::string& job) const { return jobs_.contains(job); }
  /// More chunks, or the end, are in the job's spool.
  void pump(const std::string& job);
  void forget(const std::string& job) { jobs_.erase(job); }
  [[nodiscard]] RequestId next_request() { return static_cast<RequestId>(++last_request_); }
  /// Unreachable at once where the link is down.
  void ask(RequestId request, const Message& question, Answer answer);

 private:
  struct Sending {
    Offer offer;
    std::shared_ptr<SharedSpool> spool;
    bool is_taken = false;  ///< on this connection
    bool is_end_sent = false;
    std::uint32_t next = 0;    ///< chunk to be sent
    std::uint32_t kept = 0;    ///< chunks acknowledged
    std::uint64_t bytes = 0;   ///< sent and not yet told
    std::string why_deferred;  ///< empty: it is not
    std::uint32_t offers = 0;  ///< so many were sent
  };

  void connect();
  void on_connected(Result<net::ConnectionPtr> made);
  void on_closed(const Error& why);
  void on_frame(const Frame& frame);
  void retry(const Error& why);
  [[nodiscard]] bool send(const Message& message, Sending* counted);
  void offer(Sending& sending);
  void pump(Sending& sending);
  void fail_questions(const Error& why);

  void handle(const Hello& hello);
  void handle(const OfferAccepted& taken);
  void handle(const OfferDeferred& deferred);
  void handle(const ChunkStored& chunk);
  void handle(const StackStored& stack);
  void handle(const JobChanged& change);
  void handle(const Fault& fault);
  void handle(Machines machines) { answer(machines.request, Message{std::move(machines)}); }
  void handle(Jobs jobs) { answer(jobs.request, Message{std::move(jobs)}); }
  void handle(Files files) { answer(files.request, Message{std::move(files)}); }
  void handle(FileBlock block) { answer(block.request, Message{std::move(block)}); }
  template <class Other>
  void handle(const Other&);
  void answer(RequestId request, Result<Message> message);

  net::Loop& loop_;
  net::ConnectOptions options_;
  std::string site_key_;
  FabLinkEvents events_;
  net::ConnectionPtr connection_;
  bool is_ready_ = false;
  bool answers_machines_ = false;
  std::string why_down_ = "not tried yet";
  Nanoseconds pause_{};
  std::optional<ProfileCatalogue> profiles_;
  std::map<std::string, Sending> jobs_;
  std::map<RequestId, Answer> questions_;
  std::uint64_t last_request_ = 0;
  std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< for callbacks that outlive the link
};

}  // namespace telefab::scan
