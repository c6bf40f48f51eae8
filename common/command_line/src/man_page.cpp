// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/base/exit_code.hpp>
#include <telefab/command_line/manual.hpp>

namespace telefab {
namespace {

/// Text for man(7): a backslash, a dash, and a control character at the start of a line mean something there.
std::string roff(std::string_view text) {
  std::string out;
  bool line_start = true;
  for (const char c : text) {
    if (line_start && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else
      out += c;
    line_start = c == '\n';
  }
  return out;
}

std::string option_head(const OptionManual& option) {
  std::string head;
  if (!option.short_name.empty()) head += fmt::format("\\fB{}\\fR, ", roff(option.short_name));
  head += fmt::format("\\fB{}\\fR", roff(option.name));
  if (!option.choices.empty())
    head += fmt::format(" \\fI{}\\fR", roff(fmt::format("{}", fmt::join(option.choices, "|"))));
  else if (!option.value.empty() && !option.positional)
    head += fmt::format(" \\fI{}\\fR", roff(option.value));
  return head;
}

std::string option_text(const OptionManual& option) {
  std::string text = option.description.empty() ? std::string{"see above"} : option.description;
  if (!option.default_value.empty()) text += fmt::format(" (default: {})", option.default_value);
  if (!option.environment.empty()) text += fmt::format(" [environment: {}]", option.environment);
  return roff(text);
}

std::string usage(const ProgramManual& program, const VerbManual& verb) {
  std::string line = fmt::format("\\fB{} {}\\fR [\\fIoptions\\fR]", roff(program.name), roff(verb.name));
  for (const OptionManual& option : verb.options)
    if (option.positional)
      line += fmt::format(fmt::runtime(option.required ? " \\fI{}\\fR" : " [\\fI{}\\fR]"), roff(option.name));
  return line;
}

std::string upper(std::string_view text) {
  std::string out{text};
  std::ranges::transform(out, out.begin(), [](char c) { return c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c; });
  return out;
}

std::string lines(std::string_view text) { return fmt::format(".nf\n{}\n.fi\n", roff(text)); }

}  // namespace

std::string man_page(const ProgramManual& program) {
  std::string page = fmt::format(".TH {} 1 \"\" \"Telefab {}\" \"Telefab\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n",
                                 roff(upper(program.name)), program.version, roff(program.name), roff(program.summary));
  for (const VerbManual& verb : program.verbs) page += usage(program, verb) + "\n.br\n";
  page += ".SH VERBS\n";
  for (const VerbManual& verb : program.verbs) {
    page += fmt::format(".SS {}\n{}\n.PP\n{}\n", roff(verb.name), roff(verb.summary), usage(program, verb));
    for (const OptionManual& option : verb.options)
      page += fmt::format(".TP\n{}\n{}\n", option_head(option), option_text(option));
    if (!verb.notes.empty()) page += ".PP\n" + lines(verb.notes);
  }
  page += ".SH EXIT STATUS\n" + lines(exit_code_table());
  page += ".SH EXAMPLES\n" + lines(program.examples);
  page += ".SH SEE ALSO\n.BR telefab (1),\n.BR telefab\\-scan (1),\n.BR telefab\\-fab (1)\n";
  return page;
}

}  // namespace telefab
