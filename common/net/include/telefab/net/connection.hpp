// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <optional>
#include <telefab/base/clock.hpp>
#include <telefab/net/trust.hpp>
#include <telefab/wire/frame.hpp>

namespace telefab::net {

/// What one peer may cost us. No field is optional: every wait ends.
struct ConnectionLimits {
  Nanoseconds handshake_within = std::chrono::seconds{10};  ///< TLS handshake and hello
  Nanoseconds frame_within = std::chrono::seconds{30};      ///< from the first byte of a frame to its last
  Nanoseconds idle_after = std::chrono::seconds{60};        ///< without a byte; pings go out at a third of it
  Nanoseconds write_within = std::chrono::seconds{30};      ///< the peer takes some of what we send
  Nanoseconds judge_every = std::chrono::seconds{5};        ///< its certificate again: it may be revoked or expire
  std::size_t max_queue_bytes = 16U << 20U;                 ///< waiting to be sent; send() refuses above
  std::uint64_t max_bytes_per_s = 256ULL << 20U;            ///< read no faster than this
  std::uint64_t max_frames_per_s = 20'000;                  ///< read no faster than this
};

/// Called on the loop's thread. A handler may close its connection.
struct ConnectionEvents {
  std::function<void(Frame)> frame;          ///< never Ping or Pong
  std::function<void()> drained;             ///< everything queued was taken by the system; may be empty
  std::function<void(const Error&)> closed;  ///< once; not called after close()
};

/// Frames over one TCP or TLS stream. Sends are queued and gathered; TCP_NODELAY is set. Made by Listener and
/// connect_to; lives while somebody holds it or until it is closed. Threads: the loop's only.
class Connection {
 public:
  virtual ~Connection() = default;
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// To be called once, before anything is read.
  virtual void start(ConnectionEvents events) = 0;
  /// From here on these are called; an event under way ends first.
  virtual void set_events(ConnectionEvents events) = 0;
  /// Unreachable once closed; TooLarge when the peer does not take what is queued.
  [[nodiscard]] virtual Result<void> send(const Frame& frame) = 0;
  [[nodiscard]] virtual std::size_t queued_bytes() const = 0;
  /// The hello was good: long frames and long silences are allowed from here on.
  virtual void set_ready() = 0;
  [[nodiscard]] virtual bool is_ready() const = 0;
  /// Ends it as a deadline does: `closed` is called with the reason. Nothing where it is closed already.
  virtual void drop(const Error& why) = 0;
  /// Sends what is queued and `last_words`, then closes; no event comes any more.
  virtual void close(const std::optional<Frame>& last_words) = 0;
  [[nodiscard]] virtual const Peer& peer() const = 0;
  /// Of frames with their headers, so far.
  [[nodiscard]] virtual std::uint64_t bytes_sent() const = 0;
  [[nodiscard]] virtual std::uint64_t bytes_received() const = 0;

 protected:
  Connection() = default;
};
using ConnectionPtr = std::shared_ptr<Connection>;

}  // namespace telefab::net
