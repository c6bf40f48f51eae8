// SPDX-License-Identifier: GPL-3.0-or-later
#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <list>
#include <memory>
#include <telefab/base/clock.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/usbip_session.hpp>

#include "verbs.hpp"

namespace telefab::fab {

namespace {

/// A socket, closed with its owner.
class Socket {
 public:
  explicit Socket(int fd) : fd_{fd} {}
  ~Socket() {
    if (fd_ >= 0) ::close(fd_);
  }
  Socket(Socket&& other) noexcept : fd_{std::exchange(other.fd_, -1)} {}
  Socket& operator=(Socket&&) = delete;
  [[nodiscard]] int fd() const { return fd_; }

 private:
  int fd_;
};

struct Client {
  Socket socket;
  UsbIpSession session;
  std::vector<std::byte> unsent;
  bool gone = false;

  void read_some() {
    std::array<std::byte, 16384> bytes{};
    const ssize_t n = ::recv(socket.fd(), bytes.data(), bytes.size(), MSG_DONTWAIT);
    if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) gone = true;
    if (n <= 0) return;
    if (const auto ok = session.feed({bytes.data(), static_cast<std::size_t>(n)}); !ok) {
      write_note(fmt::format("client refused: {}\n", ok.error().what));
      gone = true;
    }
  }
  void write_some() {
    const auto fresh = session.take();
    unsent.insert(unsent.end(), fresh.begin(), fresh.end());
    if (unsent.empty()) return;
    const ssize_t n = ::send(socket.fd(), unsent.data(), unsent.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    if (n > 0) unsent.erase(unsent.begin(), unsent.begin() + n);
    if (n < 0 && errno != EAGAIN && errno != EINTR) gone = true;
  }
};

Result<Socket> listen_on(const std::string& address, std::uint16_t port) {
  const auto failed = [&] {
    return fail(ErrorCode::Unreachable, fmt::format("cannot listen on {}:{}: {}", address, port, std::strerror(errno)));
  };
  Socket socket{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)};
  const int on = 1;
  sockaddr_in where{};
  where.sin_family = AF_INET;
  where.sin_port = htons(port);
  if (::inet_pton(AF_INET, address.c_str(), &where.sin_addr) != 1)
    return fail(ErrorCode::InvalidInput, address + " is not an IPv4 address");
  if (socket.fd() < 0 || ::setsockopt(socket.fd(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
      ::bind(socket.fd(), reinterpret_cast<const sockaddr*>(&where), sizeof where) != 0 ||
      ::listen(socket.fd(), 4) != 0)
    return failed();
  return socket;
}

std::uint16_t port_of(const Socket& socket) {
  sockaddr_in where{};
  socklen_t size = sizeof where;
  (void)::getsockname(socket.fd(), reinterpret_cast<sockaddr*>(&where), &size);
  return ntohs(where.sin_port);
}

}  // namespace

VerbBody declare_simulate_usb(VerbOptions& options) {
  struct Options {
    std::string address = "127.0.0.1";
    std::uint16_t port = 3240;
    std::uint32_t dmd = 1;
    std::uint32_t firmware = 6;
    double top_mm = 125;
  };
  auto o = std::make_shared<Options>();
  options.add("--address", o->address, "where to listen; anybody who can connect can use the devices").shows_default();
  options.add("--port", o->port, "0: any free one").shows_default();
  options.add("--dmd", o->dmd, "mirror array: 1 DLP6500, 2 DLP9000, 3 DLP670S, 4 DLP500YX")
      .shows_default()
      .within(1, 4);
  options.add("--firmware", o->firmware, "major version of the projector").shows_default().within(4, 6);
  options.add("--top-mm", o->top_mm, "gap of the stage after homing").shows_default().within(1.0, 1000.0);
  return [o](std::stop_token stop) -> Result<ExitCode> {
    auto listener = listen_on(o->address, o->port);
    if (!listener) return tl::unexpected{listener.error()};
    SystemClock clock;
    MachineLog log;
    Dlpc900Model projector{static_cast<std::uint8_t>(o->dmd), static_cast<std::uint8_t>(o->firmware), clock, &log};
    GrblModel stage{o->top_mm, clock, &log};
    const auto projector_peer = make_projector_peer(projector, "SIM-PROJECTOR");
    const auto stage_peer = make_stage_peer(stage, "SIM-STAGE");
    write_output(
        fmt::format("simulated DLPC900 (1-1) and GRBL stage (1-2) on {}:{}\n", o->address, port_of(*listener)));
    write_output(
        fmt::format("attach as root: modprobe vhci-hcd; usbip attach -r {} -b 1-1; usbip attach -r {} -b 1-2\n",
                    o->address, o->address));
    (void)flush_output();  // whoever waits for these lines; run_program tells of a failure
    std::list<Client> clients;
    while (!stop.stop_requested()) {
      std::vector<pollfd> watched{{listener->fd(), POLLIN, 0}};
      for (const Client& c : clients) watched.push_back({c.socket.fd(), POLLIN, 0});
      (void)::poll(watched.data(), watched.size(), clients.empty() ? 100 : 1);
      if ((watched[0].revents & POLLIN) != 0) {
        Socket accepted{::accept4(listener->fd(), nullptr, nullptr, SOCK_CLOEXEC)};
        const int on = 1;
        if (accepted.fd() >= 0) {
          (void)::setsockopt(accepted.fd(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
          clients.push_back({std::move(accepted), UsbIpSession{{projector_peer.get(), stage_peer.get()}}, {}, false});
        }
      }
      projector.tick();
      stage.tick();
      for (Client& c : clients) {
        c.read_some();
        c.session.advance();
        c.write_some();
      }
      std::erase_if(clients, [](const Client& c) { return c.gone; });
    }
    write_output(fmt::format("light while the platform moved: {:.3f} s; exposures: {}\n",
                             double(log.light_while_moving().count()) * 1e-9, log.light().size()));
    return ExitCode::Ok;
  };
}

}  // namespace telefab::fab
