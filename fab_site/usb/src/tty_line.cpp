// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <libudev.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <telefab/base/clock.hpp>
#include <telefab/fab/usb/tty_line.hpp>
#include <vector>

namespace telefab::fab {

namespace {

constexpr std::size_t kLongestLine = 4096;

struct SerialPort {
  std::string path, serial, product;
};

std::string text_or_empty(const char* text) { return text != nullptr ? text : ""; }

/// Every serial port that sits on USB, with what its adapter calls itself.
std::vector<SerialPort> usb_serial_ports() {
  std::vector<SerialPort> ports;
  udev* u = udev_new();
  if (u == nullptr) return ports;
  udev_enumerate* list = udev_enumerate_new(u);
  udev_enumerate_add_match_subsystem(list, "tty");
  udev_enumerate_scan_devices(list);
  for (udev_list_entry* e = udev_enumerate_get_list_entry(list); e != nullptr; e = udev_list_entry_get_next(e)) {
    udev_device* tty = udev_device_new_from_syspath(u, udev_list_entry_get_name(e));
    if (tty == nullptr) continue;
    udev_device* usb = udev_device_get_parent_with_subsystem_devtype(tty, "usb", "usb_device");
    if (usb != nullptr && udev_device_get_devnode(tty) != nullptr)
      ports.push_back({udev_device_get_devnode(tty), text_or_empty(udev_device_get_sysattr_value(usb, "serial")),
                       text_or_empty(udev_device_get_sysattr_value(usb, "product"))});
    udev_device_unref(tty);
  }
  udev_enumerate_unref(list);
  udev_unref(u);
  return ports;
}

Result<std::string> path_of(const std::string& which) {
  if (which.starts_with('/')) return which;
  std::vector<SerialPort> fitting;
  std::string seen;
  for (const SerialPort& port : usb_serial_ports()) {
    seen += fmt::format("\n  {} serial '{}' ({})", port.path, port.serial, port.product);
    if (which.empty() || port.serial == which) fitting.push_back(port);
  }
  if (fitting.size() == 1) return fitting[0].path;
  if (fitting.empty())
    return fail(ErrorCode::DeviceLost,
                fmt::format("stage: no USB serial port{}; look at its cable and power. Found:{}",
                            which.empty() ? "" : " with serial " + which, seen.empty() ? " none" : seen));
  return fail(ErrorCode::DeviceLost,
              fmt::format("stage: more than one USB serial port; name one in devices.stage_serial. Found:{}", seen));
}

class TtyLine final : public LineTransport {
 public:
  explicit TtyLine(std::string which) : which_{std::move(which)} {}
  ~TtyLine() override { close_port(); }

  Result<void> write(std::string_view bytes, Milliseconds timeout) override {
    const Nanoseconds until = clock_.now() + timeout;
    while (!bytes.empty()) {
      if (fd_ < 0) return fail(ErrorCode::DeviceLost, "stage: its serial port is not open");
      const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
      if (n > 0) {
        bytes.remove_prefix(static_cast<std::size_t>(n));
        continue;
      }
      if (n < 0 && errno != EAGAIN && errno != EINTR) return gone("writing");
      if (clock_.now() >= until) return fail(ErrorCode::DeviceTimeout, "stage: its serial port takes no bytes");
      wait_for(POLLOUT, until);
    }
    return {};
  }

  Result<std::optional<std::string>> read_line(Milliseconds timeout) override {
    const Nanoseconds until = clock_.now() + timeout;
    while (true) {
      while (!buffer_.empty() && (buffer_.front() == '\r' || buffer_.front() == '\n')) buffer_.erase(0, 1);
      if (const std::size_t end = buffer_.find_first_of("\r\n"); end != std::string::npos) {
        std::string line = buffer_.substr(0, end);
        buffer_.erase(0, end + 1);
        return line;
      }
      if (buffer_.size() > kLongestLine) {
        buffer_.clear();
        return fail(ErrorCode::ProtocolBroken, "stage: a line without end on its serial port");
      }
      if (fd_ < 0) return fail(ErrorCode::DeviceLost, "stage: its serial port is not open");
      std::array<char, 512> chunk{};
      const ssize_t n = ::read(fd_, chunk.data(), chunk.size());
      if (n > 0) {
        buffer_.append(chunk.data(), static_cast<std::size_t>(n));
        continue;
      }
      if (n < 0 && errno != EAGAIN && errno != EINTR) return gone("reading");
      if (n == 0 && hung_up()) return gone("reading");
      if (clock_.now() >= until) return std::nullopt;
      wait_for(POLLIN, until);
    }
  }

  Result<void> reopen() override {
    close_port();
    buffer_.clear();
    const auto path = path_of(which_);
    if (!path) return tl::unexpected{path.error()};
    path_ = *path;
    fd_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (fd_ < 0)
      return fail(
          ErrorCode::DeviceLost,
          fmt::format("stage: cannot open {}: {}{}", path_, std::strerror(errno),
                      errno == EACCES ? "; join the group dialout or install deploy/udev/70-telefab.rules" : ""));
    termios settings{};
    (void)::ioctl(fd_, TIOCEXCL);  // where the line knows it; others simply are not exclusive
    if (::tcgetattr(fd_, &settings) != 0) return gone("setting up");
    ::cfmakeraw(&settings);
    settings.c_cflag |= CLOCAL | CREAD;
    settings.c_cflag &= ~static_cast<tcflag_t>(CRTSCTS | CSTOPB | PARENB);
    settings.c_cc[VMIN] = 0;
    settings.c_cc[VTIME] = 0;
    ::cfsetspeed(&settings, B115200);
    if (::tcsetattr(fd_, TCSANOW, &settings) != 0) return gone("setting up");
    return {};
  }

  std::string describe() const override { return "serial port " + path_ + "\n"; }

 private:
  tl::unexpected<Error> gone(std::string_view operation) {
    const int reason = errno;
    close_port();
    return fail(ErrorCode::DeviceLost, fmt::format("stage: {} {}: {}", operation, path_, std::strerror(reason)));
  }
  void close_port() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }
  void wait_for(short what, Nanoseconds until) const {
    pollfd p{fd_, what, 0};
    const auto ms = std::chrono::ceil<Milliseconds>(until - clock_.now()).count();
    (void)::poll(&p, 1, static_cast<int>(std::max<Milliseconds::rep>(ms, 0)));
  }
  bool hung_up() const {
    pollfd p{fd_, POLLIN, 0};
    return ::poll(&p, 1, 0) > 0 && (p.revents & (POLLHUP | POLLERR | POLLNVAL)) != 0;
  }

  std::string which_, path_, buffer_;
  int fd_ = -1;
  SystemClock clock_;
};

}  // namespace

Result<std::unique_ptr<LineTransport>> open_tty(const std::string& which) {
  auto line = std::make_unique<TtyLine>(which);
  if (const auto ok = line->reopen(); !ok) return tl::unexpected{ok.error()};
  return line;
}

}  // namespace telefab::fab
