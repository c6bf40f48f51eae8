// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <telefab/net/connection.hpp>
#include <telefab/net/loop.hpp>
#include <telefab/service/file_sender.hpp>
#include <telefab/service/job_service.hpp>

namespace telefab {

/// One peer past its handshake: its messages in, ours and files out, until the connection ends, which keeps the session
/// alive. Whoever it is may have files and commands answered alike; what else it may ask is the derived session's.
/// Threads: the loop's only.
class MessageSession : public std::enable_shared_from_this<MessageSession> {
 public:
  virtual ~MessageSession() = default;
  MessageSession(const MessageSession&) = delete;
  MessageSession& operator=(const MessageSession&) = delete;
  /// Takes the connection's events over.
  void begin();

 protected:
  /// Loop and service must outlive the session.
  MessageSession(net::Loop& loop, net::ConnectionPtr connection, JobService& service)
      : loop_{loop}, connection_{std::move(connection)}, service_{service} {}

  virtual void on_message(const Message& message) = 0;
  /// The connection is at its end: nothing that is under way on it goes on.
  virtual void on_end() = 0;

  [[nodiscard]] net::Loop& loop() const { return loop_; }
  [[nodiscard]] const net::Peer& peer() const { return connection_->peer(); }
  [[nodiscard]] JobService& service() const { return service_; }
  [[nodiscard]] bool is_open() const { return is_open_; }
  [[nodiscard]] std::size_t files_under_way() const { return downloads_.size(); }

  /// Nothing, once the connection is at its end.
  void send(const Message& message);
  void send_fault(RequestId request, const Error& error, const std::string& job = {});
  /// Ends the connection with the reason as its last message, and notes it.
  void end(const Error& why);
  /// For a message that such a peer does not send: "a client does not send this message".
  void refuse_message(std::string_view peer_kind);

  /// Notes and gives the command; job or fault are sent when it was carried out.
  void carry_out(const Command& command);
  void send_list(const AskFiles& question);
  void send_file(const AskFile& question);

 private:
  void on_frame(const Frame& frame);
  void on_closed(const Error& why);
  void forget_all();
  void pump_files();

  net::Loop& loop_;
  net::ConnectionPtr connection_;
  JobService& service_;
  bool is_open_ = true;
  FileSender downloads_;
};

}  // namespace telefab
