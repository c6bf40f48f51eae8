// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <telefab/base/exit_code.hpp>
#include <telefab/store/fleet_queue.hpp>
#include <telefab/test/two_sites.hpp>
#include <thread>

namespace telefab::test {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using testing::HasSubstr;
using testing::Not;
using Words = std::vector<std::string>;

/// What a program finds in place of its streams.
enum class Streams { Kept, ClosedPipe, FullDisk, ClosedInput, ClosedOutput, FullErrors };
constexpr std::array kTroubles{Streams::ClosedPipe, Streams::FullDisk, Streams::ClosedInput, Streams::ClosedOutput,
                               Streams::FullErrors};
constexpr std::array kNames{"kept", "closed pipe", "full disk", "closed input", "closed output", "full errors"};

std::string text_in(const fs::path& file) {
  std::ifstream in{file, std::ios::binary};
  return {std::istreambuf_iterator<char>{in}, {}};
}

/// Whether the program waits for SIGTERM by now: it is blocked, bit 14 of its mask.
bool waits_for_the_end(pid_t id) {
  const std::string status = text_in(fmt::format("/proc/{}/status", id));
  const auto at = status.find("SigBlk:");
  return at != std::string::npos && ((std::stoull(status.substr(at + 7), nullptr, 16) >> (SIGTERM - 1)) & 1U) != 0;
}

/// One verb with everything it needs.
struct Command {
  Words words;
  bool runs_until_ended = false;
  fs::path ready = {};  ///< appears once it may be told
  fs::path fresh = {};  ///< must not be there when it begins
};

class Programs : public TwoSites {
 protected:
  void SetUp() override {
    setenv("XDG_CONFIG_HOME", (folder() / "config").c_str(), 1);
    start_both();
    job_ = submit_torus();
    ASSERT_EQ(telefab({"watch", job_}).code, 0);
    ASSERT_EQ(ran({bin("telefab-scan"), "slice", torus().string(), "--machine", "toy", "--machines", machines(),
                   "--height-mm", "4", "--out", stack()})
                  .code,
              0);
    ASSERT_EQ(ran({bin("telefab-fab"), "plan", stack(), "--machines", machines(), "--out", planned()}).code, 0);
    std::ofstream{folder() / "square.json"}
        << R"({"type":"Polygon","coordinates":[[[0,0],[20,0],[20,20],[0,20],[0,0]]]})";
    std::ofstream{folder() / "square.cli"}
        << "$$HEADERSTART\n$$ASCII\n$$UNITS/1\n$$LAYERS/2\n$$HEADEREND\n$$GEOMETRYSTART\n$$LAYER/0\n$$LAYER/0.2\n"
           "$$POLYLINE/1,1,5,5,5,15,5,15,15,5,15,5,5\n$$GEOMETRYEND\n";
  }

  [[nodiscard]] static std::string bin(const std::string& program) {
    return std::string{::getenv("TELEFAB_BIN")} + "/" + program;
  }
  [[nodiscard]] std::string machines() const { return (folder() / "machines").string(); }
  [[nodiscard]] std::string stack() const { return (folder() / "torus.tfc").string(); }
  [[nodiscard]] std::string planned() const { return (folder() / "plan").string(); }
  [[nodiscard]] std::string at(const char* name) const { return (folder() / name).string(); }

  /// Runs a command to its end, or until it may be told to end.
  Outcome ran(const Words& words, Streams streams = Streams::Kept, const Command* long_one = nullptr) {
    const fs::path out = folder() / "stdout", err = folder() / "stderr";
    std::array<int, 2> pipe{};
    EXPECT_EQ(::pipe2(pipe.data(), O_CLOEXEC), 0);
    ::close(pipe[0]);
    if (long_one && !long_one->ready.empty()) fs::remove(long_one->ready);
    const pid_t id = ::fork();
    if (id == 0) {
      const auto put = [](int file, int in_place_of) { ::dup2(file, in_place_of); };
      put(::open("/dev/null", O_RDONLY), STDIN_FILENO);
      put(::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDOUT_FILENO);
      put(::open(err.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDERR_FILENO);
      const int full = ::open("/dev/full", O_WRONLY);
      if (streams == Streams::ClosedPipe) put(pipe[1], STDOUT_FILENO);
      if (streams == Streams::FullDisk) put(full, STDOUT_FILENO);
      if (streams == Streams::FullErrors) put(full, STDERR_FILENO);
      for (int file = 3; file < 64; ++file) ::close(file);
      if (streams == Streams::ClosedInput) ::close(STDIN_FILENO);
      if (streams == Streams::ClosedOutput) ::close(STDOUT_FILENO);
      std::vector<char*> arguments;
      for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
      arguments.push_back(nullptr);
      ::alarm(60);  // patience; it outlives exec
      ::execv(arguments[0], arguments.data());
      ::_exit(127);
    }
    ::close(pipe[1]);
    if (long_one) {
      for (int i = 0;
           i < 1000 && (!waits_for_the_end(id) || (!long_one->ready.empty() && !fs::exists(long_one->ready))); ++i)
        std::this_thread::sleep_for(10ms);
      std::this_thread::sleep_for(200ms);
      ::kill(id, SIGTERM);
    }
    int status = 0;
    ::waitpid(id, &status, 0);
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status), text_in(out), text_in(err)};
  }

