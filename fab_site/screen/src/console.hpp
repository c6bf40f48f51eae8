// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <telefab/base/open_file.hpp>

namespace telefab::fab {

/// The text console of this computer, which comes back on a screen whose programs have all died: cleared, without a
/// cursor, and told to draw no more, as far as that is permitted. Text again where it ends in an orderly way; a program
/// that is killed leaves it as it is.
class Console {
 public:
  enum class State : std::uint8_t { NotThere, NotPermitted, Cleared, Silent };
  Console();
  ~Console();
  Console(const Console&) = delete;
  Console& operator=(const Console&) = delete;
  [[nodiscard]] State state() const { return state_; }

 private:
  OpenFile terminal_;
  State state_ = State::NotThere;
};

}  // namespace telefab::fab
