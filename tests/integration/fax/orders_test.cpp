// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/test/two_sites.hpp>
#include <thread>

// What a fab that was killed, stopped, or given other files does at its next start: no light without a living order.
// The journal is the recorder: it announces every light before it goes on.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::HasSubstr;
namespace fs = std::filesystem;

class Orders : public TwoSites {
 protected:
  /// A print under way, `layers` layers of it announced.
  void begin_print(std::size_t layers, const std::vector<std::string>& more = {}, double speed_up = 40) {
    set_machine(speed_up);
    start_fab(more);
    start_scan();
    job = submit_torus();
    ASSERT_TRUE(await([&] { return lights() >= layers; })) << says();
  }
  template <class Condition>
  static bool await(Condition condition) {
    for (int tries = 0; tries < 2000; ++tries, std::this_thread::sleep_for(5ms))
      if (condition()) return true;
    return condition();
  }
  [[nodiscard]] fs::path job_folder() const { return folder() / "fab" / "jobs" / job; }
  [[nodiscard]] std::string journal() const {
    return fs::exists(job_folder() / "journal") ? text_of(job_folder() / "journal") : "";
  }
  /// Lights that were announced.
  [[nodiscard]] std::size_t lights() const {
    const std::string text = journal();
    std::size_t count = 0;
    for (std::size_t at = 0; (at = text.find(R"("step":"exposing")", at)) != std::string::npos; ++at) ++count;
    return count;
  }
  [[nodiscard]] Outcome at_fab(const std::vector<std::string>& words) const {
    std::vector<std::string> all = words;
    all.insert(all.end(), {"--site", fab_site()});
    return telefab(all);
  }
  [[nodiscard]] std::string says() const { return at_fab({"jobs"}).output; }
  void end_fab(int signal) {
    if (signal == SIGKILL) return kill_fab();
    fab().send_signal(signal);
    EXPECT_EQ(fab().finish(), 0);
  }
  /// Nothing lights although the fab runs; a layer takes 0.1 s here.
  void expect_dark() {
    const std::size_t before = lights();
    std::this_thread::sleep_for(700ms);
    EXPECT_EQ(lights(), before) << journal();
  }
  [[nodiscard]] Outcome verify_as_built() const {
    return run({std::string{std::getenv("TELEFAB_BIN")} + "/telefab-fab", "verify", (job_folder() / "plan").string(),
                "--machines", (folder() / "machines").string(), "--as-built",
                (job_folder() / "report" / "as-built.json").string()});
  }
  /// Goes on, with a word about the layer that the stop may have left in question.
  [[nodiscard]] Outcome resume(const std::string& who) const {
    const Outcome plain = at_fab({"resume", job, "--who", who});
    return plain.code == 0 ? plain : at_fab({"resume", job, "--as", "treat-as-exposed", "--who", who});
  }
  void finish_quickly(const std::vector<std::string>& more = {}) {
    kill_fab();
    set_machine(5000);
    start_fab(more);
  }

  std::string job;
};

TEST_F(Orders, ACancelledPrintNeverLightsAgain) {
  for (const int signal : {SIGKILL, SIGTERM}) {
    SCOPED_TRACE(signal);
    begin_print(3);
    ASSERT_EQ(at_fab({"cancel", job, "--who", "ana"}).code, 0);
    const std::size_t before = lights();
    end_fab(signal);
    EXPECT_EQ(lights(), before);
    start_fab();
    EXPECT_THAT(says(), HasSubstr("cancelled"));
    expect_dark();
    EXPECT_EQ(lights(), before);
    kill_fab();
    kill_scan();
  }
}

