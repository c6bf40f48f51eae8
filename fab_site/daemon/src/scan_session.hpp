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

  /// A job that is offered, new or again; its intake lives until the job is planned. Refusals: NotFound (machine),
  /// NotTrusted (signature), Conflict (another profile, another job of that id, another owner's job), TooLarge (too
  /// many jobs).
  [[nodiscard]] virtual Result<std::shared_ptr<Intake>> take_offer(const Offer& offer, const net::Peer& peer) = 0;
  /// Bytes and layers came in.
  virtual void received(const std::string& job, std::uint32_t layers, std::uint64_t bytes) = 0;
  /// The stack is whole and checked; planning may begin.
  virtual void completed(const std::string& job) = 0;
  /// The job's data broke a rule; it is at its end.
  virtual void broken(const std::string& job, const Error& why) = 0;

 protected:
  StackReceiver() = default;
};

/// Talks to one scan site past its handshake until its connection ends. Threads: the loop's only.
void serve_scan_site(net::Loop& loop, const net::ConnectionPtr& connection, JobService& service,
                     StackReceiver& receiver);

}  // namespace telefab::fab
