// SPDX-License-Identifier: GPL-3.0-or-later
#include "pty_host.hpp"

#include <fcntl.h>
#include <poll.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cstdlib>

namespace telefab::test {

PtyHost::PtyHost(fab::LineModel& model, std::mutex& mutex) {
  master_ = ::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK);
  if (master_ < 0 || ::grantpt(master_) != 0 || ::unlockpt(master_) != 0) std::abort();
  path_ = ::ptsname(master_);
  termios raw{};
  (void)::tcgetattr(master_, &raw);
  ::cfmakeraw(&raw);
  (void)::tcsetattr(master_, TCSANOW, &raw);
  // Held open, so that the line stays there between two programs.
  slave_ = ::open(path_.c_str(), O_RDWR | O_NOCTTY | O_CLOEXEC);
  thread_ = std::thread{[this, &model, &mutex] {
    while (!stop_) {
      pollfd p{master_, POLLIN, 0};
      (void)::poll(&p, 1, 2);
      std::array<char, 256> bytes{};
      const ssize_t n = ::read(master_, bytes.data(), bytes.size());
      const std::lock_guard lock{mutex};
      if (n > 0) (void)model.receive({bytes.data(), static_cast<std::size_t>(n)});
      const std::string out = model.transmit();
      if (!out.empty()) (void)!::write(master_, out.data(), out.size());  // nobody listens: lost, as on a real line
    }
  }};
}

PtyHost::~PtyHost() {
  stop_ = true;
  thread_.join();
  ::close(slave_);
  ::close(master_);
}

}  // namespace telefab::test
