// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <map>
#include <mutex>
#include <random>
#include <set>
#include <sstream>
#include <telefab/base/clock.hpp>
#include <telefab/store/fleet_queue.hpp>
#include <telefab/test/campaign_main.hpp>
#include <telefab/test/postgres_server.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <thread>

#include "light_fab.hpp"

// A fleet of light fabs (light_fab.hpp), each a process, and scan sites that only submit, on one PostgreSQL server of
// its own: fed, killed by a seed, and counted. Ends with a table, and with 1 where a job was lost or lit twice.

namespace telefab::test {
namespace {

using Steady = std::chrono::steady_clock;
using namespace std::chrono_literals;
namespace fs = std::filesystem;

constexpr int kSkipped = 77;

struct Options {
  std::map<std::string, int> values{{"machines", 100},    {"fabs", 8},        {"sites", 4},         {"jobs", 1000},
                                    {"seconds", 60},      {"print-ms", 5000}, {"lease-ms", 30'000}, {"kill-fabs", 0},
                                    {"kill-database", 0}, {"seed", 1},        {"wait-s", 120}};
  [[nodiscard]] int operator[](const char* name) const { return values.at(name); }
};

/// Processor time of a server and all that it has begun, looked at now and again: what ends in between is lost.
class ServerTime {
 public:
  explicit ServerTime(const PostgresServer& server) : server_{server} {}
  void look() {
    const pid_t main = server_.id();
    if (main <= 0) return;
    for (const auto& entry : fs::directory_iterator{"/proc"}) {
      const std::string name = entry.path().filename().string();
      if (name.find_first_not_of("0123456789") != std::string::npos) continue;
      std::ifstream file{entry.path() / "stat"};
      std::string line;
      std::getline(file, line);
      const auto end = line.rfind(')');
      if (end == std::string::npos) continue;
      std::istringstream words{line.substr(end + 1)};
      std::string state;
      long parent = 0, skipped = 0;
      long user = 0, system = 0;
      words >> state >> parent;
      for (int i = 0; i < 9; ++i) words >> skipped;
      words >> user >> system;
      if (parent == main || name == std::to_string(main)) ticks_[name] = user + system;
    }
  }
  [[nodiscard]] double seconds() const {
    long sum = 0;
    for (const auto& [pid, ticks] : ticks_) sum += ticks;
    return static_cast<double>(sum) / static_cast<double>(::sysconf(_SC_CLK_TCK));
  }

 private:
  const PostgresServer& server_;
  std::map<std::string, long> ticks_;
};

class Campaign {
 public:
  Campaign(const Options& o, PostgresServer& server)
      : o_{o}, server_{server}, uri_{server.uri_of("fleet")}, random_{static_cast<std::uint32_t>(o["seed"])} {
    for (int i = 0; i < o["fabs"]; ++i) {
      LightFab fab{uri_, fmt::format("fab{:02}", i), scratch_.path() / fmt::format("fab{:02}", i)};
      fab.machines = o["machines"] / o["fabs"] + (i < o["machines"] % o["fabs"] ? 1 : 0);
      fab.print_ms = o["print-ms"], fab.lease_ms = o["lease-ms"];
      fabs_.push_back(std::move(fab));
    }
  }
  ~Campaign() {
    for (std::size_t i = 0; i < pids_.size(); ++i) kill_fab(i);
  }

  int run() {
    (void)open_fleet(uri_, clock_);  // makes the tables
    pids_.assign(fabs_.size(), 0);
    for (std::size_t i = 0; i < fabs_.size(); ++i) start_fab(i);
    const auto began = Steady::now();
    ServerTime time{server_};
    std::vector<std::jthread> sites;
    for (int site = 0; site < o_["sites"]; ++site)
      sites.emplace_back([this, site](const std::stop_token& stop) { submit(site, stop); });
    const auto strikes = strikes_by_seed(began);
    auto strike = strikes.begin();
    std::size_t done = 0;
    const auto last = began + std::chrono::seconds{o_["seconds"] + o_["wait-s"]};
    while (Steady::now() < last && done < static_cast<std::size_t>(o_["jobs"])) {
      std::this_thread::sleep_for(200ms);
      for (; strike != strikes.end() && strike->at <= Steady::now(); ++strike) hit(*strike);
      time.look();
      if (strike == strikes.end() && submitted_ == o_["jobs"]) done = count_done();
    }
    const double took_s = since(began);
    time.look();
    for (std::jthread& site : sites) site.request_stop();
    sites.clear();
    for (std::size_t i = 0; i < pids_.size(); ++i) kill_fab(i);
    return judge(took_s, time.seconds());
  }

