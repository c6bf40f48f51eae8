// SPDX-License-Identifier: GPL-3.0-or-later
#include "disk_trial.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <fstream>
#include <functional>
#include <future>
#include <nlohmann/json.hpp>
#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/scan/daemon/serve_scan_site.hpp>
#include <telefab/service/log.hpp>
#include <telefab/test/loopback.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/toy.hpp>
#include <thread>

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr auto kRoomIsMadeAfter = 300ms;
constexpr auto kPatience = 40s;

std::string text_of(const fs::path& file) {
  const SoundDisk for_the_trial;
  std::ifstream in{file, std::ios::binary};
  return {std::istreambuf_iterator<char>{in}, {}};
}

template <class Condition>
bool await(const Condition& condition, Clock::duration patience = kPatience) {
  for (const auto end = Clock::now() + patience; Clock::now() < end; std::this_thread::sleep_for(10ms))
    if (condition()) return true;
  return condition();
}

void write_inputs(const fs::path& folder) {
  fs::remove_all(folder);
  fs::create_directories(folder / "machines");
  std::ofstream{folder / "machines" / "toy.toml"} << kToyProfile << R"([resin]
critical_dose_mj_per_cm2 = 4.0
penetration_mm = 0.3
[devices]
speed_up = 5000.0
)";
  write_torus(folder / "torus.xyz", 60, 24);
}

