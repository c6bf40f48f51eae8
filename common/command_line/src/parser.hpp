// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <telefab/command_line/manual.hpp>
#include <telefab/command_line/options.hpp>
#include <telefab/command_line/program.hpp>

namespace telefab {

/// The command line of a program: its verbs, and what they say about themselves.
class Parser {
 public:
  explicit Parser(const ProgramText& text);
  ~Parser();
  Parser(const Parser&) = delete;
  Parser& operator=(const Parser&) = delete;

  /// `declare` adds the verb's options and gives its body; `notes_of` makes what stands below them of the verb's
  /// footer.
  void add(std::string_view name, std::string_view summary, const std::function<VerbBody(VerbOptions&)>& declare,
           const std::function<std::string(const std::string& footer)>& notes_of);

  struct Parsed {
    VerbBody body;       ///< of the verb that was chosen; empty: nothing is to be run
    std::string output;  ///< --help, --version
    std::string notes;   ///< what is wrong with the command line
    bool is_wrong = false;
  };
  [[nodiscard]] Parsed parse(int argc, char** argv);
  [[nodiscard]] ProgramManual manual() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace telefab
