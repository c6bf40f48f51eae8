// SPDX-License-Identifier: GPL-3.0-or-later
#include "line_proxy.hpp"

#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <deque>
#include <stdexcept>
#include <telefab/test/loopback.hpp>
#include <telefab/wire/message.hpp>

namespace telefab::test {
namespace {

using Time = std::chrono::steady_clock::time_point;
constexpr std::size_t kPacket = 1448;
constexpr std::size_t kMostOnTheLine = 1U << 20U;

Time::duration seconds(double s) {
  return std::chrono::duration_cast<Time::duration>(std::chrono::duration<double>(s));
}

/// One direction: packets with the moment they come out.
struct Way {
  struct Packet {
    Time due;
    std::vector<std::byte> bytes;
  };
  int from = -1;
  int to = -1;
  std::deque<Packet> packets;
  std::size_t waiting = 0;
  Time free{};  ///< when the line takes the next packet
  Time last{};
  FrameReader frames;
};

}  // namespace

LineProxy::LineProxy(std::uint16_t to_port, const Line& line)
    : listener_{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)}, to_port_{to_port}, line_{line}, random_{line.seed} {
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 || ::listen(listener_, 8) != 0 ||
      ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0)
    throw std::runtime_error{"the proxy cannot listen"};
  port_ = ntohs(address.sin_port);
  thread_ = std::jthread{[this](const std::stop_token& stop) { run(stop); }};
}

LineProxy::~LineProxy() {
  thread_.request_stop();
  thread_.join();
  ::close(listener_);
}

LineCount LineProxy::count() const {
  const std::lock_guard lock{mutex_};
  return count_;
}

void LineProxy::run(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    pollfd waiting{listener_, POLLIN, 0};
    if (::poll(&waiting, 1, 20) <= 0) continue;
    const int near = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
    const int far = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_in address = loopback(to_port_);
    const int on = 1;
    for (const int fd : {near, far}) ::setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (::connect(far, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
      {
        const std::lock_guard lock{mutex_};
        ++count_.connections;
      }
      hand_on(near, far, stop);
    }
    cut(near);
    cut(far);
  }
}

void LineProxy::hand_on(int near, int far, const std::stop_token& stop) {
  const bool is_to_be_cut = count().cuts < line_.cuts;
  std::uint64_t budget = is_to_be_cut ? 1 + random_() % line_.longest_bytes : UINT64_MAX;
  std::array<Way, 2> ways;
  ways[0].from = ways[1].to = near;
  ways[0].to = ways[1].from = far;
  const auto look = [&](Way& way, bool is_up, std::span<const std::byte> bytes) {
    const std::lock_guard lock{mutex_};
    (is_up ? count_.bytes_up : count_.bytes_down) += bytes.size();
    way.frames.feed(bytes);
    while (auto frame = way.frames.take()) {
      if (!*frame) break;
      const auto message = from_frame(**frame);
      if (!message) continue;
      if (const auto* chunk = std::get_if<SendChunk>(&*message)) {
        ++count_.chunks;
        count_.chunk_bytes += kFrameHeaderBytes + (*frame)->body.size();
        if (chunk->sequence < kept_[chunk->job]) ++count_.kept_again;
        if (chunk->sequence < sent_[chunk->job]) ++count_.chunks_again;
        sent_[chunk->job] = std::max(sent_[chunk->job], chunk->sequence + 1);
      }
      if (const auto* kept = std::get_if<ChunkStored>(&*message))
        kept_[kept->job] = std::max(kept_[kept->job], kept->sequence + 1);
    }
  };
  while (!stop.stop_requested()) {
    const Time now = std::chrono::steady_clock::now();
    int wait_ms = 20;
    for (Way& way : ways) {
      while (!way.packets.empty() && way.packets.front().due <= now) {
        const auto& bytes = way.packets.front().bytes;
        if (::send(way.to, bytes.data(), bytes.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(bytes.size())) return;
        way.waiting -= bytes.size();
        way.packets.pop_front();
      }
      if (!way.packets.empty()) {
        const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(way.packets.front().due - now);
        wait_ms = std::min(wait_ms, static_cast<int>(left.count()) + 1);
      }
    }
    std::array<pollfd, 2> both{};
    for (std::size_t i = 0; i < 2; ++i)
      both[i] = {ways[i].from, static_cast<short>(ways[i].waiting < kMostOnTheLine ? POLLIN : 0), 0};
    if (::poll(both.data(), both.size(), wait_ms) <= 0) continue;
    for (std::size_t i = 0; i < 2; ++i) {
      if (both[i].revents == 0) continue;
      Way& way = ways[i];
      Way::Packet packet;
      packet.bytes.resize(std::min<std::uint64_t>(kPacket, budget));
      const ssize_t got = ::recv(way.from, packet.bytes.data(), packet.bytes.size(), 0);
      if (got <= 0) return;
      packet.bytes.resize(static_cast<std::size_t>(got));
      look(way, i == 0, packet.bytes);
      const Time at = std::chrono::steady_clock::now();
      way.free = std::max(way.free, at);
      if (line_.bits_per_s > 0) way.free += seconds(8.0 * static_cast<double>(got) / line_.bits_per_s);
      packet.due = way.free + seconds(line_.one_way_ms / 1000);
      if (line_.loss > 0 && static_cast<double>(random_() % 1'000'000) < line_.loss * 1e6)
        packet.due += seconds(2 * line_.one_way_ms / 1000);
      packet.due = way.last = std::max(packet.due, way.last);
      way.waiting += packet.bytes.size();
      way.packets.push_back(std::move(packet));
      budget -= static_cast<std::uint64_t>(got);
      if (budget == 0) {
        const std::lock_guard lock{mutex_};
        ++count_.cuts;
        return;
      }
    }
  }
}

}  // namespace telefab::test
