// SPDX-License-Identifier: GPL-3.0-or-later
#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <fmt/format.h>
#include <array>
#include <cstdlib>
#include <exception>
#include <memory>
#include <telefab/command_line/manual.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/program.hpp>
#include <thread>

#include "parser.hpp"

namespace telefab {
namespace {

/// What asks a program to end: an operator, the service, a terminal that closes, power that goes, a limit reached.
constexpr std::array kEndings{SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGPWR, SIGXCPU};
/// What would end it by default and asks for nothing. A peer that goes away, and a file that may not grow, are error
/// codes of write(), not the end of the process.
constexpr std::array kStrays{SIGPIPE, SIGXFSZ, SIGUSR1, SIGUSR2, SIGALRM, SIGPROF, SIGVTALRM, SIGPOLL, SIGSTKFLT};

/// Whoever started the program wants the signal ignored, as nohup does.
bool is_ignored(int signal) {
  struct sigaction now {};
  return ::sigaction(signal, nullptr, &now) == 0 && now.sa_handler == SIG_IGN;
}

/// Turns what asks the program to end into a stop request, outside of signal-handler rules: the signals are blocked in
/// every thread and one thread waits for them. No other signal that can be caught ends it in the midst of an exposure.
class SignalStop {
 public:
  SignalStop() {
    sigemptyset(&signals_);
    for (const int signal : kEndings)
      if (signal == SIGTERM || !is_ignored(signal)) sigaddset(&signals_, signal);
    pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
    for (const int signal : kStrays) ::signal(signal, SIG_IGN);
    for (int signal = SIGRTMIN; signal <= SIGRTMAX; ++signal) ::signal(signal, SIG_IGN);
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
void add_about_itself(Parser& parser) {
  const auto as_it_is = [](const std::string& footer) { return footer; };
  const auto manual = [&parser](std::stop_token) -> Result<ExitCode> {
    write_output(man_page(parser.manual()));
    return ExitCode::Ok;
  };
  parser.add(
      "manual", "print the manual page; read it with `man -l -`", [&](VerbOptions&) { return VerbBody{manual}; },
      as_it_is);
  const auto declare_completion = [&parser](VerbOptions& options) -> VerbBody {
    auto shell = std::make_shared<std::string>("bash");
    options.add("SHELL", *shell, "whose script").one_of({"bash", "zsh", "fish"}).shows_default();
    return [&parser, shell](std::stop_token) -> Result<ExitCode> {
      const auto known = shell_from_name(*shell);
      if (!known) return tl::unexpected{known.error()};
      write_output(completion_script(parser.manual(), *known));
      return ExitCode::Ok;
    };
  };
  parser.add("completion", "print a script that completes this program's command lines", declare_completion, as_it_is);
}

}  // namespace

int run_program(const ProgramText& text, std::span<const Verb> verbs, int argc, char** argv) {
  secure_standard_streams();
  try {
    Parser parser{text};
    for (const Verb& verb : verbs)
      parser.add(verb.name, verb.summary, verb.declare,
                 [&](const std::string& footer) { return notes_of(verb, footer); });
    add_about_itself(parser);
    const Parser::Parsed parsed = parser.parse(argc, argv);
    write_output(parsed.output);
    write_note(parsed.notes);
    if (!parsed.body) return finish(text.name, parsed.is_wrong ? ExitCode::Usage : ExitCode::Ok);
    const SignalStop signals;
    return finish(text.name, parsed.body(signals.token()));
  } catch (const std::bad_alloc&) {
    write_note(fmt::format("{}: out of memory\n", text.name));
  } catch (const std::exception& error) {
    write_note(fmt::format("{}: a fault of Telefab: {}\n", text.name, error.what()));
  }
  return static_cast<int>(ExitCode::Internal);
}

bool on_terminal() { return ::isatty(STDERR_FILENO) == 1; }

}  // namespace telefab
