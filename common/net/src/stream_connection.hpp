// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <telefab/net/connection.hpp>

#include "asio.hpp"
#include "loop_timer.hpp"
#include "tls_words.hpp"

namespace telefab::net {

/// Connection over a byte stream of Asio: a TCP socket or a TLS stream of one.
template <class Stream>
class StreamConnection final : public Connection, public std::enable_shared_from_this<StreamConnection<Stream>> {
 public:
  /// `trust`: whoever let the peer in, asked again and again whether it still would; empty for plain TCP.
  StreamConnection(Loop& loop, Stream stream, Peer peer, const ConnectionLimits& limits, std::shared_ptr<Trust> trust,
                   End own_end)
      : clock_{loop.impl().clock},
        stream_{std::move(stream)},
        tick_{loop},
        slow_{loop},
        peer_{std::move(peer)},
        limits_{limits},
        trust_{std::move(trust)},
        own_end_{own_end},
        reader_{kMaxHelloBytes} {}

  void start(ConnectionEvents events) override {
    events_ = std::move(events);
    opened_ = last_received_ = last_sent_ = last_taken_ = last_judged_ = window_began_ = now();
    read();
    tick();
  }

  void set_events(ConnectionEvents events) override {
    if (state_ == State::Open) events_ = std::move(events);
  }

  Result<void> send(const Frame& frame) override {
    if (state_ != State::Open) return fail(ErrorCode::Unreachable, "the connection is closed");
    auto bytes = to_bytes(frame);
    if (!bytes) return tl::unexpected{bytes.error()};
    if (queued_bytes() + bytes->size() > limits_.max_queue_bytes)
      return fail(ErrorCode::TooLarge, fmt::format("{} takes its bytes too slowly", peer_.address));
    queue(std::move(*bytes));
    return {};
  }

  std::size_t queued_bytes() const override { return waiting_.size() + (is_writing_ ? writing_.size() : 0); }
  void set_ready() override {
    is_ready_ = true;
    reader_.set_max_body(kMaxBodyBytes);
  }
  void close(const std::optional<Frame>& last_words) override {
    if (state_ != State::Open) return;
    if (last_words)
      if (auto bytes = to_bytes(*last_words)) queue(std::move(*bytes));
    events_ = {};
    state_ = State::Draining;
    drain_until_ = now() + std::min<Nanoseconds>(limits_.write_within, std::chrono::seconds{2});
    if (!is_writing_) half_close();
  }
  bool is_ready() const override { return is_ready_; }
  void drop(const Error& why) override {
    if (state_ == State::Open) end(why);
  }
  const Peer& peer() const override { return peer_; }
  std::uint64_t bytes_sent() const override { return sent_; }
  std::uint64_t bytes_received() const override { return received_; }

 private:
  using Code = boost::system::error_code;
  enum class State : std::uint8_t { Open, Draining, Closed };

  [[nodiscard]] Nanoseconds now() const { return clock_.now(); }

  void queue(std::vector<std::byte> bytes) {
    waiting_.insert(waiting_.end(), bytes.begin(), bytes.end());
    if (!is_writing_) write();
  }

  void write() {
    writing_.clear();
    std::swap(writing_, waiting_);
    is_writing_ = true;
    written_ = 0;
    write_more();
  }

  void write_more() {
    const auto rest = boost::asio::buffer(writing_.data() + written_, writing_.size() - written_);
    stream_.async_write_some(rest, [self = this->shared_from_this()](const Code& error, std::size_t size) {
      if (self->state_ == State::Closed) return;
      if (error) return self->lose(error);
      self->written_ += size;
      self->sent_ += size;
      self->last_sent_ = self->last_taken_ = self->now();
      if (self->written_ < self->writing_.size()) return self->write_more();
      self->is_writing_ = false;
      if (!self->waiting_.empty()) return self->write();
      if (self->state_ == State::Draining) return self->half_close();
      if (const auto handler = self->events_.drained) handler();
    });
    if (written_ == 0) last_taken_ = now();
  }

  void read() {
    stream_.async_read_some(boost::asio::buffer(buffer_),
                            [self = this->shared_from_this()](const Code& error, std::size_t size) {
                              if (self->state_ == State::Closed) return;
                              if (error) return self->lose(error);
                              self->on_bytes(size);
                            });
  }

  void on_bytes(std::size_t size) {
    received_ += size;
    last_received_ = now();
    window_bytes_ += size;
    if (state_ == State::Open) {
      // The time of a frame begins with its first byte, however long the silence before was.
      if (!reader_.is_inside_frame()) inside_since_ = now();
      reader_.feed(std::span{buffer_}.first(size));
      if (!take_frames()) return;
    }
    const Nanoseconds pause = pause_for_rate();
    if (pause <= Nanoseconds{0}) return read();
    slow_.start(pause, [self = this->shared_from_this()] {
      if (self->state_ != State::Closed) self->read();
    });
  }

  /// False when nothing is to be read any more; what comes behind last words is read and dropped, so that the peer's
  /// own close is seen and does not have to be waited for.
  bool take_frames() {
    const auto self = this->shared_from_this();
    while (state_ == State::Open) {
      auto frame = reader_.take();
      if (!frame) {
        end(frame.error());
        return state_ != State::Closed;
      }
      if (!*frame) break;
      inside_since_ = now();
      ++window_frames_;
      if ((*frame)->type == FrameType::Ping) {
        queue(to_bytes(Frame{FrameType::Pong, {}}).value());
      } else if ((*frame)->type != FrameType::Pong) {
        // The handler may replace or drop the events while it runs.
        const auto handler = events_.frame;
        if (handler) handler(std::move(**frame));
      }
    }
    return state_ != State::Closed;
  }

