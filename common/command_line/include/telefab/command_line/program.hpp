// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <functional>
#include <span>
#include <stop_token>
#include <string_view>
#include <telefab/base/exit_code.hpp>
#include <telefab/command_line/options.hpp>

namespace telefab {

/// What a verb does once its options are read. The token is stopped by SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPWR and
/// SIGXCPU; other signals that can be caught end nothing.
using VerbBody = std::function<Result<ExitCode>(std::stop_token)>;

/// One verb of a program, e.g. `telefab-scan slice`. `declare` adds the verb's options to its own sub-command and
/// returns the body; the options live as long as the body.
/// A command line that works, and what one would want it for. A test holds its words against the verb's options.
struct Example {
  std::string_view purpose;
  std::string_view command;
};

struct Verb {
  std::string_view name;
  std::string_view summary;
  VerbBody (*declare)(VerbOptions& options);
  std::array<Example, 5> examples{};  ///< at least one; the others may be empty
};

struct ProgramText {
  std::string_view name;      ///< e.g. "telefab-scan"
  std::string_view summary;   ///< what it is for, one or two sentences
  std::string_view examples;  ///< shown below the verbs in --help
};

/// The whole main(): parses the command line, runs one verb, prints an Error as one line "NAME: what" on standard
/// error and returns its exit code. A second SIGINT ends the process at once. Call it from main only, before any
/// other thread exists.
[[nodiscard]] int run_program(const ProgramText& text, std::span<const Verb> verbs, int argc, char** argv);

/// True where progress bars and colours make sense: standard error is a terminal.
[[nodiscard]] bool on_terminal();

}  // namespace telefab
