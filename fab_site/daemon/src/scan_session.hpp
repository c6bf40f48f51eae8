// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/net/connection.hpp>
#include <telefab/net/loop.hpp>
#include <telefab/service/job_service.hpp>

#include "intake.hpp"

namespace telefab::fab {

/// Where the stacks of scan sites arrive. Called on the loop's thread.
class StackReceiver {
 public:
  virtual ~StackReceiver() = default;
  StackReceiver(const StackReceiver&) = delete;
  StackReceiver& operator=(const StackReceiver&) = delete;

  /// Where the layers of an offered job go, null where all are here; or why the job is put off.
  using OfferAnswer = std::variant<std::shared_ptr<Intake>, OfferDeferred>;

  /// A job that is offered, new or again; its intake lives until the job is planned. Refused for good: InvalidInput
  /// (machine), NotTrusted (signature), Conflict (another profile, another job of that id, another owner's job),
  /// TooLarge (for this fab's disk). A disk that is full or cannot be written puts it off.
  [[nodiscard]] virtual Result<OfferAnswer> take_offer(const Offer& offer, const net::Peer& peer) = 0;
  /// What came of the job could not be stored: its intake is closed, and it is to be offered again. Also the answer to
  /// an offer of one job too many.
  [[nodiscard]] virtual OfferDeferred put_off(const std::string& job, DeferReason reason, const std::string& why) = 0;
  /// Bytes and layers came in.
  virtual void received(const std::string& job, std::uint32_t layers, std::uint64_t bytes) = 0;
  /// The stack is whole and checked; planning may begin.
  virtual void completed(const std::string& job) = 0;
  /// The end of a job does not fit its layers. Where those were not sent for it but were here as another job's they go,
  /// and it is offered again, to be sent. Nothing: they were sent, and are wrong.
  [[nodiscard]] virtual std::optional<OfferDeferred> send_again(const std::string& job) = 0;
  /// The job's data broke a rule; it is at its end.
  virtual void broken(const std::string& job, const Error& why) = 0;

 protected:
  StackReceiver() = default;
};

/// Talks to one scan site past its handshake until its connection ends. Threads: the loop's only.
void serve_scan_site(net::Loop& loop, const net::ConnectionPtr& connection, JobService& service,
                     StackReceiver& receiver);

}  // namespace telefab::fab