  [[nodiscard]] std::vector<Command> commands_of_scan() const {
    const std::string m = machines(), data = at("scan2");
    return {
        {{"digitize", "--shape", "sphere", "--height-mm", "4", "--step-deg", "120", "--pitch-mm", "0.3", "--out",
          at("views")}},
        {{"register", at("views"), "--step-deg", "120", "--out", at("joined.ply")}},
        {{"clean", torus().string(), "--out", at("clean.ply")}},
        {{"slice", torus().string(), "--machine", "toy", "--machines", m, "--height-mm", "4", "--out", stack()}},
        {{"slice", torus().string(), "--machine", "toy", "--machines", m, "--height-mm", "4", "--parts", at("parts")}},
        {{"merge", at("parts"), "--out", at("merged.tfc")}},
        {{"inspect", torus().string()}},
        {{"orient", torus().string(), "--machine", "toy", "--machines", m, "--height-mm", "4", "--directions", "1",
          "--best", "1", "--planner", "none"}},
        {{"measure", torus().string(), torus().string()}},
        {{"api"}},
        {{"machines", "--machines", m}},
        {{"resins", "--machines", m}},
        {{"prints", "--machines", m}},
        {{"logs", job_, "--data", at("scan")}},
        {{"audit", "--data", at("scan")}},
        {{"tokens", "list", "--data", at("scan")}},
        {{"page-link", "--data", at("scan")}},
        {{"serve", "--listen", "127.0.0.1:0", "--fab", fab_site(), "--data", data, "--machines", m},
         true,
         fs::path{data} / "port"}};
  }
  [[nodiscard]] std::vector<Command> commands_of_fab() const {
    const std::string m = machines(), data = at("fab2");
    return {{{"plan", stack(), "--machines", m, "--out", planned()}},
            {{"verify", planned(), "--machines", m}},
            {{"export", planned(), "--machines", m, "--format", "sl1", "--out", at("torus.sl1"), "--although",
              "exposures"}},
            {{"import", at("square.cli"), "--machine", "toy", "--machines", m, "--out", at("square.tfc")}},
            {{"predict", planned(), "--machines", m}},
            {{"supports", stack(), "--machines", m}},
            {{"calibrate", "masks", "--machine", "toy", "--machines", m, "--out", at("calibration")},
             false,
             {},
             at("calibration")},
            {{"cover", at("square.json"), "--anchor-mm", "3"}},
            {{"api"}},
            {{"machines", "--machines", m}},
            {{"resins", "--machines", m}},
            {{"prints", "--machines", m}},
            {{"probe", "--machine", "toy", "--machines", m}},
            {{"tokens", "list", "--data", at("fab")}},
            {{"page-link", "--data", at("fab")}},
            {{"logs", job_, "--data", at("fab")}},
            {{"audit", "--data", at("fab")}},
            {{"printers", "--address", "127.0.0.1:1", "--wait-s", "0.1"}},
            {{"send", planned(), "--machines", m, "--to", "127.0.0.1:1"}},
            {{"simulate-printer", "--machine", "toy", "--machines", m, "--port", "0", "--question-port", "0"}, true},
            {{"simulate-usb", "--port", "0"}, true},
            {{"guard-screen"}},
            {{"serve", "--listen", "127.0.0.1:0", "--data", data, "--machines", m}, true, fs::path{data} / "port"}};
  }
  [[nodiscard]] std::vector<Command> commands_of_client() {
    std::vector<Command> all{{{"submit", torus().string(), "--machine", "toy", "--height-mm", "4"}},
                             {{"jobs"}},
                             {{"status", job_}},
                             {{"watch", job_}},
                             {{"approve", job_, "--who", "Ada"}},
                             {{"pause", job_}},
                             {{"resume", job_}},
                             {{"cancel", job_}},
                             {{"report", job_, "--out", at("report")}},
                             {{"machines"}},
                             {{"resins"}},
                             {{"prints"}},
                             {{"forget", "nobody"}},
                             {{"cleared", "nobody"}}};  // a second time would find it empty
    for (Command& command : all) command.words.insert(command.words.end(), {"--site", fab_site()});
    all[0].words.back() = all[8].words.back() = scan_site();
    all.push_back({{"sites"}});
    EXPECT_TRUE(open_fleet_file(at("fleet.sqlite"), SystemClock{}));
    all.push_back({{"fleet", "machines", "--fleet", "sqlite:" + at("fleet.sqlite")}});
    (void)ran({bin("telefab"), "certs", "authority", "--dir", at("authority")});
    all.push_back({{"certs", "issue", "ana", "operator", "--dir", at("authority")}});
    return all;
  }

