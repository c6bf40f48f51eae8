// SPDX-License-Identifier: GPL-3.0-or-later
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <cstdlib>
#include <exception>
#include <sstream>
#include <telefab/base/version.hpp>
#include <telefab/command_line/manual.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/program.hpp>
#include <thread>

namespace telefab {
namespace {

/// Turns SIGINT and SIGTERM into a stop request, outside of signal-handler rules: the signals are blocked in every
/// thread and one thread waits for them.
class SignalStop {
 public:
  SignalStop() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGINT);
    sigaddset(&signals_, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    waiter_ = std::jthread{[this](std::stop_token ended) {
      pthread_setname_np(pthread_self(), "signals");
      while (!ended.stop_requested()) {
        const int signal = sigwaitinfo(&signals_, nullptr);
        if (signal < 0 || ended.stop_requested()) continue;
        // Whoever changed the terminal is told (at_quick_exit); nothing else is waited for.
        if (stop_.stop_requested() && signal == SIGINT) std::quick_exit(static_cast<int>(ExitCode::Cancelled));
        stop_.request_stop();
      }
    }};
  }
  ~SignalStop() {
    waiter_.request_stop();
    pthread_kill(waiter_.native_handle(), SIGTERM);  // to wake it; it is blocked in every thread
  }
  SignalStop(const SignalStop&) = delete;
  SignalStop& operator=(const SignalStop&) = delete;
  [[nodiscard]] std::stop_token token() const { return stop_.get_token(); }

 private:
  sigset_t signals_{};
  std::stop_source stop_;
  std::jthread waiter_;
};

/// The verb's own failure counts for more than that nobody could be told of it.
int finish(std::string_view program, const Result<ExitCode>& outcome) {
  const Result<void> written = flush_output();
  if (outcome && written) return static_cast<int>(*outcome);
  const Error& error = outcome ? written.error() : outcome.error();
  write_note(fmt::format("{}: {}\n", program, error.what));
  return static_cast<int>(exit_code_for(error.code));
}

/// --help and --version, or what is wrong with the command line.
int answer(std::string_view program, const CLI::App& app, const CLI::ParseError& error) {
  std::ostringstream out, notes;
  const int code = app.exit(error, out, notes);
  write_output(out.str());
  write_note(notes.str());
  return finish(program, code == 0 ? ExitCode::Ok : ExitCode::Usage);
}

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

ProgramManual describe(const ProgramText& text, CLI::App& app) {
  ProgramManual manual{
      std::string{text.name}, std::string{kVersion}, std::string{text.summary}, std::string{text.examples}, {}};
  for (const CLI::App* verb : app.get_subcommands({})) {
    VerbManual page{verb->get_name(), verb->get_description(), {}};
    for (const CLI::Option* option : verb->get_options())
      if (option != verb->get_help_ptr()) page.options.push_back(describe(*option));
    page.notes = verb->get_footer();
    manual.verbs.push_back(std::move(page));
  }
  return manual;
}

/// What a verb says below its options: its own words, then its examples.
std::string notes_of(const Verb& verb, std::string_view own_words) {
  std::string notes{own_words};
  while (notes.ends_with('\n')) notes.pop_back();
  if (!notes.empty()) notes += "\n\n";
  notes += "Examples:\n";
  for (const Example& example : verb.examples)
    if (!example.command.empty()) notes += fmt::format("  {}:\n    {}\n", example.purpose, example.command);
  return notes;
}

/// The two verbs that every program has.
void declare_about_itself(const ProgramText& text, CLI::App& app, VerbBody& chosen) {
  CLI::App* manual = app.add_subcommand("manual", "print the manual page; read it with `man -l -`");
  manual->callback([&text, &app, &chosen] {
    chosen = [&text, &app](std::stop_token) -> Result<ExitCode> {
      write_output(man_page(describe(text, app)));
      return ExitCode::Ok;
    };
  });
  CLI::App* completion = app.add_subcommand("completion", "print a script that completes this program's command lines");
  auto shell = std::make_shared<std::string>("bash");
  completion->add_option("SHELL", *shell, "whose script")
      ->check(CLI::IsMember({"bash", "zsh", "fish"}))
      ->capture_default_str();
  completion->callback([&text, &app, &chosen, shell] {
    chosen = [&text, &app, shell](std::stop_token) -> Result<ExitCode> {
      const auto known = shell_from_name(*shell);
      if (!known) return tl::unexpected{known.error()};
      write_output(completion_script(describe(text, app), *known));
      return ExitCode::Ok;
    };
  });
}

}  // namespace

int run_program(const ProgramText& text, std::span<const Verb> verbs, int argc, char** argv) {
  secure_standard_streams();
  try {
    CLI::App app{std::string{text.summary}, std::string{text.name}};
    app.require_subcommand(1);
    app.footer(fmt::format("{}\n{}", text.examples, exit_code_table()));
    app.set_version_flag("--version", fmt::format("telefab {}", kVersion));
    VerbBody chosen;
    for (const Verb& verb : verbs) {
      CLI::App* options = app.add_subcommand(std::string{verb.name}, std::string{verb.summary});
      options->callback([body = verb.declare(*options), &chosen] { chosen = body; });
      options->footer(notes_of(verb, options->get_footer()));
    }
    declare_about_itself(text, app, chosen);
    try {
      app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
      return answer(text.name, app, error);
    }
    const SignalStop signals;
    return finish(text.name, chosen(signals.token()));
  } catch (const std::bad_alloc&) {
    write_note(fmt::format("{}: out of memory\n", text.name));
  } catch (const std::exception& error) {
    write_note(fmt::format("{}: a fault of Telefab: {}\n", text.name, error.what()));
  }
  return static_cast<int>(ExitCode::Internal);
}

bool on_terminal() { return ::isatty(STDERR_FILENO) == 1; }

}  // namespace telefab