TEST_F(Orders, APausedPrintStaysPausedOverEveryRestartUntilItIsResumed) {
  begin_print(3);
  const Outcome paused = at_fab({"pause", job, "--who", "ana"});
  ASSERT_EQ(paused.code, 0);
  EXPECT_TRUE(paused.output.find("paused") != std::string::npos ||
              paused.errors.find("asked to pause") != std::string::npos)
      << "what is not yet so is not shown as if it were: " << paused.output << paused.errors;
  const std::size_t before = lights();
  for (const int signal : {SIGKILL, SIGTERM, SIGKILL}) {
    end_fab(signal);
    start_fab({"--after-crash", "treat-as-exposed"});
    EXPECT_THAT(says(), HasSubstr("paused"));
    expect_dark();
  }
  EXPECT_EQ(lights(), before);
  const Outcome resumed = resume("ben");
  ASSERT_EQ(resumed.code, 0) << resumed.errors;
  EXPECT_TRUE(resumed.output.find("paused") == std::string::npos ||
              resumed.errors.find("asked to") != std::string::npos)
      << resumed.output << resumed.errors;
  ASSERT_TRUE(await([&] { return lights() > before; })) << says();
  kill_fab();
  set_machine(5000);
  start_fab({"--after-crash", "treat-as-exposed"});
  ASSERT_EQ(at_fab({"watch", job}).code, 0);
  const json record = json::parse(text_of(job_folder() / "report" / "as-built.json"))["record"];
  std::string words;
  for (const json& word : record["orders"])
    words += word["word"].get<std::string>() + " " + word["by"].get<std::string>() + ", ";
  EXPECT_EQ(words, "approved automatic, pause-asked ana, resumed ben, ");
  const Outcome verified = verify_as_built();
  EXPECT_EQ(verified.code, 0) << verified.output;

  // Signed without anybody having asked for it, by a key that nobody else can read, with the audit log's head inside.
  EXPECT_THAT(verified.output, HasSubstr("signed by"));
  const auto site = folder() / "fab";
  using std::filesystem::perms;
  EXPECT_EQ(std::filesystem::status(site / "as-built-key.pem").permissions() & (perms::group_all | perms::others_all),
            perms::none);
  EXPECT_TRUE(std::filesystem::exists(site / "as-built-key.pub"));
  const auto entries = std::stoul(record["provenance"]["audit_entries"].get<std::string>());
  EXPECT_GE(entries, 2U);
  EXPECT_EQ(record["provenance"]["audit_sha256"].get<std::string>().size(), 64U);
  // Anybody can write a record that is as planned and sealed by its hash.
  auto sealed = nlohmann::ordered_json::parse(text_of(job_folder() / "report" / "as-built.json"));
  sealed.erase("ed25519");
  std::ofstream{job_folder() / "report" / "as-built.json"} << sealed;
  const Outcome forged = verify_as_built();
  EXPECT_EQ(forged.code, 10) << forged.output << forged.errors;
}

// One of these once ended the daemon in the middle of an exposure.
TEST_F(Orders, SignalsInTheMidstOfAnExposureEndNoneBeforeItsTime) {
  begin_print(1, {}, 8);  // a first layer is lit for a second
  for (const int signal : {SIGUSR1, SIGUSR2, SIGALRM, SIGVTALRM, SIGPROF, SIGPOLL, SIGSTKFLT, SIGXFSZ, SIGPIPE,
                           SIGWINCH, SIGCHLD, SIGURG, SIGCONT, SIGRTMIN, SIGRTMAX})
    fab().send_signal(signal);
  EXPECT_THAT(journal(), testing::Not(HasSubstr(R"("step":"exposed")"))) << "they came too late to say anything";
  ASSERT_TRUE(await([&] { return lights() == 2; })) << says() << journal();
  // A terminal that closes, power that goes, a limit: an orderly end. The light ends as planned, and nothing is in
  // question.
  for (const int signal : {SIGHUP, SIGPWR, SIGXCPU, SIGQUIT}) fab().send_signal(signal);
  EXPECT_EQ(fab().finish(), 0);
  EXPECT_EQ(lights(), 2U);
  const std::string last = journal();
  EXPECT_THAT(last.substr(last.rfind(R"("step":)")), HasSubstr("stopped")) << last;
  finish_quickly();
  ASSERT_EQ(at_fab({"watch", job}).code, 0) << says();
  const Outcome verified = verify_as_built();
  EXPECT_EQ(verified.code, 0) << verified.output;
}

