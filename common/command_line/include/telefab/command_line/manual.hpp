// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab {

/// What the declarations of a program say about themselves: one source for `--help`, manual pages and completion.
struct OptionManual {
  std::string name;                  ///< longest name with its dashes, or the bare NAME of a positional
  std::string short_name;            ///< with its dash; empty if there is none
  std::string value;                 ///< type of the value, e.g. "FLOAT"; empty for a flag
  std::vector<std::string> choices;  ///< the only values there are; empty: any
  std::string description;
  std::string default_value;
  std::string environment;  ///< variable that stands in for the option
  bool required = false;
  bool positional = false;
};

struct VerbManual {
  std::string name;
  std::string summary;
  std::vector<OptionManual> options;  ///< in the order of their declaration, --help left out
  std::string notes = {};             ///< lines below the options: what else to know, examples
};

struct ProgramManual {
  std::string name;
  std::string version;
  std::string summary;
  std::string examples;
  std::vector<VerbManual> verbs;
};

/// A manual page of section 1 in man(7) macros: every verb with its options, exit codes, examples. Same text, same
/// bytes; no date in it.
[[nodiscard]] std::string man_page(const ProgramManual& program);

enum class Shell : std::uint8_t { Bash = 1, Zsh = 2, Fish = 3 };
[[nodiscard]] Result<Shell> shell_from_name(std::string_view name);

/// A script for that shell that completes verbs, options and values; a value without choices completes as a file.
[[nodiscard]] std::string completion_script(const ProgramManual& program, Shell shell);

}  // namespace telefab