 private:
  struct Strike {
    Steady::time_point at;
    int fab = -1;  ///< below 0: the database
  };
  static double since(Steady::time_point began) { return std::chrono::duration<double>(Steady::now() - began).count(); }
  std::vector<Strike> strikes_by_seed(Steady::time_point began) {
    std::vector<Strike> all;
    const auto when = [&] {
      return began + std::chrono::milliseconds{std::uniform_int_distribution{500, o_["seconds"] * 1000}(random_)};
    };
    for (int i = 0; i < o_["kill-fabs"]; ++i)
      all.push_back({when(), std::uniform_int_distribution{0, o_["fabs"] - 1}(random_)});
    for (int i = 0; i < o_["kill-database"]; ++i) all.push_back({when(), -1});
    std::ranges::sort(all, {}, &Strike::at);
    return all;
  }
  void hit(const Strike& strike) {
    if (strike.fab < 0) {
      server_.kill();
      const auto began = Steady::now();
      if (!server_.run()) throw std::runtime_error{"the database does not come back"};
      database_away_s_ += since(began);
      return;
    }
    kill_fab(static_cast<std::size_t>(strike.fab));
    start_fab(static_cast<std::size_t>(strike.fab));
  }
  void start_fab(std::size_t place) {
    std::vector<std::string> words = words_of(fabs_[place]);
    words.insert(words.begin(), "/proc/self/exe");
    const pid_t pid = ::fork();
    if (pid != 0) {
      pids_[place] = pid;
      return;
    }
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    ::execv("/proc/self/exe", arguments.data());
    ::_exit(70);
  }
  void kill_fab(std::size_t place) {
    if (pids_[place] <= 0) return;
    ::kill(pids_[place], SIGKILL);
    ::waitpid(std::exchange(pids_[place], 0), nullptr, 0);
  }

  /// Every acknowledged job is noted; what was not is asked again, as scan sites do.
  void submit(int site, const std::stop_token& stop) {
    std::unique_ptr<FleetQueue> queue;
    const auto began = Steady::now();
    for (int number = site; number < o_["jobs"] && !stop.stop_requested(); number += o_["sites"]) {
      std::this_thread::sleep_until(
          began + std::chrono::milliseconds{std::int64_t{1000} * o_["seconds"] * number / std::max(o_["jobs"], 1)});
      fleet::NewJob job;
      job.id = fmt::format("s{}-j{}", site, number);
      job.name = "part.ply", job.owner = "ana", job.site = fmt::format("s{}", site);
      job.needs.light = "light", job.needs.width_mm = 10;
      for (bool is_kept = false; !is_kept && !stop.stop_requested();) {
        if (!queue)
          if (auto opened = open_fleet(uri_, clock_)) queue = std::move(*opened);
        is_kept = queue && queue->submit(job).has_value();
        if (is_kept) break;
        queue.reset();
        std::this_thread::sleep_for(100ms);
      }
      if (stop.stop_requested()) return;
      const std::lock_guard lock{mutex_};
      acknowledged_.insert(job.id);
      ++submitted_;
    }
  }

  std::size_t count_done() {
    if (!queue_) {
      auto opened = open_fleet(uri_, clock_);
      if (!opened) return 0;
      queue_ = std::move(*opened);
    }
    // Only the last look reads all of them.
    const auto open = queue_->jobs(fleet::kOpenStates, 0, 1);
    if (!open) queue_.reset();
    return open && open->empty() ? static_cast<std::size_t>(submitted_) : 0;
  }

