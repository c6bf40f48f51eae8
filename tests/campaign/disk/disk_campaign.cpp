// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <telefab/test/campaign_main.hpp>
#include <thread>
#include <vector>

#include "disk_trial.hpp"

// Every write, read and remove of both daemons fails once, and from there on until somebody mends the disk: with EIO, a
// write that goes on failing with ENOSPC or EROFS. Each fax must end recovered, refused or held with its reason; a
// trial is a process of its own.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
namespace fs = std::filesystem;

constexpr auto kLongestTrial = 150s;

constexpr std::array<const char*, 3> kNames{"writes", "reads", "removes"};  // by DiskCalls

/// The verdict that the trial's process printed.
nlohmann::json verdict_of(const DiskTrial& trial) {
  fs::create_directories(trial.folder.parent_path());
  const std::string out = trial.folder.string() + ".out";
  const pid_t child = ::fork();
  if (child == 0) {
    ::setpgid(0, 0);
    const int file = ::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    for (const int stream : {1, 2}) ::dup2(file, stream);
    const std::string at = std::to_string(trial.at), error = std::to_string(trial.error);
    ::execl("/proc/self/exe", "campaign_disk", trial.bin.c_str(), trial.folder.c_str(), "trial", trial.site.c_str(),
            at.c_str(), error.c_str(), trial.stays ? "stays" : "once", kNames.at(static_cast<std::size_t>(trial.calls)),
            trial.ending.c_str(), nullptr);
    ::_exit(127);
  }
  int status = 0;
  pid_t ended = 0;
  for (const auto end = std::chrono::steady_clock::now() + kLongestTrial;
       (ended = ::waitpid(child, &status, WNOHANG)) == 0 && std::chrono::steady_clock::now() < end;)
    std::this_thread::sleep_for(10ms);
  if (ended == 0) {
    ::kill(-child, SIGKILL);
    ::waitpid(child, &status, 0);
    return {{"outcome", "wrong"}, {"what", "it hangs; see " + out}};
  }
  std::ifstream in{out};
  nlohmann::json verdict;
  for (std::string line; std::getline(in, line);)
    if (line.starts_with("{\"outcome\""))
      if (auto read = nlohmann::json::parse(line, nullptr, false); read.is_object()) verdict = std::move(read);
  if (!WIFEXITED(status) || !verdict.is_object())
    return {{"outcome", "wrong"}, {"what", fmt::format("it died, status {}; see {}", status, out)}};
  if (verdict["outcome"] != "wrong") fs::remove(out);
  return verdict;
}

int print_trial(const DiskTrial& trial) {
  const DiskVerdict verdict = run_trial(trial);
  const nlohmann::ordered_json json{{"outcome", name_of(verdict.outcome)},
                                    {"what", verdict.what},
                                    {"fault", verdict.fault},
                                    {"operations", verdict.operations},
                                    {"unhealthy", verdict.was_unhealthy}};
  fmt::print("\n{}\n", json.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace));
  return 0;
}

/// How calls of one kind fail.
struct Failure {
  DiskCalls calls;
  int error;
  bool stays;
};
constexpr std::array<Failure, 7> kFailures{{{DiskCalls::Writes, EIO, false},
                                            {DiskCalls::Writes, ENOSPC, true},
                                            {DiskCalls::Writes, EROFS, true},
                                            {DiskCalls::Reads, EIO, false},
                                            {DiskCalls::Reads, EIO, true},
                                            {DiskCalls::Removes, EIO, false},
                                            {DiskCalls::Removes, EIO, true}}};

/// One kind of call on the disk of one site, and how it fails.
struct Sweep {
  fs::path bin, folder;
  std::string site;
  Failure failure;

  /// Every `step`-th of the calls fails in turn, beginning with the `first`. How many faxes were wrong.
  [[nodiscard]] int run(std::uint64_t operations, std::uint64_t first, std::uint64_t step, bool is_talkative) const {
    const auto [calls, error, stays] = failure;
    const std::string name = fmt::format("{} {} {}, {}", site, kNames.at(static_cast<std::size_t>(calls)),
                                         error == EIO     ? "EIO"
                                         : error == EROFS ? "EROFS"
                                                          : "ENOSPC",
                                         stays ? "stays" : "once");
    std::map<std::string, std::uint64_t> counts;
    std::uint64_t trials = 0;
    for (std::uint64_t at = first; at <= operations; at += step) {
      const auto verdict = verdict_of({bin, folder / "trial", site, at, error, stays, calls});
      const std::string outcome = verdict["outcome"];
      ++counts[outcome];
      ++trials;
      if (verdict.value("unhealthy", false)) ++counts["unhealthy"];
      if (outcome != "recovered" || is_talkative)
        fmt::print(stderr, "{} {}: {} {}: {}\n", name, at, outcome, verdict.value("fault", ""),
                   verdict.value("what", ""));
      if (outcome == "wrong") keep(at);
    }
    fmt::print("| {} | {} | {} | {} | {} | {} | {} | {} |\n", name, operations, trials, counts["recovered"],
               counts["refused"], counts["held"], counts["wrong"], counts["unhealthy"]);
    std::fflush(stdout);
    return static_cast<int>(counts["wrong"]);
  }
  /// What a wrong trial left behind, for whoever looks for the reason.
  void keep(std::uint64_t at) const {
    const auto kept = fmt::format("wrong-{}-{}-{}-{}-{}", site, kNames.at(static_cast<std::size_t>(failure.calls)),
                                  failure.error, failure.stays ? "stays" : "once", at);
    std::error_code ignored;  // a folder of the same trial before
    fs::remove_all(folder / kept, ignored);
    fs::rename(folder / "trial", folder / kept, ignored);
    fs::rename(folder / "trial.out", folder / (kept + ".out"), ignored);
  }
};

