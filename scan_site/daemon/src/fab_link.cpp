// SPDX-License-Identifier: GPL-3.0-or-later
#include "fab_link.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <telefab/base/version.hpp>
#include <telefab/wire/job_signature.hpp>

namespace telefab::scan {
namespace {

constexpr Nanoseconds kShortestPause = std::chrono::milliseconds{100};
constexpr Nanoseconds kLongestPause = std::chrono::seconds{2};
/// Chunks on their way without an acknowledgement; what a cut makes us send again at most.
constexpr std::uint32_t kWindowChunks = 32;
constexpr std::size_t kQueueAheadBytes = 1U << 20U;

}  // namespace

FabLink::FabLink(net::Loop& loop, net::ConnectOptions options, std::string site_key, FabLinkEvents events)
    : loop_{loop},
      options_{std::move(options)},
      site_key_{std::move(site_key)},
      events_{std::move(events)},
      pause_{kShortestPause} {}

FabLink::~FabLink() {
  *alive_ = false;
  if (connection_) connection_->close({});
}

void FabLink::start() { connect(); }

void FabLink::connect() {
  net::connect_to(loop_, options_, [this, alive = alive_](Result<net::ConnectionPtr> made) {
    if (*alive) on_connected(std::move(made));
  });
}

void FabLink::on_connected(Result<net::ConnectionPtr> made) {
  if (!made) return retry(made.error());
  connection_ = std::move(*made);
  connection_->start({[this, alive = alive_](const Frame& frame) {
                        if (*alive) on_frame(frame);
                      },
                      [this, alive = alive_] {
                        if (!*alive) return;
                        for (auto& [id, sending] : jobs_) pump(sending);
                      },
                      [this, alive = alive_](const Error& why) {
                        if (*alive) on_closed(why);
                      }});
  (void)send(Hello{kProtocolVersion, Side::ScanSite, fmt::format("telefab-scan {}", kVersion), {}, {}}, nullptr);
}

void FabLink::on_closed(const Error& why) {
  connection_.reset();
  retry(why);
}

void FabLink::retry(const Error& why) {
  const bool was_up = std::exchange(is_ready_, false);
  const bool is_news = was_up || why.what != why_down_;
  why_down_ = why.what;
  for (auto& [id, sending] : jobs_) sending.is_taken = false;
  fail_questions(why);
  if (is_news) events_.changed(false, why.what);
  loop_.after(std::exchange(pause_, std::min(pause_ * 2, kLongestPause)), [this, alive = alive_] {
    if (*alive && !connection_) connect();
  });
}

void FabLink::fail_questions(const Error& why) {
  auto questions = std::exchange(questions_, {});
  for (auto& [request, answer] : questions) (void)answer(tl::unexpected{why});
}

bool FabLink::send(const Message& message, Sending* counted) {
  if (!connection_) return false;
  const Frame frame = to_frame(message);
  if (auto sent = connection_->send(frame); !sent) return false;
  if (counted) counted->bytes += kFrameHeaderBytes + frame.body.size();
  return true;
}

void FabLink::on_frame(const Frame& frame) {
  auto message = from_frame(frame);
  if (!message || (!is_ready_ && frame.type != FrameType::Hello && frame.type != FrameType::Fault)) {
    const Error why =
        message ? Error{ErrorCode::ProtocolBroken, "handshake: the fab did not say hello first"} : message.error();
    connection_->close(to_frame(Fault{{}, why, {}}));
    return on_closed(why);
  }
  std::visit([&](auto& received) { handle(std::move(received)); }, *message);
}

template <class Other>
void FabLink::handle(const Other&) {
  const Error why{ErrorCode::ProtocolBroken, "message-order: a fab does not send this message"};
  connection_->close(to_frame(Fault{{}, why, {}}));
  on_closed(why);
}

void FabLink::handle(const Hello& hello) {
  if (hello.protocol_version != kProtocolVersion) {
    const Error other{ErrorCode::ProtocolBroken,
                      fmt::format("protocol-version: this side speaks version {}, the fab {}; bring both to the same "
                                  "release",
                                  kProtocolVersion, hello.protocol_version)};
    connection_->close(to_frame(Fault{{}, other, {}}));
    return on_closed(other);
  }
  auto profiles = ProfileCatalogue::from_texts(hello.machine_toml, hello.resin_toml, hello.print_toml,
                                               "of the fab " + net::to_text(options_.endpoint));
  if (!profiles) {
    connection_->close(to_frame(Fault{{}, profiles.error(), {}}));
    return on_closed(profiles.error());
  }
  profiles_ = std::move(*profiles);
  answers_machines_ = hello.answers_machines;
  is_ready_ = true;
  connection_->set_ready();
  events_.changed(true, {});
  for (auto& [id, sending] : jobs_) offer(sending);
}

void FabLink::add(const Offer& given, std::shared_ptr<SharedSpool> spool) {
  auto [slot, is_new] = jobs_.try_emplace(given.job);
  if (!is_new) return;
  slot->second.offer = given;
  slot->second.spool = std::move(spool);
  if (is_ready_) offer(slot->second);
}

void FabLink::offer(Sending& sending) {
  sending.is_taken = sending.is_end_sent = false;
  ++sending.offers;
  (void)send(sending.offer, &sending);  // where it fails the connection is lost, and the job is offered on the next one
}

void FabLink::pump(const std::string& job) {
  if (const auto found = jobs_.find(job); found != jobs_.end()) pump(found->second);
}

void FabLink::pump(Sending& sending) {
  if (!is_ready_ || !sending.is_taken || sending.is_end_sent) return;
  while (connection_ && connection_->queued_bytes() < kQueueAheadBytes) {
    const auto chunks = sending.spool->with([](const ChunkSpool& spool) { return spool.chunk_count(); });
    if (sending.next >= chunks || sending.next >= sending.kept + kWindowChunks) break;
    auto chunk = sending.spool->with([&](const ChunkSpool& spool) { return spool.read(sending.next); });
    if (!chunk) {
      // Told later: the event may forget the job while a caller walks over all of them.
      loop_.post([this, alive = alive_, job = sending.offer.job, why = chunk.error()] {
        if (*alive) events_.unreadable(job, why);
      });
      return;
    }
    if (!send(SendChunk{sending.offer.job, chunk->sequence, chunk->first_layer, chunk->layer_count,
                        std::move(chunk->payload), chunk->chain},
              &sending))
      return;
    ++sending.next;
  }
  sending.spool->with([&](const ChunkSpool& spool) {
    if (!spool.finished() || sending.kept < spool.chunk_count()) return;
    StackEnd end{sending.offer.job, spool.chunk_count(), spool.chain(), *spool.finished(), {}};
    // A key that cannot sign does not get this far; the fab refuses what is not signed.
    if (is_signed(sending.offer)) (void)sign_end(sending.offer, end, site_key_);
    sending.is_end_sent = send(end, &sending);
  });
}

void FabLink::handle(const OfferAccepted& taken) {
  const auto found = jobs_.find(taken.job);
  if (found == jobs_.end()) return;
  Sending& sending = found->second;
  // Only what moves a job on counts as a working line: a fab that answers the handshake and then hangs up is not asked
  // ten times a second.
  pause_ = kShortestPause;
  sending.is_taken = true;
  if (!std::exchange(sending.why_deferred, {}).empty()) events_.deferred(std::string{taken.job}, {});
  sending.next = sending.kept = taken.next_sequence;
  const auto layers = sending.spool->with([&](const ChunkSpool& spool) -> std::uint32_t {
    if (taken.next_sequence == 0) return 0;
    const auto last = spool.read(taken.next_sequence - 1);
    return last ? last->first_layer.count() + last->layer_count : 0;
  });
  events_.acknowledged(taken.job, layers, std::exchange(sending.bytes, 0));
  if (taken.complete) {
    sending.is_end_sent = true;
    return events_.kept(taken.job);
  }
  pump(sending);
}

void FabLink::handle(const OfferDeferred& deferred) {
  const auto found = jobs_.find(deferred.job);
  if (found == jobs_.end()) return;
  Sending& sending = found->second;
  sending.is_taken = sending.is_end_sent = false;
  sending.why_deferred = deferred.what;
  loop_.after(std::max<Nanoseconds>(deferred.retry_after, kShortestPause),
              [this, alive = alive_, job = deferred.job, offers = sending.offers] {
                if (!*alive) return;
                // On a new connection it was offered meanwhile: two offers under way would be answered twice, and its
                // chunks would come again.
                const auto again = jobs_.find(job);
                if (again == jobs_.end() || again->second.offers != offers) return;
                if (is_ready_) offer(again->second);
              });
  events_.deferred(std::string{deferred.job}, deferred.what);
}

std::string FabLink::why_waiting(const std::string& job) const {
  if (!is_ready_) return "waits for the fab: " + why_down_;
  const auto found = jobs_.find(job);
  if (found == jobs_.end() || found->second.why_deferred.empty()) return {};
  return "waits: " + found->second.why_deferred;
}

void FabLink::handle(const ChunkStored& chunk) {
  const auto found = jobs_.find(chunk.job);
  if (found == jobs_.end() || chunk.sequence < found->second.kept || chunk.sequence >= found->second.next) return;
  Sending& sending = found->second;
  sending.kept = chunk.sequence + 1;
  const auto kept = sending.spool->with([&](const ChunkSpool& spool) { return spool.read(chunk.sequence); });
  if (kept)
    events_.acknowledged(chunk.job, kept->first_layer.count() + kept->layer_count, std::exchange(sending.bytes, 0));
  pump(sending);
}

void FabLink::handle(const StackStored& stack) {
  const auto found = jobs_.find(stack.job);
  if (found == jobs_.end()) return;
  events_.acknowledged(stack.job, found->second.offer.header.layer_count, std::exchange(found->second.bytes, 0));
  events_.kept(stack.job);
}

void FabLink::handle(const JobChanged& change) {
  if (jobs_.contains(change.job.id)) events_.job_changed(change.job);
}

void FabLink::handle(const Fault& fault) {
  if (fault.request != RequestId{}) return answer(fault.request, tl::unexpected{fault.error});
  if (!fault.job.empty()) {
    if (jobs_.contains(fault.job)) events_.refused(std::string{fault.job}, fault.error);
    return;
  }
  // About the connection, which the fab closes now.
  why_down_ = fault.error.what;
  events_.changed(false, fault.error.what);
}

void FabLink::ask(RequestId request, const Message& question, Answer on_answer) {
  if (!is_ready_ || !send(question, nullptr)) {
    (void)on_answer(fail(ErrorCode::Unreachable, fmt::format("the fab site {} is not reachable now: {}",
                                                             net::to_text(options_.endpoint), why_down_)));
    return;
  }
  questions_[request] = std::move(on_answer);
}

void FabLink::answer(RequestId request, Result<Message> message) {
  const auto found = questions_.find(request);
  if (found == questions_.end()) return;
  // The answer may ask again, which changes the table.
  const bool is_last_anyway = !message;
  Answer handler = std::move(found->second);
  questions_.erase(found);
  if (!handler(std::move(message)) && !is_last_anyway) questions_[request] = std::move(handler);
}

}  // namespace telefab::scan
