// SPDX-License-Identifier: GPL-3.0-or-later
// The one place that knows CLI11, which takes seconds to compile wherever it is included.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <deque>
#include <filesystem>
#include <sstream>
#include <telefab/base/version.hpp>
#include <type_traits>

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

/// Which numbers go where a value goes; nothing for texts.
template <class Value>
constexpr std::optional<NumberKind> number_kind_of(const Value* /*into*/) {
  if constexpr (requires { typename Value::value_type; }) {
    return number_kind_of(static_cast<const typename Value::value_type*>(nullptr));
  } else if constexpr (std::is_floating_point_v<Value>) {
    return NumberKind::Any;
  } else if constexpr (std::is_unsigned_v<Value> && !std::is_same_v<Value, char>) {
    return NumberKind::Counting;
  } else if constexpr (std::is_same_v<Value, int>) {
    return NumberKind::Whole;
  } else {
    return std::nullopt;
  }
}

/// Refuses to write where something lies, unless that was asked for. An empty folder is nothing; devices and pipes are
/// written to and not replaced.
Result<void> check_outputs(const VerbOptions::Outputs& outputs) {
  if (outputs.is_forced) return {};
  for (const auto& [option, paths] : outputs.places)
    for (const std::string& path : paths()) {
      std::error_code unknown;  // what cannot be looked at is for the writing to name
      const auto status = std::filesystem::status(path, unknown);
      const bool is_in_use = std::filesystem::is_regular_file(status) ||
                             (std::filesystem::is_directory(status) && !std::filesystem::is_empty(path, unknown));
      if (is_in_use && !unknown)
        return fail(ErrorCode::Conflict,
                    fmt::format("{} is there already; give --force to replace it, or {} another name", path, option));
    }
  return {};
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
  const auto problem = [least, most](const std::string& given) {
    double value = 0;
    const bool is_wrong = CLI::detail::lexical_cast(given, value) && !(value >= least && value <= most);
    return is_wrong ? fmt::format("{} is not from {} to {}", given, least, most) : std::string{};
  };
  option_->check(problem, CLI::Range(least, most).get_description());
  return *this;
}

const Option& Option::within_whole(std::int64_t least, std::int64_t most) const {
  const auto problem = [least, most](const std::string& given) {
    std::int64_t value = 0;
    const bool is_wrong = !CLI::detail::lexical_cast(given, value) || value < least || value > most;
    return is_wrong ? fmt::format("{} is not a whole number from {} to {}", given, least, most) : std::string{};
  };
  option_->check(problem, CLI::Range(least, most).get_description());
  return *this;
}

const Option& Option::above_zero() const {
  return such_that("above 0", [](double value) { return value > 0; });
}

const Option& Option::refused_by(std::function<std::string(const std::string&)> problem) const {
  option_->check(std::move(problem));
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
  const std::string description = CLI::IsMember(words).get_description();
  const auto problem = [words = std::move(words)](const std::string& given) {
    return std::ranges::find(words, given) == words.end() ? no_such_choice(given, words) : std::string{};
  };
  option_->check(problem, description);
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
  return Option{std::visit(
      [&](auto* value) {
        CLI::Option* option = app_.add_option(names, *value, help);
        if (const auto kind = number_kind_of(value))
          option->check([kind](const std::string& given) { return number_problem(given, *kind); });
        return option;
      },
      into)};
}

Option VerbOptions::add_output(const std::string& names, std::string& into, const std::string& help,
                               std::vector<std::string> endings) {
  return add_place(names, &into, help, [&into, endings = std::move(endings)] {
    std::vector<std::string> paths;
    if (!into.empty())
      for (const std::string& ending : endings) paths.push_back(into + ending);
    return paths;
  });
}

Option VerbOptions::add_output(const std::string& names, std::optional<std::string>& into, const std::string& help) {
  return add_place(names, &into, help, [&into] { return into ? std::vector{*into} : std::vector<std::string>{}; });
}

