// SPDX-License-Identifier: GPL-3.0-or-later
#include "console.hpp"

#include <fcntl.h>
#include <linux/kd.h>
#include <sys/ioctl.h>

#include <cerrno>
#include <string_view>

namespace telefab::fab {

Console::Console() : terminal_{::open("/dev/tty0", O_WRONLY | O_NOCTTY | O_CLOEXEC)} {
  if (terminal_.get() < 0) {
    state_ = errno == EACCES || errno == EPERM ? State::NotPermitted : State::NotThere;
    return;
  }
  constexpr std::string_view kClear = "\033[?25l\033[2J\033[H";
  if (::write(terminal_.get(), kClear.data(), kClear.size()) != static_cast<ssize_t>(kClear.size())) {
    state_ = State::NotPermitted;
    return;
  }
  state_ = ::ioctl(terminal_.get(), KDSETMODE, KD_GRAPHICS) == 0 ? State::Silent : State::Cleared;
}

Console::~Console() {
  if (state_ == State::Silent) (void)::ioctl(terminal_.get(), KDSETMODE, KD_TEXT);
}

}  // namespace telefab::fab