  /// How long to wait so that neither bytes nor frames come faster than the limits allow.
  Nanoseconds pause_for_rate() {
    const double seconds = std::chrono::duration<double>(now() - window_began_).count();
    const double due = std::max(static_cast<double>(window_bytes_) / static_cast<double>(limits_.max_bytes_per_s),
                                static_cast<double>(window_frames_) / static_cast<double>(limits_.max_frames_per_s));
    if (seconds > 1 && due <= seconds) {
      window_began_ = now();
      window_bytes_ = window_frames_ = 0;
    }
    return due <= std::max(seconds, 0.1) ? Nanoseconds{0}
                                         : Nanoseconds{static_cast<std::int64_t>((due - seconds) * 1e9)};
  }

  void tick() {
    const Nanoseconds shortest = std::min({limits_.handshake_within, limits_.frame_within, limits_.idle_after,
                                           limits_.write_within, limits_.judge_every});
    tick_.start(std::clamp<Nanoseconds>(shortest / 4, std::chrono::milliseconds{10}, std::chrono::seconds{1}),
                [self = this->shared_from_this()] {
                  if (self->state_ == State::Closed) return;
                  self->look_at_clocks();
                  if (self->state_ != State::Closed) self->tick();
                });
  }

  void look_at_clocks() {
    const Nanoseconds t = now();
    if (state_ == State::Draining) {
      if (t > drain_until_) shut();
      return;
    }
    if (trust_ && t - last_judged_ >= limits_.judge_every) {
      last_judged_ = t;
      const auto still = trust_->judge(peer_.certificate_pem, clock_.wall());
      if (!still)
        return end({still.error().code, fmt::format("{} ({}): {}", peer_.name, peer_.address, still.error().what)});
    }
    if (!is_ready_ && t - opened_ > limits_.handshake_within)
      return end({ErrorCode::Unreachable, "handshake-time: no hello came in time"});
    if (reader_.is_inside_frame() && t - inside_since_ > limits_.frame_within)
      return end({ErrorCode::Unreachable, "frame-time: a frame was begun and not finished in time"});
    if (t - last_received_ > limits_.idle_after)
      return end({ErrorCode::Unreachable, "idle-time: nothing was heard for too long"});
    if (is_writing_ && t - last_taken_ > limits_.write_within)
      return end({ErrorCode::Unreachable, "write-time: the other side takes no bytes"});
    // By what was sent last: who only listens would otherwise never send, and be dropped as silent.
    if (is_ready_ && t - last_sent_ > limits_.idle_after / 3 && !is_writing_)
      queue(to_bytes(Frame{FrameType::Ping, {}}).value());
  }

  void lose(const Code& error) {
    if (state_ == State::Draining) {
      // The last words still go out to a peer that has ended its own side only.
      is_peer_done_ = error == boost::asio::error::eof && is_writing_;
      return is_peer_done_ ? void() : shut();
    }
    const bool is_end = error == boost::asio::error::eof || error == boost::asio::error::connection_reset ||
                        error == boost::asio::ssl::error::stream_truncated;
    const auto code = error.category() == boost::asio::error::get_ssl_category() && !is_ready_ ? ErrorCode::NotTrusted
                                                                                               : ErrorCode::Unreachable;
    const std::string why = is_ready_ ? std::string{} : why_ended(stream_, error, own_end_, is_end && received_ == 0);
    end({code, !why.empty() ? why
               : is_end     ? "the other side closed the connection"
                            : "the connection broke: " + error.message()});
  }

  /// The event may close the connection with last words of its own; otherwise it is shut.
  void end(const Error& why) {
    const auto self = this->shared_from_this();
    const auto closed = std::exchange(events_, {}).closed;
    if (closed) closed(why);
    if (state_ == State::Open) shut();
  }

  /// Nothing more to say. The peer's own close, or a deadline, ends it: closing at once could destroy the last words.
  void half_close() {
    if (is_peer_done_) return shut();
    Code ignored;
    stream_.lowest_layer().shutdown(boost::asio::ip::tcp::socket::shutdown_send, ignored);
  }

  void shut() {
    state_ = State::Closed;
    tick_.cancel();
    slow_.cancel();
    Code ignored;
    stream_.lowest_layer().close(ignored);
  }

  const Clock& clock_;
  Stream stream_;
  bool is_peer_done_ = false;
  LoopTimer tick_;
  LoopTimer slow_;
  Peer peer_;
  ConnectionLimits limits_;
  std::shared_ptr<Trust> trust_;
  End own_end_;
  ConnectionEvents events_;
  FrameReader reader_;
  State state_ = State::Open;
  bool is_ready_ = false;
  bool is_writing_ = false;
  std::array<std::byte, 64U << 10U> buffer_{};
  std::vector<std::byte> waiting_;
  std::vector<std::byte> writing_;
  std::size_t written_ = 0;
  std::uint64_t sent_ = 0;
  std::uint64_t received_ = 0;
  std::uint64_t window_bytes_ = 0;
  std::uint64_t window_frames_ = 0;
  Nanoseconds opened_{}, last_received_{}, last_sent_{}, last_taken_{}, inside_since_{}, last_judged_{},
      window_began_{}, drain_until_{};
};

}  // namespace telefab::net