Option VerbOptions::add_place(const std::string& names, OptionValue into, const std::string& help,
                              std::function<std::vector<std::string>()> paths) {
  if (outputs_.places.empty()) flag("--force", outputs_.is_forced, "replace what lies at the places to write to");
  outputs_.places.push_back({names.substr(names.rfind(',') + 1), std::move(paths)});
  return add(names, into, help);
}

Option VerbOptions::flag(const std::string& name, bool& into, const std::string& help) {
  return Option{app_.add_flag(name, into, help)};
}

void VerbOptions::footer(const std::string& text) { app_.footer(text); }

struct Parser::Impl {
  const ProgramText& text;
  CLI::App app;
  VerbBody chosen;
  std::deque<VerbOptions::Outputs> outputs;  ///< of each verb; they stay where they are

  /// For people; `words`: the command line behind the program's name.
  [[nodiscard]] std::string what_is_wrong(const CLI::ParseError& error, const std::vector<std::string>& words) const;
};

Parser::Parser(const ProgramText& text)
    : impl_{new Impl{text, CLI::App{std::string{text.summary}, std::string{text.name}}, {}, {}}} {
  impl_->app.require_subcommand(1);
  impl_->app.footer(fmt::format("{}\n{}", text.examples, exit_code_table()));
  impl_->app.set_version_flag("--version", fmt::format("telefab {}", kVersion));
}

Parser::~Parser() = default;

void Parser::add(std::string_view name, std::string_view summary, const std::function<VerbBody(VerbOptions&)>& declare,
                 const std::function<std::string(const std::string& footer)>& notes_of) {
  CLI::App* verb = impl_->app.add_subcommand(std::string{name}, std::string{summary});
  const VerbOptions::Outputs& outputs = impl_->outputs.emplace_back();
  VerbOptions options{*verb, impl_->outputs.back()};
  verb->callback([body = declare(options), &outputs, impl = impl_.get()] {
    impl->chosen = [body, &outputs](std::stop_token stop) -> Result<ExitCode> {
      if (auto free = check_outputs(outputs); !free) return tl::unexpected{free.error()};
      return body(std::move(stop));
    };
  });
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
  std::vector<std::string> verbs;
  for (const CLI::App* verb : app.get_subcommands({})) verbs.push_back(verb->get_name());
  std::string what = error.what();
  if (words.empty()) {
    what = no_verb(text.name, verbs);
  } else if (words.front().starts_with('-')) {
    what = option_before_verb(text.name, words.front());
  } else if (chosen_verbs.empty()) {
    what = unknown_verb(text.name, words.front(), verbs);
  } else if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr ||
             dynamic_cast<const CLI::RequiredError*>(&error) != nullptr) {
    std::vector<std::string> options;
    for (const CLI::Option* option : at.get_options())
      for (const std::string& name : option->get_lnames()) options.push_back("--" + name);
    // An option that is not known leaves its value over too, and may be the slip for one that is required: options are
    // named first.
    std::vector<std::string> left = at.remaining(true);
    const auto first = std::ranges::find_if(left, [](const std::string& word) { return word.starts_with('-'); });
    if (first != left.end())
      what = unexpected_word(*first, options);
    else if (!left.empty() && dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr)
      what = unexpected_word(left.front(), options);
  } else if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
    for (const CLI::Option* option : at.get_options())
      for (std::size_t i = 0; i < words.size(); ++i)
        if (option->check_name(words[i]) && (i + 1 == words.size() || at.get_option_no_throw(words[i + 1]) != nullptr))
          what = no_value(words[i], describe(*option).value);
  } else if (dynamic_cast<const CLI::ExcludesError*>(&error) != nullptr) {
    for (const CLI::Option* option : at.get_options())
      for (const CLI::Option* other : option->get_excludes())
        if (option->count() > 0 && other->count() > 0)
          what = fmt::format("give {} or {}, not both", other->get_name(), option->get_name());
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
