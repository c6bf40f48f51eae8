// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <unistd.h>

#include <chrono>
#include <utility>

namespace telefab {

/// An open file that is closed with it; -1: none.
class OpenFile {
 public:
  OpenFile() = default;
  explicit OpenFile(int number) : number_{number} {}
  OpenFile(OpenFile&& other) noexcept : number_{std::exchange(other.number_, -1)} {}
  OpenFile& operator=(OpenFile&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;
  ~OpenFile() {
    if (number_ >= 0) ::close(number_);
  }
  [[nodiscard]] int get() const { return number_; }

 private:
  int number_ = -1;
};

/// Takes the one lock that a file or folder has among programs (flock); the last copy of it that is closed gives it
/// back, however its program ends.
/// Returns 0, EWOULDBLOCK (somebody holds it for longer than `patience`), or another errno.
[[nodiscard]] int take_lock(const OpenFile& file, std::chrono::milliseconds patience = {});

}  // namespace telefab
