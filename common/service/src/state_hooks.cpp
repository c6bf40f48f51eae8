// SPDX-License-Identifier: GPL-3.0-or-later
#include <curl/curl.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <condition_variable>
#include <deque>
#include <mutex>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/log.hpp>
#include <telefab/service/state_hooks.hpp>
#include <thread>

extern char** environ;

namespace telefab {
namespace {

constexpr std::size_t kMostWaiting = 1000;
constexpr int kProgramLimitMs = 30'000;
constexpr int kLookEveryMs = 100;
constexpr long kRequestLimitS = 10;
constexpr int kTries = 3;

struct CurlHandle {
  CURL* handle = curl_easy_init();
  CurlHandle() = default;
  ~CurlHandle() { curl_easy_cleanup(handle); }
  CurlHandle(const CurlHandle&) = delete;
  CurlHandle& operator=(const CurlHandle&) = delete;
};

std::size_t ignore_answer(char*, std::size_t size, std::size_t count, void*) { return size * count; }

int stop_when_asked(void* stop, curl_off_t, curl_off_t, curl_off_t, curl_off_t) {
  return static_cast<std::stop_token*>(stop)->stop_requested() ? 1 : 0;
}

/// Empty when the address took it; otherwise what went wrong.
std::string post(const std::string& url, const std::string& body, std::stop_token stop) {
  const CurlHandle curl;
  if (!curl.handle) return "out of memory";
  curl_slist* headers = curl_slist_append(nullptr, "Content-Type: application/json");
  curl_easy_setopt(curl.handle, CURLOPT_URL, url.c_str());
  curl_easy_setopt(curl.handle, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(curl.handle, CURLOPT_HTTPHEADER, headers);
  curl_easy_setopt(curl.handle, CURLOPT_POSTFIELDS, body.c_str());
  curl_easy_setopt(curl.handle, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(body.size()));
  curl_easy_setopt(curl.handle, CURLOPT_USERAGENT, "telefab");
  curl_easy_setopt(curl.handle, CURLOPT_TIMEOUT, kRequestLimitS);
  curl_easy_setopt(curl.handle, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(curl.handle, CURLOPT_WRITEFUNCTION, ignore_answer);
  curl_easy_setopt(curl.handle, CURLOPT_NOPROGRESS, 0L);
  curl_easy_setopt(curl.handle, CURLOPT_XFERINFOFUNCTION, stop_when_asked);
  curl_easy_setopt(curl.handle, CURLOPT_XFERINFODATA, &stop);
  const CURLcode code = curl_easy_perform(curl.handle);
  long status = 0;
  curl_easy_getinfo(curl.handle, CURLINFO_RESPONSE_CODE, &status);
  curl_slist_free_all(headers);
  if (code != CURLE_OK) return curl_easy_strerror(code);
  return status >= 200 && status < 300 ? std::string{} : fmt::format("it answered with status {}", status);
}

std::vector<std::string> environment_for(const Job& job) {
  std::vector<std::string> variables;
  for (char** each = environ; *each; ++each) variables.emplace_back(*each);
  variables.push_back("TELEFAB_JOB=" + job.id);
  variables.push_back("TELEFAB_STATE=" + std::string{name_of(job.state)});
  variables.push_back("TELEFAB_MESSAGE=" + job.message);
  variables.push_back("TELEFAB_NAME=" + job.name);
  variables.push_back("TELEFAB_MACHINE=" + job.machine);
  variables.push_back("TELEFAB_INSTANCE=" + job.instance);
  return variables;
}

/// The program with `input` on its standard input, a file in memory, so that it may read or ignore it.
pid_t spawn(const std::string& program, const Job& job, const std::string& input) {
  const int file = ::memfd_create("telefab-hook", MFD_CLOEXEC);
  if (file < 0) return -1;
  const bool is_whole = ::write(file, input.data(), input.size()) == static_cast<ssize_t>(input.size()) &&
                        ::lseek(file, 0, SEEK_SET) == 0;
  std::vector<std::string> variables = environment_for(job);
  std::vector<char*> environment;
  for (std::string& variable : variables) environment.push_back(variable.data());
  environment.push_back(nullptr);
  std::string name = program;
  char* arguments[] = {name.data(), nullptr};
  posix_spawn_file_actions_t files{};
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, file, STDIN_FILENO);
  // What it prints goes to the daemon's log; standard output tells the port and nothing else.
  posix_spawn_file_actions_adddup2(&files, STDERR_FILENO, STDOUT_FILENO);
  // No socket, journal or device of the daemon: a program that outlives it must hold none of them.
  posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO + 1);
  posix_spawnattr_t attributes{};
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
  sigset_t defaults;
  sigemptyset(&defaults);
  posix_spawnattr_setsigmask(&attributes, &defaults);
  sigaddset(&defaults, SIGPIPE);
  posix_spawnattr_setsigdefault(&attributes, &defaults);
  pid_t child = -1;
  const int error =
      is_whole ? ::posix_spawn(&child, program.c_str(), &files, &attributes, arguments, environment.data()) : EIO;
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  ::close(file);
  return error == 0 ? child : -1;
}

std::string run(const std::string& program, const Job& job, const std::string& input, const std::stop_token& stop) {
  const pid_t child = spawn(program, job, input);
  if (child < 0) return "it could not be started";
  const int watch = static_cast<int>(::syscall(SYS_pidfd_open, child, 0));
  int waited = 0;
  bool has_ended = false;
  while (!has_ended && waited < kProgramLimitMs && !stop.stop_requested()) {
    pollfd each{watch, POLLIN, 0};
    has_ended = ::poll(&each, 1, kLookEveryMs) > 0;
    waited += kLookEveryMs;
  }
  if (!has_ended) ::kill(-child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
  if (watch >= 0) ::close(watch);
  if (!has_ended) return stop.stop_requested() ? "the daemon ends" : "it took longer than 30 s and was killed";
  if (WIFSIGNALED(status)) return fmt::format("it died by signal {}", WTERMSIG(status));
  return WEXITSTATUS(status) == 0 ? std::string{} : fmt::format("it ended with exit code {}", WEXITSTATUS(status));
}

}  // namespace

struct StateHooks::Impl {
  HookOptions options;
  std::mutex mutex;
  std::condition_variable_any has_work;
  std::deque<Job> waiting;
  std::jthread thread;

