// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <deque>
#include <stop_token>
#include <telefab/net/listener.hpp>
#include <telefab/wire/message.hpp>

namespace telefab::client {

/// Where and as whom to call.
struct SiteAddress {
  net::Endpoint endpoint;
  std::shared_ptr<net::Trust> trust;         ///< empty: plain TCP on loopback
  std::optional<std::string> expected_name;  ///< that the site's certificate must vouch for
  Nanoseconds connect_within = std::chrono::seconds{10};
  Nanoseconds answer_within = std::chrono::seconds{60};
};

/// One conversation with a site, question by question, on the calling thread.
class SiteClient {
 public:
  /// Connects and shakes hands. Fails with Unreachable, NotTrusted, NotPermitted, ProtocolBroken, Cancelled.
  [[nodiscard]] static Result<std::unique_ptr<SiteClient>> connect(const SiteAddress& address, std::stop_token stop);
  ~SiteClient();
  SiteClient(const SiteClient&) = delete;
  SiteClient& operator=(const SiteClient&) = delete;

  /// Sends; waits while more than a few megabytes are queued.
  [[nodiscard]] Result<void> send(const Message& message);
  /// The next message; the Error of a Fault, InvalidInput for one of NotFound and NotTrusted for one of NotPermitted:
  /// no file of this machine is meant; Unreachable when none comes within `within`; Cancelled when stopped.
  [[nodiscard]] Result<Message> receive(Nanoseconds within);
  /// The same, but nothing received within the time is no failure.
  [[nodiscard]] Result<std::optional<Message>> receive_within(Nanoseconds within);
  /// Both, and the answer must be an `Answer`.
  template <class Answer>
  [[nodiscard]] Result<Answer> ask(const Message& question) {
    if (auto sent = send(question); !sent) return tl::unexpected{sent.error()};
    auto answer = receive(answer_within_);
    if (!answer) return tl::unexpected{answer.error()};
    if (auto* wanted = std::get_if<Answer>(&*answer)) return std::move(*wanted);
    return fail(ErrorCode::ProtocolBroken, "the site answered with another message than was asked for");
  }
  /// A name for the next question.
  [[nodiscard]] RequestId next_request() { return static_cast<RequestId>(++last_request_); }
  [[nodiscard]] Nanoseconds answer_within() const { return answer_within_; }

 private:
  SiteClient(std::stop_token stop, Nanoseconds answer_within) : stop_{std::move(stop)}, answer_within_{answer_within} {}
  [[nodiscard]] Result<void> open(const SiteAddress& address);
  /// Lets the loop run until `ready`; false when that did not happen within the time.
  template <class Ready>
  [[nodiscard]] bool run_until(Nanoseconds within, const Ready& ready);

  net::Loop loop_;
  net::ConnectionPtr connection_;
  std::deque<Frame> received_;
  std::optional<Error> lost_;
  std::stop_token stop_;
  Nanoseconds answer_within_;
  std::uint64_t last_request_ = 0;
};

}  // namespace telefab::client