TEST_F(Orders, APrintThatWasAwayTooLongOrIsToAskWaitsForAWord) {
  begin_print(2, {"--after-crash", "treat-as-exposed"});
  for (const auto& option : {std::vector<std::string>{"--go-on-within-min", "0"}, {"--after-restart", "ask"}}) {
    kill_fab();
    auto options = option;
    options.insert(options.end(), {"--after-crash", "treat-as-exposed"});
    start_fab(options);
    EXPECT_THAT(says(), HasSubstr("paused"));
    expect_dark();
  }
  set_machine(5000);
  kill_fab();
  start_fab({"--after-crash", "treat-as-exposed"});
  const Outcome resumed = resume("ana");
  EXPECT_EQ(resumed.code, 0) << resumed.errors;
  EXPECT_EQ(at_fab({"watch", job}).code, 0);
}

TEST_F(Orders, ADamagedJournalIsAskedAboutSetAsideAndToldByTheRecord) {
  begin_print(6);
  kill_fab();
  std::string text = journal();
  const std::size_t at = text.find(R"("step":"exposed","layer":2)");
  ASSERT_NE(at, std::string::npos);
  text[at + 10] ^= 1;
  std::ofstream{job_folder() / "journal", std::ios::binary} << text;
  start_fab();
  EXPECT_THAT(says(), HasSubstr("damaged"));
  expect_dark();
  EXPECT_EQ(journal(), text) << "damage is left as it is";
  const Outcome resumed = resume("ana");
  ASSERT_EQ(resumed.code, 0) << resumed.errors;
  EXPECT_EQ(text_of(job_folder() / "journal.damaged-1"), text);
  finish_quickly({"--after-crash", "treat-as-exposed"});
  ASSERT_EQ(at_fab({"watch", job}).code, 0);
  const Outcome verified = verify_as_built();
  EXPECT_NE(verified.code, 0);
  EXPECT_THAT(verified.output, HasSubstr("are lost"));
  const std::string all = journal();
  EXPECT_EQ(all.find(R"("step":"exposing","layer":3)"), all.rfind(R"("step":"exposing","layer":3)"))
      << "no layer twice";
}

TEST_F(Orders, ABackupOfTheJournalIsAskedAbout) {
  begin_print(2);
  fab().send_signal(SIGSTOP);
  const std::string backup = journal();
  fab().send_signal(SIGCONT);
  ASSERT_TRUE(await([&] { return lights() >= 8; }));
  end_fab(SIGTERM);
  const std::size_t seen = lights();
  std::ofstream{job_folder() / "journal", std::ios::binary} << backup;
  start_fab({"--after-crash", "expose-again"});
  EXPECT_THAT(says(), HasSubstr("older than what this site saw"));
  expect_dark();
  EXPECT_NE(at_fab({"resume", job}).code, 0) << "which layers are made is for an operator to say";
  set_machine(5000);
  kill_fab();
  start_fab({"--after-crash", "expose-again"});
  ASSERT_EQ(at_fab({"resume", job, "--as", "treat-as-exposed"}).code, 0) << says();
  ASSERT_EQ(at_fab({"watch", job}).code, 0);
  const std::string all = journal();
  EXPECT_EQ(all.find(R"("step":"exposing","layer":3)"), std::string::npos) << "what the store saw is not made again";
  EXPECT_GE(lights() + seen, 10u);
}

TEST_F(Orders, TheNextJobWaitsForAnEmptyPlatformOverRestarts) {
  const std::vector<std::string> options{"--platform", "cleared-by-operator"};
  start_fab(options);
  start_scan();
  const std::string first = submit_torus();
  EXPECT_EQ(telefab({"watch", first}).code, 0);
  job = submit_torus();
  const auto waits = [&] { return says().find("empty platform") != std::string::npos; };
  ASSERT_TRUE(await(waits)) << says();
  EXPECT_EQ(lights(), 0u);
  kill_fab();
  start_fab(options);
  ASSERT_TRUE(await(waits)) << says();
  expect_dark();
  EXPECT_EQ(at_fab({"cleared", "nobody"}).code, 2);
  const Outcome cleared = at_fab({"cleared", "toy", "--who", "ana"});
  EXPECT_EQ(cleared.code, 0) << cleared.errors;
  EXPECT_EQ(at_fab({"watch", job}).code, 0) << says();
  EXPECT_GT(lights(), 0u);
  const std::string audit = text_of(folder() / "fab" / "audit.log");
  EXPECT_THAT(audit, HasSubstr("cleared toy"));
}

}  // namespace
}  // namespace telefab::test
