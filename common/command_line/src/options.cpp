// SPDX-License-Identifier: GPL-3.0-or-later
// The one place that knows CLI11, which takes seconds to compile wherever it is included.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <sstream>
#include <telefab/base/version.hpp>

#include "parser.hpp"
#include "usage_error.hpp"

namespace telefab {
namespace {

/// The values of "{a,b}" in a type name as CLI11 composes it, e.g. "TEXT:{exact,curve}".
std::vector<std::string> choices_in(const std::string& type) {
  const std::size_t open = type.find('{');
  const std::size_t close = type.find('}');
  std::vector<std::string> choices;
  if (open == std::string::npos || close == std::string::npos) return choices;
  for (const std::string& part : CLI::detail::split(type.substr(open + 1, close - open - 1), ',')) {
    // A map of names to values shows as "name->value".
    choices.push_back(part.substr(0, part.find("->")));
  }
  return choices;
}

OptionManual describe(const CLI::Option& option) {
  OptionManual manual;
  manual.positional = !option.nonpositional();
  manual.name = manual.positional ? option.get_name(true)
                                  : "--" + (option.get_lnames().empty() ? std::string{} : option.get_lnames().front());
  if (!manual.positional && option.get_lnames().empty()) manual.name = "-" + option.get_snames().front();
  if (!option.get_snames().empty() && !option.get_lnames().empty())
    manual.short_name = "-" + option.get_snames().front();
  if (option.get_items_expected_max() > 0) {
    const std::string type = option.get_type_name();
    manual.choices = choices_in(type);
    manual.value = type.substr(0, type.find(':'));
  }
  manual.description = option.get_description();
  manual.default_value = option.get_default_str();
  manual.environment = option.get_envname();
  manual.required = option.get_required();
  return manual;
}

}  // namespace

const Option& Option::required(bool is) const {
  option_->required(is);
  return *this;
}

const Option& Option::shows_default() const {
  option_->capture_default_str();
  return *this;
}

const Option& Option::shows_default(const std::string& text) const {
  option_->default_str(text);
  return *this;
}

const Option& Option::within(double least, double most) const {
  option_->check(CLI::Range(least, most));
  return *this;
}

const Option& Option::within_whole(std::int64_t least, std::int64_t most) const {
  option_->check(CLI::Range(least, most));
  return *this;
}

const Option& Option::above_zero() const {
  option_->check(CLI::PositiveNumber);
  return *this;
}

const Option& Option::such_that(const std::string& rule, std::function<bool(double)> holds) const {
  option_->check([rule, holds = std::move(holds)](const std::string& given) {
    double value = 0;
    // What is no number at all is said so when it is read.
    const bool is_wrong = CLI::detail::lexical_cast(given, value) && !holds(value);
    return is_wrong ? fmt::format("{} is not {}", given, rule) : std::string{};
  });
  return *this;
}

const Option& Option::one_of(std::vector<std::string> words) const {
  option_->check(CLI::IsMember(std::move(words)));
  return *this;
}

const Option& Option::names(const std::string& what) const {
  option_->type_name(what);
  return *this;
}

const Option& Option::environment(const std::string& variable) const {
  option_->envname(variable);
  return *this;
}

const Option& Option::excludes(const Option& other) const {
  option_->excludes(other.option_);
  return *this;
}

const Option& Option::separated_by(char mark) const {
  option_->delimiter(mark);
  return *this;
}

Option VerbOptions::add(const std::string& names, OptionValue into, const std::string& help) {
  return Option{std::visit([&](auto* value) { return app_.add_option(names, *value, help); }, into)};
}

Option VerbOptions::flag(const std::string& name, bool& into, const std::string& help) {
  return Option{app_.add_flag(name, into, help)};
}

void VerbOptions::footer(const std::string& text) { app_.footer(text); }

struct Parser::Impl {
  const ProgramText& text;
  CLI::App app;
  VerbBody chosen;

  /// For people; `words`: the command line behind the program's name.
  [[nodiscard]] std::string what_is_wrong(const CLI::ParseError& error, const std::vector<std::string>& words) const;
};

Parser::Parser(const ProgramText& text)
    : impl_{new Impl{text, CLI::App{std::string{text.summary}, std::string{text.name}}, {}}} {
  impl_->app.require_subcommand(1);
  impl_->app.footer(fmt::format("{}\n{}", text.examples, exit_code_table()));
  impl_->app.set_version_flag("--version", fmt::format("telefab {}", kVersion));
}

Parser::~Parser() = default;

void Parser::add(std::string_view name, std::string_view summary, const std::function<VerbBody(VerbOptions&)>& declare,
                 const std::function<std::string(const std::string& footer)>& notes_of) {
  CLI::App* verb = impl_->app.add_subcommand(std::string{name}, std::string{summary});
  VerbOptions options{*verb};
  verb->callback([body = declare(options), impl = impl_.get()] { impl->chosen = body; });
  verb->footer(notes_of(verb->get_footer()));
}

Parser::Parsed Parser::parse(int argc, char** argv) {
  try {
    impl_->app.parse(argc, argv);
    return {impl_->chosen, {}, {}};
  } catch (const CLI::ParseError& error) {
    std::ostringstream output, notes;
    const bool is_wrong = impl_->app.exit(error, output, notes) != 0;
    if (!is_wrong) return {{}, output.str(), notes.str(), false};
    return {{}, {}, impl_->what_is_wrong(error, {argv + std::min(argc, 1), argv + argc}), true};
  }
}

std::string Parser::Impl::what_is_wrong(const CLI::ParseError& error, const std::vector<std::string>& words) const {
  const auto chosen_verbs = app.get_subcommands();
  const CLI::App& at = chosen_verbs.empty() ? app : *chosen_verbs.front();
  const std::string program =
      chosen_verbs.empty() ? std::string{text.name} : fmt::format("{} {}", text.name, at.get_name());
  std::string what = error.what();
  if (!words.empty() && words.front().starts_with('-')) {
    what = option_before_verb(text.name, words.front());
  } else if (chosen_verbs.empty() && !words.empty()) {
    std::vector<std::string> verbs;
    for (const CLI::App* verb : app.get_subcommands({})) verbs.push_back(verb->get_name());
    what = unknown_verb(text.name, words.front(), verbs);
  } else if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr) {
    std::vector<std::string> options;
    for (const CLI::Option* option : at.get_options())
      for (const std::string& name : option->get_lnames()) options.push_back("--" + name);
    // An option that is not known leaves its value over too, so that options are named first.
    std::vector<std::string> left = at.remaining(true);
    const auto first = std::ranges::find_if(left, [](const std::string& word) { return word.starts_with('-'); });
    if (!left.empty()) what = unexpected_word(first != left.end() ? *first : left.front(), options);
  } else if (dynamic_cast<const CLI::ConversionError*>(&error) != nullptr) {
    if (const auto comma = decimal_comma(words)) what += "; " + *comma;
  }
  return fmt::format("{}: {}\nRun `{} --help` for what there is.\n", program, what, program);
}

ProgramManual Parser::manual() const {
  const ProgramText& text = impl_->text;
  ProgramManual manual{
      std::string{text.name}, std::string{kVersion}, std::string{text.summary}, std::string{text.examples}, {}};
  for (const CLI::App* verb : impl_->app.get_subcommands({})) {
    VerbManual page{verb->get_name(), verb->get_description(), {}};
    for (const CLI::Option* option : verb->get_options())
      if (option != verb->get_help_ptr()) page.options.push_back(describe(*option));
    page.notes = verb->get_footer();
    manual.verbs.push_back(std::move(page));
  }
  return manual;
}

}  // namespace telefab
