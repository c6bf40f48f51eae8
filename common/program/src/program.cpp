#include <pthread.h>
#include <signal.h>
#include <unistd.h>

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <telefab/program/program.hpp>
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
    // A peer that goes away is an error code of write(), not the end of the process.
    ::signal(SIGPIPE, SIG_IGN);
    waiter_ = std::jthread{[this](std::stop_token ended) {
      pthread_setname_np(pthread_self(), "signals");
      while (!ended.stop_requested()) {
        const timespec wait{0, 100'000'000};
        const int signal = sigtimedwait(&signals_, nullptr, &wait);
        if (signal < 0) continue;
        if (stop_.stop_requested() && signal == SIGINT) ::_exit(static_cast<int>(ExitCode::Cancelled));
        stop_.request_stop();
      }
    }};
  }
  [[nodiscard]] std::stop_token token() const { return stop_.get_token(); }

 private:
  sigset_t signals_{};
  std::stop_source stop_;
  std::jthread waiter_;
};

int finish(std::string_view program, const Result<ExitCode>& outcome) {
  if (outcome) return static_cast<int>(*outcome);
  fmt::print(stderr, "{}: {}\n", program, outcome.error().what);
  return static_cast<int>(exit_code_for(outcome.error().code));
}

}  // namespace

int run_program(const ProgramText& text, std::span<const Verb> verbs, int argc, char** argv) {
  try {
    CLI::App app{std::string{text.summary}, std::string{text.name}};
    app.require_subcommand(1);
    app.footer(fmt::format("{}\n{}", text.examples, exit_code_table()));
    app.set_version_flag("--version", "telefab 0.1.0");
    VerbBody chosen;
    for (const Verb& verb : verbs) {
      CLI::App* options = app.add_subcommand(std::string{verb.name}, std::string{verb.summary});
      options->callback([body = verb.declare(*options), &chosen] { chosen = body; });
    }
    try {
      app.parse(argc, argv);
    } catch (const CLI::ParseError& error) {
      const int code = app.exit(error);
      return code == 0 ? 0 : static_cast<int>(ExitCode::Usage);
    }
    const SignalStop signals;
    const int code = finish(text.name, chosen(signals.token()));
    if (std::fflush(stdout) != 0) {
      fmt::print(stderr, "{}: cannot write the output; is the disk full?\n", text.name);
      return static_cast<int>(ExitCode::Storage);
    }
    return code;
  } catch (const std::bad_alloc&) {
    fmt::print(stderr, "{}: out of memory\n", text.name);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}: a fault of Telefab: {}\n", text.name, error.what());
  }
  return static_cast<int>(ExitCode::Internal);
}

bool on_terminal() { return ::isatty(STDERR_FILENO) == 1; }

}  // namespace telefab
