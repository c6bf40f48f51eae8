// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <telefab/test/loopback.hpp>

// `telefab-fab simulate-usb` as a process of its own.

namespace {

struct Simulator {
  Simulator() {
    std::array<int, 2> pipe{};
    if (::pipe(pipe.data()) != 0) std::abort();
    const char* bin = std::getenv("TELEFAB_BIN");
    const std::string program = std::string{bin != nullptr ? bin : "."} + "/telefab-fab";
    child = ::fork();
    if (child == 0) {
      ::dup2(pipe[1], STDOUT_FILENO);
      ::execl(program.c_str(), program.c_str(), "simulate-usb", "--port", "0", nullptr);
      ::_exit(127);
    }
    ::close(pipe[1]);
    out = ::fdopen(pipe[0], "r");
    std::array<char, 256> line{};
    if (std::fgets(line.data(), line.size(), out) != nullptr) first_line = line.data();
    port = static_cast<std::uint16_t>(std::atoi(first_line.substr(first_line.rfind(':') + 1).c_str()));
  }
  /// Ends it as systemd would; its exit code.
  int stop() {
    ::kill(child, SIGTERM);
    int status = 0;
    ::waitpid(child, &status, 0);
    child = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  ~Simulator() {
    if (child > 0) (void)stop();
    std::fclose(out);
  }
  [[nodiscard]] int connect_to() const {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_in where = telefab::test::loopback(port);
    return ::connect(fd, reinterpret_cast<const sockaddr*>(&where), sizeof where) == 0 ? fd : -1;
  }
  pid_t child = -1;
  std::FILE* out = nullptr;
  std::string first_line;
  std::uint16_t port = 0;
};

std::string receive(int fd, std::size_t bytes) {
  std::string got(bytes, '\0');
  std::size_t n = 0;
  while (n < bytes) {
    const ssize_t more = ::recv(fd, got.data() + n, bytes - n, 0);
    if (more <= 0) break;
    n += static_cast<std::size_t>(more);
  }
  got.resize(n);
  return got;
}

std::string import_request(const char* id) {
  std::string request{"\x01\x11\x80\x03\0\0\0\0", 8};
  request += id;
  request.resize(40);
  return request;
}

TEST(SimulateUsb, OffersItsDevicesOverTcpAndStopsOnRequest) {
  Simulator simulator;
  ASSERT_NE(simulator.port, 0) << simulator.first_line;
  const int fd = simulator.connect_to();
  ASSERT_GE(fd, 0);
  const std::string request = import_request("1-1");
  ASSERT_EQ(::send(fd, request.data(), request.size(), 0), 40);
  const std::string reply = receive(fd, 320);
  ASSERT_EQ(reply.size(), 320u);
  EXPECT_EQ(reply.substr(8 + 256, 3), "1-1");
  ::close(fd);
  EXPECT_EQ(simulator.stop(), 0);
}

TEST(SimulateUsb, AppearsInTheKernelWhereThereIsAVirtualHost) {
  const std::filesystem::path host = "/sys/devices/platform/vhci_hcd.0";
  if (!std::filesystem::exists(host / "attach") || ::geteuid() != 0)
    GTEST_SKIP() << "skipped: no vhci_hcd in this kernel, or not root (try: modprobe vhci-hcd)";
  Simulator simulator;
  const int fd = simulator.connect_to();
  ASSERT_GE(fd, 0);
  const std::string request = import_request("1-1");
  ASSERT_EQ(::send(fd, request.data(), request.size(), 0), 40);
  ASSERT_EQ(receive(fd, 320).size(), 320u);
  // port, socket, device id, speed (2: full)
  std::ofstream{host / "attach"} << "0 " << fd << " " << (1 << 16 | 1) << " 2";
  bool found = false;
  for (int i = 0; i < 50 && !found; ++i) {
    ::usleep(100'000);
    for (const auto& entry : std::filesystem::directory_iterator{"/sys/bus/usb/devices"}) {
      std::string product;
      std::ifstream{entry.path() / "product"} >> product;
      found = found || product == "DLPC900";
    }
  }
  std::ofstream{host / "detach"} << "0";
  ::close(fd);
  EXPECT_TRUE(found);
}

}  // namespace
