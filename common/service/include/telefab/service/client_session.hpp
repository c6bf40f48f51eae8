// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/net/connection.hpp>
#include <telefab/net/loop.hpp>
#include <telefab/service/job_service.hpp>

namespace telefab {

/// Waits for the hello of a new connection and checks its version and that the certificate's role may speak for that
/// side. Sends `own` and calls `on_ready` when all is well; otherwise sends why, closes, and calls `refused`.
void handshake(net::Loop& loop, const net::ConnectionPtr& connection, Hello own,
               std::function<void(const Hello& theirs)> on_ready, std::function<void(const Error&)> refused);

/// What one client may ask for.
struct ClientLimits {
  std::size_t max_watches = 64;
  std::size_t max_uploads = 4;
  std::size_t max_files = 16;  ///< being sent at once
};

/// Answers the questions of one client past its handshake until its connection ends; keeps itself alive. Any question
/// may be asked by any role; to submit and to command needs the operator's. Threads: the loop's only.
void serve_client(net::Loop& loop, const net::ConnectionPtr& connection, JobService& service,
                  const ClientLimits& limits);

}  // namespace telefab