/// Faults that once ended wrong, each under the name of its file.
int once_wrong(const fs::path& bin, const fs::path& folder) {
  // The scan site gave up a job whose layers it could not read once.
  const DiskTrial chunks{bin, folder / "trial", "scan", 1, EIO, false, DiskCalls::Reads, "/chunks"};
  DiskTrial chunks_for_a_while = chunks;
  chunks_for_a_while.stays = true;
  // And one whose layers it could not write, for a file system that turns read-only was taken for a missing permission.
  const DiskTrial read_only{bin, folder / "trial", "scan", 2, EROFS, true, DiskCalls::Writes, "/chunks"};
  // And one whose report could not have its folder: the write that followed said that the path was wrong.
  const DiskTrial report{bin, folder / "trial", "scan", 1, EIO, false, DiskCalls::Writes, "/report"};
  int wrong = 0;
  for (const DiskTrial& trial : {chunks, chunks_for_a_while, read_only, report}) {
    const auto verdict = verdict_of(trial);
    if (verdict["outcome"] == "recovered" && verdict["fault"] != "") continue;
    fmt::print(stderr, "{} {}: {}\n", trial.site, trial.ending, verdict.dump());
    ++wrong;
  }
  return wrong;
}

/// `most`: trials of each kind of call at each site, spread over its operations.
int campaign(const fs::path& bin, const fs::path& folder, std::uint64_t most) {
  int wrong = once_wrong(bin, folder);
  fmt::print(
      "| disk of, calls, fails | operations | trials | recovered | refused | held | wrong | health said so |\n"
      "|---|---|---|---|---|---|---|---|\n");
  for (const std::string site : {"fab", "scan"}) {
    const auto sound = verdict_of({bin, folder / "sound", site, 0, 0, false});
    if (sound["outcome"] != "recovered") {
      fmt::print(stderr, "a fax over a sound disk: {}\n", sound.dump());
      return 5;
    }
    for (const Failure& failure : kFailures) {
      const auto operations = sound["operations"][static_cast<std::size_t>(failure.calls)].get<std::uint64_t>();
      const std::uint64_t step = std::max<std::uint64_t>(1, operations * 2 / std::max<std::uint64_t>(most, 1));
      // The ways to fail take turns where not every operation is tried.
      const std::uint64_t first = 1 + (failure.stays ? failure.error == EROFS ? step / 4 : 0 : step / 2);
      wrong += Sweep{bin, folder, site, failure}.run(operations, first, step, most >= 1000);
    }
  }
  return wrong == 0 ? 0 : 5;
}

DiskCalls calls_from(const std::string& word) {
  return word == "reads" ? DiskCalls::Reads : word == "removes" ? DiskCalls::Removes : DiskCalls::Writes;
}

int run(const std::vector<std::string>& words) {
  // The fab computes its accuracy pictures by running its own program again, which is this one.
  if (!words.empty() && words[0] == "predict") return 1;
  if (words.size() == 9 && words[2] == "trial")
    return print_trial({words[0], words[1], words[3], std::stoull(words[4]), std::stoi(words[5]), words[6] == "stays",
                        calls_from(words[7]), words[8]});
  if (words.size() == 4 && words[2] == "some") return campaign(words[0], words[1], std::stoull(words[3]));
  if (words.size() == 3 && words[2] == "all") return campaign(words[0], words[1], 1U << 30U);
  fmt::print(stderr,
             "campaign_disk BIN FOLDER all | some TRIALS | trial fab|scan AT ERRNO once|stays "
             "writes|reads|removes ENDING-OF-PATH\n");
  return 1;
}

}  // namespace
}  // namespace telefab::test

int main(int count, char** words) { return telefab::test::campaign_main(count, words, telefab::test::run); }
