// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace telefab::test {

/// A file that is damaged, made to harm or merely odd, and what reading it must come to.
struct HostileFile {
  std::string name;  ///< with the suffix it would have
  std::string bytes;
  std::optional<std::size_t> points;  ///< that a reader must find; unset: it must refuse the file
  std::string says;                   ///< what the refusal must mention
};

/// The same files on every run: every format cut, garbled and claiming too much, and what only one of them can do.
[[nodiscard]] std::vector<HostileFile> hostile_files();

}  // namespace telefab::test
