// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <vector>

namespace telefab::client {

/// The terminal of standard input and output as a screen of lines, with single keys. What was there before comes back
/// at destruction and where a signal ends the process. One at a time.
class FullScreen {
 public:
  /// Whether there is such a terminal: both ends are one, and TERM is not "dumb".
  [[nodiscard]] static bool is_possible();
  FullScreen();
  ~FullScreen();
  FullScreen(const FullScreen&) = delete;
  FullScreen& operator=(const FullScreen&) = delete;

  struct Size {
    int columns = 80;
    int rows = 24;
    friend bool operator==(const Size&, const Size&) = default;
  };
  [[nodiscard]] Size size() const;
  /// Shows the lines; writes only what changed, in one piece.
  void show(const std::vector<std::string>& lines);
  /// The next key pressed; 0 where none is waiting.
  [[nodiscard]] char key() const;

 private:
  std::vector<std::string> shown_;
  Size shown_size_{0, 0};
};

}  // namespace telefab::client
