// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <atomic>
#include <deque>
#include <fstream>
#include <telefab/test/http_client.hpp>
#include <thread>

#include "web_fab.hpp"

// What the page's server stands during a print.
//   campaign_web BIN FOLDER hostile COUNT          malformed requests; nothing may change, nothing may fall over
//   campaign_web BIN FOLDER watchers COUNT SECONDS watchers of the event stream, while one address opens as many
//                                                  connections as it can; the print keeps its time, operators are
//                                                  served
//   campaign_web BIN FOLDER page FILE.tfc MACHINES what a browser needs for the page of a planned job
//   campaign_web look PORT                         the same of a page that is served there, of either site
namespace {

using namespace telefab;
using namespace telefab::test;

/// What must not change under attack: jobs, their states, the audit log but for what it says of the attack.
std::string state_of(const WebFab& fab) {
  std::istringstream log{fab.text_of(fab.data() / "audit.log")};
  std::string state;
  for (std::string line; std::getline(log, line);)
    if (line.find(R"("what":"refused: )") == std::string::npos)
      state += nlohmann::json::parse(line)["what"].dump() + "\n";
  const auto jobs = nlohmann::json::parse(http_body(http_ask(fab.port(), "GET", "/v1/jobs")), nullptr, false);
  if (!jobs.is_object()) return "no answer";
  for (const auto& job : jobs["jobs"])
    state += fmt::format("{} {} {}\n", job.value("id", ""), job.value("state", ""), job.value("message", ""));
  for (const auto& entry : std::filesystem::directory_iterator{fab.data() / "jobs"})
    state += entry.path().filename().string() + "\n";
  return state;
}

int hostile(const WebFab& fab, std::size_t count) {
  // Long enough for the second half: an attack takes about a millisecond, a layer thirty.
  const std::string job = fab.upload(static_cast<std::uint32_t>(std::max<std::size_t>(60, count / 20)));
  if (!fab.wait_for(job, "printing", 60)) return fmt::print("the print did not begin\n"), 1;
  // Held, so that the state may not move by itself either.
  if (!fab.act(job, "pause") || !fab.wait_for(job, "paused", 60)) return fmt::print("the print could not be held\n"), 1;
  const std::string before = state_of(fab);
  const HostileCount found = ask_hostile(fab.port(), job, count, 5);
  const bool same = state_of(fab) == before;
  const bool alive = fab.is_alive();
  if (!fab.act(job, "resume") || !fab.wait_for(job, "printing", 60)) return fmt::print("the print did not go on\n"), 1;
  // As many again while layers are exposed.
  const HostileCount during = ask_hostile(fab.port(), job, count, 6);
  const auto after = fab.job(job);
  const bool printing = after.value("state", "") == "printing";
  const bool done = fab.wait_for(job, "done", 1200);
  fmt::print(
      "{} requests on a held print, {} while it ran (at layer {} of {} after them): {} wrong answers{}, state {}, "
      "daemon {}, print {}\n",
      found.asked, during.asked, after.value("layers_printed", 0), after.value("layers", 0), found.wrong + during.wrong,
      found.wrong    ? " (" + found.first_wrong + ")"
      : during.wrong ? " (" + during.first_wrong + ")"
                     : "",
      same ? "unchanged" : "CHANGED", alive ? "alive" : "DEAD", done ? "done" : "NOT DONE");
  if (!printing) fmt::print("the print was over before the last request\n");
  return same && alive && printing && done && found.wrong + during.wrong == 0 ? 0 : 1;
}

/// Seconds from the start of each layer's light to that of the next, by the machine's clock.
std::vector<double> periods_of(const WebFab& fab, const std::string& job) {
  const auto record =
      nlohmann::json::parse(fab.text_of(fab.data() / "jobs" / job / "report" / "print.json"), nullptr, false);
  std::vector<double> starts, periods;
  if (record.is_object())
    for (const auto& layer : record["layers"])
      starts.push_back(static_cast<double>(layer["started_wall_ns"].get<std::int64_t>()) * 1e-9);
  for (std::size_t i = 1; i < starts.size(); ++i) periods.push_back(starts[i] - starts[i - 1]);
  return periods;
}

/// Reads from every watcher what has come, for that long; the bytes read.
std::uint64_t read_all(const std::vector<std::unique_ptr<HttpClient>>& watchers, int wait_ms) {
  std::vector<pollfd> polls;
  for (const auto& watcher : watchers) polls.push_back({watcher->descriptor(), POLLIN, 0});
  std::uint64_t bytes = 0;
  if (::poll(polls.data(), polls.size(), wait_ms) <= 0) return 0;
  char buffer[65536];
  for (const pollfd& each : polls)
    if (each.revents & POLLIN)
      if (const ssize_t got = ::recv(each.fd, buffer, sizeof buffer, 0); got > 0)
        bytes += static_cast<std::uint64_t>(got);
  return bytes;
}

/// Opens connections from one address that is nobody's, and says nothing on them, as fast as they are taken.
class Flood {
 public:
  explicit Flood(std::uint16_t port)
      : thread_{[this, port](const std::stop_token& stop) {
          std::deque<std::unique_ptr<HttpClient>> open;
          while (!stop.stop_requested()) {
            open.push_back(std::make_unique<HttpClient>(port, 1, "127.0.0.2"));
            opened_ += open.back()->connected() ? 1 : 0;
            if (open.size() > kAtOnce) open.pop_front();
            std::this_thread::sleep_for(std::chrono::milliseconds{1});
          }
        }} {}
  [[nodiscard]] std::uint64_t opened() const { return opened_; }

 private:
  static constexpr std::size_t kAtOnce = 500;
  std::atomic<std::uint64_t> opened_ = 0;
  std::jthread thread_;
};

/// Asks as an operator does, twice a second.
class OperatorAsking {
 public:
  explicit OperatorAsking(const WebFab& fab)
      : thread_{[this, &fab](const std::stop_token& stop) {
          const SystemClock clock;
          while (!stop.stop_requested()) {
            const Nanoseconds began = clock.now();
            const bool served = http_ask(fab.port(), "GET", "/v1/jobs", "X-Api-Key: " + fab.token() + "\r\n")
                                    .starts_with("HTTP/1.1 200");
            const double took_ms = std::chrono::duration<double, std::milli>(clock.now() - began).count();
            ++asked_, refused_ += served ? 0 : 1;
            worst_ms_ = std::max(worst_ms_.load(), took_ms);
            std::this_thread::sleep_for(std::chrono::milliseconds{500});
          }
        }} {}
  [[nodiscard]] std::uint32_t asked() const { return asked_; }
  [[nodiscard]] std::uint32_t refused() const { return refused_; }
  [[nodiscard]] double worst_ms() const { return worst_ms_; }

 private:
  std::atomic<std::uint32_t> asked_ = 0, refused_ = 0;
  std::atomic<double> worst_ms_ = 0;
  std::jthread thread_;
};

int watchers(const WebFab& fab, std::size_t count, double seconds) {
  // About 6 s a layer on the small machine.
  const auto layers = static_cast<std::uint32_t>(std::max(10.0, seconds / 6));
  const std::string alone = fab.upload(10);
  if (!fab.wait_for(alone, "done", 600)) return fmt::print("the print alone did not end\n"), 1;
  const std::string job = fab.upload(layers);
  if (!fab.wait_for(job, "printing", 60)) return fmt::print("the print did not begin\n"), 1;
  std::vector<std::unique_ptr<HttpClient>> list;
  for (std::size_t i = 0; i < count; ++i) {
    list.push_back(std::make_unique<HttpClient>(fab.port()));
    list.back()->send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
    if (list.back()->read_until("data:").find("200 OK") == std::string::npos)
      return fmt::print("a watcher was refused\n"), 1;
  }
  auto flood = std::make_unique<Flood>(fab.port());
  auto asking = std::make_unique<OperatorAsking>(fab);
  const SystemClock clock;
  const Nanoseconds began = clock.now();
  const auto passed_s = [&] { return std::chrono::duration<double>(clock.now() - began).count(); };
  const WebFab::Use first = fab.use();
  double at_tenth_mb = 0;
  std::uint64_t bytes = 0;
  while (passed_s() < seconds) {
    bytes += read_all(list, 500);
    if (at_tenth_mb == 0 && passed_s() > seconds / 10) at_tenth_mb = fab.use().resident_mb;
  }
  const WebFab::Use last = fab.use();
  const double watched_s = passed_s();
  const double cores = (last.cpu_s - first.cpu_s) / watched_s;
  const auto at_end = fab.job(job);
  const std::uint64_t flooded = flood->opened();
  const std::uint32_t asked = asking->asked(), refused = asking->refused();
  const double slowest_ms = asking->worst_ms();
  flood.reset(), asking.reset();
  list.clear();
  if (!fab.wait_for(job, "done", 1200)) return fmt::print("the print did not end\n"), 1;
  auto without = periods_of(fab, alone), with = periods_of(fab, job);
  const std::size_t skip = 4;  // bottom layers, and the first above them
  if (without.size() <= skip || with.size() <= skip) return fmt::print("the record has too few layers\n"), 1;
  const double usual = *std::max_element(without.begin() + skip, without.end());
  const double worst = *std::max_element(with.begin() + skip, with.end());
  fmt::print(
      "{} watchers for {:.0f} s, print at layer {} of {}: {:.3f} cores, {:.1f} kB read, {:.1f} MB after a tenth, "
      "{:.1f} MB at the "
      "end; longest period of a layer {:.3f} s alone, {:.3f} s watched; {} connections from one address, {} of {} "
      "questions of an operator refused, the slowest after {:.0f} ms\n",
      count, watched_s, at_end.value("layers_printed", 0), at_end.value("layers", 0), cores,
      static_cast<double>(bytes) * 1e-3, at_tenth_mb, last.resident_mb, usual, worst, flooded, refused, asked,
      slowest_ms);
  return cores <= 1 && last.resident_mb < at_tenth_mb * 1.1 + 2 && worst < usual * 1.05 + 0.05 && refused == 0 ? 0 : 1;
}

bool is_in_time(const PageFigures& figures) {
  return figures.first_paint_ms <= 800 && figures.scrub.worst_ms <= 100 && figures.process_mb < 200;
}

int look(std::uint16_t port) {
  const PageFigures figures = look_at_page(port);
  fmt::print("{}\n", sentence_of(figures));
  return is_in_time(figures) ? 0 : 1;
}

int page(const WebFab& fab, const std::filesystem::path& tfc, const std::filesystem::path& folder) {
  const std::string job = fab.upload(tfc.filename().string(), fab.text_of(tfc), false);
  if (!fab.wait_for(job, "awaiting-approval", 600))
    return fmt::print("the job was not planned: {}\n", fab.job(job).dump()), 1;
  const auto layers = fab.job(job).value("layers", 1U);
  const PageFigures figures = look_at_page(fab.port());
  fmt::print("{}\n", sentence_of(figures));
  // A picture of a print half done.
  (void)fab.act(job, "approve");
  const SystemClock clock;
  for (const Nanoseconds end = clock.now() + std::chrono::seconds{60};
       clock.now() < end && fab.job(job).value("layers_printed", 0U) < layers / 2;) {
  }
  (void)fab.act(job, "pause");
  (void)fab.wait_for(job, "paused", 30);
  take_pictures(fab.port(), folder);
  return is_in_time(figures) ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words{argv + 1, argv + argc};
  try {
    if (words.size() == 2 && words[0] == "look") return look(static_cast<std::uint16_t>(std::stoul(words[1])));
    if (words.size() == 4 && words[2] == "hostile")
      return hostile(WebFab{words[0], words[1], 200}, std::stoul(words[3]));
    if (words.size() == 5 && words[2] == "watchers")
      return watchers(WebFab{words[0], words[1], 1}, std::stoul(words[3]), std::stod(words[4]));
    if (words.size() == 5 && words[2] == "page")
      return page(WebFab{words[0], words[1], 2000, words[4]}, words[3], words[1]);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 1;
  }
  fmt::print(stderr,
             "campaign_web BIN FOLDER hostile COUNT | watchers COUNT SECONDS | page FILE.tfc MACHINES; or look PORT\n");
  return 2;
}