  int judge(double took_s, double database_s) {
    auto opened = open_fleet(uri_, clock_);
    if (!opened) throw std::runtime_error{opened.error().what};
    std::map<std::string, fleet::State> states;
    const auto all = (*opened)->jobs({}, 0, 10'000'000).value();
    for (const fleet::Job& job : all) states[job.id] = job.state;
    std::size_t lost = 0, unfinished = 0;
    for (const std::string& job : acknowledged_) {
      lost += !states.contains(job);
      unfinished += states.contains(job) && states[job] != fleet::State::Done;
    }
    std::map<std::pair<std::string, int>, int> lit;
    std::vector<double> starts_ms;
    for (const LightFab& fab : fabs_) {
      std::ifstream journal{fab.journal};
      std::string what, job;
      for (std::string line; std::getline(journal, line);) {
        std::istringstream words{line};
        double number = 0;
        int layer = 0;
        words >> what >> job >> number;
        if (what == "lit" && words >> layer) ++lit[{job, layer}];
        if (what == "started") starts_ms.push_back(number / 1000);
      }
    }
    const auto doubled = std::ranges::count_if(lit, [](const auto& each) { return each.second > 1; });
    std::size_t dark = 0;  // done, and a layer of it was never lit
    for (const auto& [job, state] : states)
      for (int layer = 0; state == fleet::State::Done && layer < fabs_.front().layers; ++layer)
        dark += !lit.contains({job, layer});
    std::ranges::sort(starts_ms);
    const auto of = [&](double share) {
      return starts_ms.empty() ? 0.0
                               : starts_ms[static_cast<std::size_t>(share * static_cast<double>(starts_ms.size() - 1))];
    };
    fmt::print("| | |\n|---|---|\n");
    fmt::print("| machines, in fabs, scan sites | {}, {}, {} |\n", o_["machines"], o_["fabs"], o_["sites"]);
    fmt::print("| jobs acknowledged, in s | {}, {:.0f} |\n", acknowledged_.size(), took_s);
    fmt::print("| claim to start, median, 99 %, worst | {:.0f}, {:.0f}, {:.0f} ms |\n", of(0.5), of(0.99), of(1));
    fmt::print("| database | {:.2f} cores |\n", database_s / took_s);
    fmt::print("| kill -9 of fabs, of the database (away {:.1f} s) | {}, {} |\n", database_away_s_, o_["kill-fabs"],
               o_["kill-database"]);
    fmt::print("| acknowledged jobs lost | {} |\n| not done | {} |\n", lost, unfinished);
    fmt::print("| layers lit twice | {} |\n| never lit | {} |\n| seed | {} |\n", doubled, dark, o_["seed"]);
    return lost + unfinished + static_cast<std::size_t>(doubled) + dark == 0 &&
                   acknowledged_.size() == static_cast<std::size_t>(o_["jobs"])
               ? 0
               : 1;
  }

  const Options& o_;
  PostgresServer& server_;
  std::string uri_;
  std::mt19937 random_;
  ScratchFolder scratch_;
  SystemClock clock_;
  std::vector<LightFab> fabs_;
  std::vector<pid_t> pids_;
  std::unique_ptr<FleetQueue> queue_;
  std::mutex mutex_;  ///< guards what follows
  std::set<std::string> acknowledged_;
  std::atomic<int> submitted_ = 0;
  double database_away_s_ = 0;
};

int run(const std::vector<std::string>& words) {
  if (!words.empty() && words.front() == "fab") print_for_ever(light_fab_from(words));
  Options options;
  for (std::size_t i = 0; i < words.size(); i += 2) {
    const std::string name = words[i].starts_with("--") ? words[i].substr(2) : "";
    if (!options.values.contains(name) || i + 1 == words.size()) {
      std::string known;
      for (const auto& [each, value] : options.values) known += fmt::format(" --{} {}", each, value);
      fmt::print(stderr, "campaign_fleet:{}\n", known);
      return 2;
    }
    options.values[name] = std::stoi(words[i + 1]);
  }
  const auto server = PostgresServer::start();
  if (!server) {
    fmt::print("no PostgreSQL 15 server on this computer: skipped\n");
    return kSkipped;
  }
  return Campaign{options, *server}.run();
}

}  // namespace
}  // namespace telefab::test

int main(int count, char** words) { return telefab::test::campaign_main(count, words, telefab::test::run); }
