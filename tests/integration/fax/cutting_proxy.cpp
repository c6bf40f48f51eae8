// SPDX-License-Identifier: GPL-3.0-or-later
#include "cutting_proxy.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <stdexcept>
#include <telefab/test/loopback.hpp>

namespace telefab::test {
namespace {

constexpr int kLookForStopMs = 20;

}  // namespace

CuttingProxy::CuttingProxy(std::string to_port, std::uint32_t seed, int cuts, std::uint32_t longest_bytes)
    : listener_{::socket(AF_INET, SOCK_STREAM, 0)},
      to_port_{std::move(to_port)},
      random_{seed},
      cuts_{cuts},
      longest_bytes_{longest_bytes} {
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), size) != 0 || ::listen(listener_, 8) != 0 ||
      ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0)
    throw std::runtime_error{"the proxy cannot listen"};
  port_ = std::to_string(ntohs(address.sin_port));
  thread_ = std::jthread{[this](std::stop_token stop) { run(std::move(stop)); }};
}

CuttingProxy::~CuttingProxy() {
  thread_.request_stop();
  thread_.join();
  ::close(listener_);
}

void CuttingProxy::run(std::stop_token stop) {
  while (!stop.stop_requested()) {
    pollfd waiting{listener_, POLLIN, 0};
    if (::poll(&waiting, 1, kLookForStopMs) <= 0) continue;
    const int near = ::accept(listener_, nullptr, nullptr);
    const int far = ::socket(AF_INET, SOCK_STREAM, 0);
    const sockaddr_in address = loopback(static_cast<std::uint16_t>(std::stoi(to_port_)));
    if (::connect(far, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
      const bool is_to_be_cut = made_ < cuts_;
      hand_on(near, far, is_to_be_cut ? 1 + random_() % longest_bytes_ : UINT64_MAX, stop);
      if (is_to_be_cut) ++made_;
    }
    cut(near);
    cut(far);
  }
}

void CuttingProxy::hand_on(int near, int far, std::uint64_t budget, const std::stop_token& stop) {
  std::array<char, 2048> buffer{};
  while (budget > 0 && !stop.stop_requested()) {
    std::array<pollfd, 2> both{{{near, POLLIN, 0}, {far, POLLIN, 0}}};
    if (::poll(both.data(), both.size(), kLookForStopMs) <= 0) continue;
    for (const auto& [from, to] : {std::pair{both[0], far}, std::pair{both[1], near}}) {
      if (from.revents == 0 || budget == 0) continue;
      const ssize_t got = ::recv(from.fd, buffer.data(), std::min<std::uint64_t>(buffer.size(), budget), 0);
      if (got <= 0 || ::send(to, buffer.data(), static_cast<std::size_t>(got), MSG_NOSIGNAL) != got) return;
      budget -= static_cast<std::uint64_t>(got);
    }
  }
}

}  // namespace telefab::test