  void work(const std::stop_token& stop) {
    set_thread_name("hooks");
    while (true) {
      Job job;
      {
        std::unique_lock lock{mutex};
        if (!has_work.wait(lock, stop, [&] { return !waiting.empty(); })) return;
        job = std::move(waiting.front());
        waiting.pop_front();
      }
      deliver(job, stop);
    }
  }

  void deliver(const Job& job, const std::stop_token& stop) {
    const std::string body = to_json(job) + "\n";
    const auto complain = [&](std::string_view listener, const std::string& why) {
      if (!why.empty())
        log_warning(fmt::format("{} was not told that job {} is {}: {}", listener, job.id, name_of(job.state), why),
                    {job.id});
    };
    if (!options.program.empty()) complain(options.program, run(options.program, job, body, stop));
    if (options.url.empty()) return;
    std::string why;
    for (int attempt = 0; attempt < kTries && !stop.stop_requested(); ++attempt) {
      if (attempt > 0) pause(std::chrono::seconds{1 << attempt}, stop);
      why = post(options.url, body, stop);
      if (why.empty()) return;
    }
    complain(options.url, why.empty() ? "the daemon ends" : why);
  }

  void pause(std::chrono::seconds time, const std::stop_token& stop) {
    std::unique_lock lock{mutex};
    has_work.wait_for(lock, stop, time, [] { return false; });
  }
};

Result<std::unique_ptr<StateHooks>> StateHooks::start(const HookOptions& options) {
  if (!options.program.empty() && ::access(options.program.c_str(), X_OK) != 0)
    return fail(ErrorCode::InvalidInput,
                fmt::format("--hook: {} is not a program that may be run; check its path and mode", options.program));
  if (!options.url.empty() && !options.url.starts_with("http://") && !options.url.starts_with("https://"))
    return fail(ErrorCode::InvalidInput, fmt::format("--webhook: {} must begin with http:// or https://", options.url));
  auto impl = std::make_unique<Impl>();
  impl->options = options;
  if (!options.program.empty() || !options.url.empty())
    impl->thread = std::jthread{[raw = impl.get()](const std::stop_token& stop) { raw->work(stop); }};
  return std::unique_ptr<StateHooks>{new StateHooks{std::move(impl)}};
}

StateHooks::StateHooks(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}
StateHooks::~StateHooks() = default;

void StateHooks::notify(const Job& job) {
  if (!impl_->thread.joinable()) return;
  {
    const std::lock_guard lock{impl_->mutex};
    if (impl_->waiting.size() >= kMostWaiting) {
      log_warning("too many state changes wait for a hook; the oldest is dropped", {impl_->waiting.front().id});
      impl_->waiting.pop_front();
    }
    impl_->waiting.push_back(job);
  }
  impl_->has_work.notify_one();
}

}  // namespace telefab
