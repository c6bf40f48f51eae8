// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <ostream>
#include <span>
#include <string_view>

namespace telefab::test {

/// Something people do wrong, and what they must be told: what, where and what to do.
struct Mistake {
  std::string_view name;     ///< of the test
  std::string_view command;  ///< for sh, in the folder of Workplace, with its variables
  int code = 0;
  std::array<std::string_view, 4> words{};      ///< all of them must be printed, on either stream
  std::array<std::string_view, 2> not_words{};  ///< none of them may be
};
inline void PrintTo(const Mistake& mistake, std::ostream* out) { *out << mistake.command; }

/// Those at the command line, with files, and with sites and certificates.
[[nodiscard]] std::span<const Mistake> command_line_mistakes();
[[nodiscard]] std::span<const Mistake> file_mistakes();
[[nodiscard]] std::span<const Mistake> site_mistakes();

}  // namespace telefab::test
