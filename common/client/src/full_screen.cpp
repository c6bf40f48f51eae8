// SPDX-License-Identifier: GPL-3.0-or-later
#include "full_screen.hpp"

#include <poll.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <string_view>

#include "watch_screen.hpp"

namespace telefab::client {
namespace {

// Alternate screen, no cursor, no line wrap; and back.
constexpr std::string_view kEnter = "\x1b[?1049h\x1b[?25l\x1b[?7l\x1b[2J";
constexpr std::string_view kLeave = "\x1b[?7h\x1b[?25h\x1b[?1049l";
// The terminal may wait with drawing until the piece is whole.
constexpr std::string_view kBeginPiece = "\x1b[?2026h";
constexpr std::string_view kEndPiece = "\x1b[?2026l";

constexpr std::array kEndings{SIGHUP, SIGQUIT, SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGABRT};

/// What a signal handler must know; set while a FullScreen lives.
struct Before {
  termios settings{};
  volatile sig_atomic_t is_entered = 0;
};
Before& before() {
  static Before value;
  return value;
}

void write_all(std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = ::write(STDOUT_FILENO, text.data(), text.size());
    if (written <= 0) return;  // the terminal is gone; there is nobody to tell
    text.remove_prefix(static_cast<std::size_t>(written));
  }
}

/// Only calls that a signal handler may make.
void restore() {
  if (!before().is_entered) return;
  before().is_entered = 0;
  write_all(kLeave);
  ::tcsetattr(STDIN_FILENO, TCSANOW, &before().settings);
}

void on_ending(int signal) {
  restore();
  ::raise(signal);  // with the default action, see SA_RESETHAND
}

}  // namespace

bool FullScreen::is_possible() {
  const char* term = std::getenv("TERM");
  return ::isatty(STDIN_FILENO) == 1 && ::isatty(STDOUT_FILENO) == 1 && term && std::string_view{term} != "dumb" &&
         *term != '\0';
}

FullScreen::FullScreen() {
  if (::tcgetattr(STDIN_FILENO, &before().settings) != 0) return;
  before().is_entered = 1;
  std::atexit(restore);
  std::at_quick_exit(restore);
  struct sigaction action {};
  action.sa_handler = on_ending;
  action.sa_flags = static_cast<int>(SA_RESETHAND | SA_NODEFER);
  for (const int signal : kEndings) ::sigaction(signal, &action, nullptr);
  termios quiet = before().settings;
  quiet.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  quiet.c_cc[VMIN] = 0;
  quiet.c_cc[VTIME] = 0;
  // A stopped program would leave its screen behind; SIGINT still ends it as everywhere.
  quiet.c_cc[VSUSP] = quiet.c_cc[VQUIT] = _POSIX_VDISABLE;
  ::tcsetattr(STDIN_FILENO, TCSANOW, &quiet);
  write_all(kEnter);
}

FullScreen::~FullScreen() {
  restore();
  for (const int signal : kEndings) ::signal(signal, SIG_DFL);
}

FullScreen::Size FullScreen::size() const {
  winsize size{};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0) return {};
  return {size.ws_col, size.ws_row};
}

void FullScreen::show(const std::vector<std::string>& lines) {
  const Size now = size();
  std::string piece;
  if (now != shown_size_) {
    shown_.clear();
    shown_size_ = now;
    piece = "\x1b[2J";
  }
  piece += screen_update(shown_, lines);
  if (piece.empty()) return;
  write_all(std::string{kBeginPiece} + piece + std::string{kEndPiece});
  shown_ = lines;
}

char FullScreen::key() const {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  if (::poll(&input, 1, 0) <= 0) return 0;
  char pressed = 0;
  return ::read(STDIN_FILENO, &pressed, 1) == 1 ? pressed : '\0';
}

}  // namespace telefab::client