/// 200, 503, or 0 where nobody answers.
int health_of(const fs::path& data) {
  const std::string port = text_of(data / "web-port");
  if (port.empty()) return 0;
  const int line = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const sockaddr_in address = loopback(static_cast<std::uint16_t>(std::atoi(port.c_str())));
  int status = 0;
  const std::string_view question = "GET /v1/health HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
  std::array<char, 64> answer{};
  if (::connect(line, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
      ::send(line, question.data(), question.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(question.size()) &&
      ::recv(line, answer.data(), answer.size() - 1, 0) > 12)
    status = std::atoi(answer.data() + 9);
  ::close(line);
  return status;
}

/// A daemon on a thread of its own.
class Daemon {
 public:
  using Serve = std::function<Result<void>(std::stop_token)>;
  Daemon(fs::path data, Serve serve) : data_{std::move(data)}, serve_{std::move(serve)} {}
  ~Daemon() { stop(); }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  /// Until it listens; why not, where it does not.
  [[nodiscard]] Result<void> start() {
    {
      const SoundDisk for_the_trial;
      std::error_code error;
      fs::remove(data_ / "port", error);
    }
    std::promise<Result<void>> ended;
    outcome_ = ended.get_future();
    thread_ = std::jthread{
        [this, ended = std::move(ended)](std::stop_token stop) mutable { ended.set_value(serve_(std::move(stop))); }};
    const auto has_ended = [this] { return outcome_.wait_for(0s) == std::future_status::ready; };
    if (!await([&] { return has_ended() || text_of(data_ / "port").ends_with('\n'); }))
      return fail(ErrorCode::Internal, "the daemon neither listens nor ends");
    if (!has_ended()) return {};
    thread_.join();
    auto outcome = outcome_.get();
    return outcome ? fail(ErrorCode::Internal, "the daemon ended without a reason") : outcome;
  }
  void stop() {
    if (!thread_.joinable()) return;
    thread_.request_stop();
    thread_.join();
  }
  [[nodiscard]] std::string address() const {
    std::string port = text_of(data_ / "port");
    port.pop_back();
    return "127.0.0.1:" + port;
  }
  [[nodiscard]] int health() const { return health_of(data_); }

 private:
  fs::path data_;
  Serve serve_;
  std::future<Result<void>> outcome_;
  std::jthread thread_;
};

class Trial {
 public:
  explicit Trial(DiskTrial trial)
      : trial_{std::move(trial)},
        fab_{trial_.folder / "fab",
             [this](std::stop_token stop) {
               fab::FabSiteConfig config;
               config.serve = serve_options("fab", "fab-site");
               config.serve.listen = fab_address_;
               config.at_start.maybe_exposed.reset();
               return fab::serve_fab_site(config, clock_, std::move(stop));
             }},
        scan_{trial_.folder / "scan", [this](std::stop_token stop) {
                scan::ScanSiteConfig config;
                config.serve = serve_options("scan", "scan-site");
                config.fab = fab_address_;
                return scan::serve_scan_site(config, clock_, std::move(stop));
              }} {}

  DiskVerdict run() {
    (void)set_log_level("warning");
    write_inputs(trial_.folder);
    begin_disk_faults(
        {(trial_.folder / trial_.site).string(), trial_.calls, trial_.at, trial_.error, trial_.stays, trial_.ending});
    watcher_ = std::jthread{[this](const std::stop_token& stop) { watch(stop); }};
    const Result<void> went = go();
    watcher_ = {};
    for (std::size_t i = 0; i < kDiskCalls; ++i) verdict_.operations[i] = disk_operations(static_cast<DiskCalls>(i));
    verdict_.fault = first_disk_fault();
    if (!went) {
      verdict_.outcome = DiskOutcome::Wrong;
      verdict_.what = went.error().what;
    }
    fab_.stop();
    scan_.stop();
    return verdict_;
  }

 private:
  [[nodiscard]] ServeOptions serve_options(const std::string& name, const std::string& certificate) const {
    ServeOptions options;
    options.listen = "127.0.0.1:0";
    options.data = (trial_.folder / name).string();
    options.machines = (trial_.folder / "machines").string();
    options.tls_name = certificate;
    options.web = "127.0.0.1:0";
    options.reserve_mib = 1;
    options.retry_every = 50ms;
    return options;
  }

  /// Makes room a while after the first operation failed, and asks the site for its health meanwhile.
  void watch(const std::stop_token& stop) {
    while (!stop.stop_requested() && first_disk_fault().empty()) std::this_thread::sleep_for(2ms);
    for (const auto end = Clock::now() + kRoomIsMadeAfter; !stop.stop_requested() && Clock::now() < end;
         std::this_thread::sleep_for(10ms))
      if (health_of(trial_.folder / trial_.site) == 503) verdict_.was_unhealthy = true;
    end_disk_faults();
  }

  void note(DiskOutcome outcome, const std::string& why) {
    if (outcome <= verdict_.outcome) return;
    verdict_.outcome = outcome;
    verdict_.what = why;
  }

  /// Started again where the disk did not let it start; the second time it must.
  [[nodiscard]] Result<void> start(Daemon& daemon) {
    const auto started = daemon.start();
    if (started) return {};
    if (first_disk_fault().empty()) return fail_in("a start on a sound disk was refused", started.error());
    note(DiskOutcome::Refused, "start: " + started.error().what);
    end_disk_faults();
    const auto again = daemon.start();
    return again ? Result<void>{} : fail_in("not even the next start went", again.error());
  }

  [[nodiscard]] Outcome client(std::vector<std::string> words, const Daemon& at) const {
    words.insert(words.begin(), (trial_.bin / "telefab").string());
    words.insert(words.end(), {"--site", at.address()});
    return test::run(words);
  }

  [[nodiscard]] Result<std::string> submit() {
    const std::vector<std::string> words{
        "submit", (trial_.folder / "torus.xyz").string(), "--machine", "toy", "--height-mm", "2"};
    Outcome submitted = client(words, scan_);
    if (submitted.code != 0) {
      if (first_disk_fault().empty()) return fail(ErrorCode::Internal, "submit: " + submitted.errors);
      note(DiskOutcome::Refused, "submit: " + submitted.errors);
      end_disk_faults();
      submitted = client(words, scan_);
    }
    if (submitted.code != 0) return fail(ErrorCode::Internal, "not even the next submit went: " + submitted.errors);
    return submitted.output.substr(0, submitted.output.find('\n'));
  }

  /// The job as the site lists it.
  [[nodiscard]] nlohmann::json job_at(const Daemon& site, const std::string& id) const {
    const Outcome listed = client({"jobs", "--json"}, site);
    const auto jobs = nlohmann::json::parse(listed.output, nullptr, false);
    if (jobs.is_array())
      for (const auto& job : jobs)
        if (job.value("id", "") == id) return job;
    return nlohmann::json::object();
  }

  [[nodiscard]] Result<void> see_to_its_end(const std::string& id) {
    nlohmann::json job;
    std::string state;
    int words = 0;
    const auto is_over = [&] {
      job = job_at(scan_, id);
      state = job.value("state", "");
      return state == "done" || state == "failed" || state == "cancelled" || state == "paused" ||
             state == "awaiting-approval";
    };
    while (await(is_over) && (state == "paused" || state == "awaiting-approval") && words++ < 4) {
      const std::string message = job.value("message", "");
      if (message.empty()) return fail(ErrorCode::Internal, "held without a reason, " + state);
      note(DiskOutcome::Held, message);
      end_disk_faults();
      if (state == "awaiting-approval") {
        (void)client({"approve", id}, fab_);
      } else if (client({"resume", id}, fab_).code != 0) {
        (void)client({"resume", id, "--as", "treat-as-exposed"}, fab_);
      }
      (void)await([&] { return job_at(fab_, id).value("state", "") != state; }, 5s);
    }
    if (state != "done")
      return fail(ErrorCode::Internal,
                  fmt::format("{}: {} at the scan site, {} at the fab", state, job.dump(), job_at(fab_, id).dump()));
    return {};
  }

  [[nodiscard]] static bool has_all_counters(const nlohmann::json& job) {
    const int layers = job.value("print_layers", 0);
    return layers > 0 && job.value("layers_printed", 0) == layers;
  }

  [[nodiscard]] Result<void> prove(const std::string& id) {
    const auto folder = trial_.folder / "fab" / "jobs" / id;
    if (!await([&] { return job_at(fab_, id).value("state", "") == "done"; }))
      return fail(ErrorCode::Internal, "done at the scan site alone: " + job_at(fab_, id).dump());
    for (const Daemon* site : {&fab_, &scan_})
      if (!await([&] { return has_all_counters(job_at(*site, id)); }, 5s))
        return fail(ErrorCode::Internal,
                    "its counters are not those of a print that is done: " + job_at(*site, id).dump());
    const Outcome verified = test::run({(trial_.bin / "telefab-fab").string(), "verify", (folder / "plan").string(),
                                        "--machines", (trial_.folder / "machines").string(), "--as-built",
                                        (folder / "report" / "as-built.json").string()});
    if (verified.code != 0)
      return fail(ErrorCode::Internal,
                  fmt::format("the record does not hold ({}): {}{}", verified.code, verified.output, verified.errors));
    for (const Daemon* site : {&fab_, &scan_})
      if (!await([&] { return site->health() == 200; }, 15s))
        return fail(ErrorCode::Internal, "health stays red on a sound disk");
    return {};
  }

  [[nodiscard]] Result<void> go() {
    verdict_.outcome = DiskOutcome::Recovered;
    if (auto started = start(fab_); !started) return started;
    fab_address_ = fab_.address();
    if (auto started = start(scan_); !started) return started;
    const auto id = submit();
    if (!id) return tl::unexpected{id.error()};
    if (auto ended = see_to_its_end(*id); !ended) return ended;
    end_disk_faults();
    if (auto proved = prove(*id); !proved) return proved;
    // Whatever the fault left behind, the next start goes and knows the job.
    fab_.stop();
    scan_.stop();
    for (Daemon* site : {&fab_, &scan_})
      if (auto again = site->start(); !again) return fail_in("the start after it was refused", again.error());
    for (const Daemon* site : {&fab_, &scan_})
      if (job_at(*site, *id).value("state", "") != "done")
        return fail(ErrorCode::Internal, "after a restart it is " + job_at(*site, *id).dump());
    return {};
  }

  DiskTrial trial_;
  SystemClock clock_;
  std::string fab_address_ = "127.0.0.1:0";
  DiskVerdict verdict_;
  Daemon fab_, scan_;
  std::jthread watcher_;
};

}  // namespace

std::string_view name_of(DiskOutcome outcome) {
  switch (outcome) {
    case DiskOutcome::Recovered:
      return "recovered";
    case DiskOutcome::Refused:
      return "refused";
    case DiskOutcome::Held:
      return "held";
    case DiskOutcome::Wrong:
      return "wrong";
  }
  return "wrong";
}

DiskVerdict run_trial(const DiskTrial& trial) { return Trial{trial}.run(); }

}  // namespace telefab::test