  /// All verbs that the program names, each under every trouble.
  void try_every_verb(const std::string& program, std::vector<Command> commands) {
    commands.push_back({{"manual"}});
    commands.push_back({{"completion", "bash"}});
    commands.push_back({{"--help"}});
    commands.push_back({{"--version"}});
    commands.push_back({{"no-such-verb"}});
    std::set<std::string> tried;
    for (Command& command : commands) {
      tried.insert(command.words.front());
      command.words.insert(command.words.begin(), bin(program));
      // Each is tried again and again, into the same files.
      const bool is_writer = std::ranges::any_of(
          command.words, [](const std::string& word) { return word == "--out" || word == "--out-prefix"; });
      if (is_writer) command.words.push_back("--force");
      try_one(command);
    }
    static const std::regex verb{R"(^  ([a-z-]+)  +\S.*$)"};
    const std::string help = ran({bin(program), "--help"}).output;
    std::istringstream lines{help.substr(help.find("Subcommands:"))};
    std::smatch found;
    for (std::string line; std::getline(lines, line) && !line.starts_with("Example");)
      if (std::regex_match(line, found, verb)) {
        EXPECT_TRUE(tried.contains(found[1])) << found[1] << " is tried by nothing; give it a row";
      }
  }

  void try_one(const Command& command) {
    const Command* long_one = command.runs_until_ended ? &command : nullptr;
    const auto run_with = [&](Streams streams) {
      if (!command.fresh.empty()) fs::remove_all(command.fresh);
      return ran(command.words, streams, long_one);
    };
    const Outcome plain = run_with(Streams::Kept);
    ASSERT_GE(plain.code, 0) << command.words[1];
    ASSERT_NE(plain.code, static_cast<int>(ExitCode::Internal)) << command.words[1] << plain.errors;
    for (const Streams trouble : kTroubles) {
      SCOPED_TRACE(fmt::format("{} with {}", command.words[1], kNames[static_cast<std::size_t>(trouble)]));
      const Outcome tried = run_with(trouble);
      const bool is_lost = trouble == Streams::FullDisk && !plain.output.empty();
      const int expected = is_lost && plain.code == 0 ? static_cast<int>(ExitCode::Storage) : plain.code;
      EXPECT_EQ(tried.code, expected) << tried.errors;
      EXPECT_THAT(tried.errors, Not(HasSubstr("fault of Telefab")));
      EXPECT_THAT(tried.errors, Not(HasSubstr("terminate")));
      const auto complaints = [](const std::string& text) {
        return text.find("standard output") == std::string::npos ? 0 : 1;
      };
      EXPECT_EQ(complaints(tried.errors), is_lost && plain.code == 0 ? 1 : 0) << tried.errors;
      if (trouble == Streams::ClosedInput && !long_one) {
        EXPECT_EQ(tried.output.empty(), plain.output.empty());
      }
    }
  }

 private:
  std::string job_;
};

TEST_F(Programs, OfTheScanSiteBearClosedPipesFullDisksAndClosedStreams) {
  try_every_verb("telefab-scan", commands_of_scan());
}

TEST_F(Programs, OfTheFabSiteBearClosedPipesFullDisksAndClosedStreams) {
  try_every_verb("telefab-fab", commands_of_fab());
}

TEST_F(Programs, OfTheOperatorBearClosedPipesFullDisksAndClosedStreams) {
  try_every_verb("telefab", commands_of_client());
}

TEST_F(Programs, ClosedOutputNeverEndsUpInAFileThatIsWritten) {
  const Words words{bin("telefab-scan"), "slice", torus().string(), "--machine", "toy",    "--machines", machines(),
                    "--height-mm",       "4",     "--out",          at("a.tfc"), "--force"};
  ASSERT_EQ(ran(words, Streams::Kept).code, 0);
  const std::string kept = text_in(at("a.tfc"));
  ASSERT_EQ(ran(words, Streams::ClosedOutput).code, 0);
  EXPECT_EQ(text_in(at("a.tfc")), kept);
}

// The verifier once chose its physics by a search in report.json.
TEST_F(Programs, VerifyGivesTheSameVerdictWhateverReportJsonLooksLike) {
  const Words words{bin("telefab-fab"), "verify", planned(), "--machines", machines()};
  const Outcome before = ran(words);
  ASSERT_EQ(before.code, 0) << before.output;
  const fs::path report = fs::path{planned()} / "report.json";
  std::string dense = text_in(report);
  std::erase_if(dense, [](char c) { return c == ' ' || c == '\n'; });
  std::ofstream{report} << dense;
  EXPECT_EQ(ran(words).output, before.output);
  fs::remove(report);
  EXPECT_EQ(ran(words).output, before.output);
}

}  // namespace
}  // namespace telefab::test
