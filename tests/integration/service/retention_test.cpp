// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <telefab/base/file.hpp>
#include <telefab/service/retention.hpp>
#include <telefab/store/audit_log.hpp>
#include <telefab/store/job_store.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/two_sites.hpp>

// What leaves a site, by an operator's word or by age and size: never a job that has not ended, never a record.

namespace telefab::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
namespace fs = std::filesystem;

constexpr std::int64_t kDay_ms = 24LL * 3600 * 1000;

/// Jobs that ended on day 1, 2, ...
std::vector<Job> ended(int many) {
  std::vector<Job> jobs(static_cast<std::size_t>(many));
  for (int i = 0; i < many; ++i) {
    jobs[static_cast<std::size_t>(i)].id = "j" + std::to_string(i + 1);
    jobs[static_cast<std::size_t>(i)].changed_unix_ms = (i + 1) * kDay_ms;
  }
  return jobs;
}

std::vector<std::string> ids(const std::vector<Outlived>& gone) {
  std::vector<std::string> names;
  for (const Outlived& each : gone) names.push_back(each.job);
  return names;
}

TEST(Retention, ForgetsNothingUnlessItIsAsked) {
  EXPECT_THAT(outlived(ended(5), {{"j1", 1ULL << 50U}}, {}, 1000 * kDay_ms), IsEmpty());
}

TEST(Retention, ForgetsWhatEndedTooManyDaysAgo) {
  EXPECT_THAT(ids(outlived(ended(5), {}, {.keep_days = 10}, 12 * kDay_ms)), ElementsAre("j1"))
      << "j2 ended ten days ago, not more";
  EXPECT_THAT(outlived(ended(5), {}, {.keep_days = 10}, 12 * kDay_ms)[0].why, HasSubstr("10 days"));
}

TEST(Retention, ForgetsTheOldestUntilTheRestFits) {
  const std::map<std::string, std::uint64_t> bytes{
      {"j1", 1U << 30U}, {"j2", 1U << 30U}, {"j3", 2ULL << 30U}, {"j4", 1}};
  EXPECT_THAT(ids(outlived(ended(4), bytes, {.keep_gib = 3}, 0)), ElementsAre("j1", "j2"));
  EXPECT_THAT(ids(outlived(ended(4), bytes, {.keep_gib = 5}, 0)), IsEmpty());
  EXPECT_THAT(ids(outlived(ended(4), bytes, {.keep_days = 1, .keep_gib = 3}, 3 * kDay_ms)), ElementsAre("j1", "j2"))
      << "what goes by its age makes room too";
}

class Forget : public TwoSites {
 protected:
  [[nodiscard]] Outcome at_fab(std::vector<std::string> words) const {
    words.insert(words.end(), {"--site", fab_site()});
    return telefab(std::move(words));
  }
  [[nodiscard]] fs::path data(const std::string& site) const { return folder() / site; }
};

TEST_F(Forget, RemovesAJobThatHasEndedWithItsFilesAndKeepsItsRecord) {
  start_both();
  const std::string job = submit_torus();
  ASSERT_EQ(telefab({"watch", job}).code, 0);
  const std::string record = text_of(data("fab") / "jobs" / job / "report" / "as-built.json");
  ASSERT_FALSE(record.empty());
  Outcome forgotten;
  for (int tries = 0; tries < 100; ++tries) {  // its accuracy picture may still be under way
    forgotten = at_fab({"forget", job, "--who", "ana"});
    if (forgotten.code == 0) break;
    ::usleep(100'000);
  }
  ASSERT_EQ(forgotten.code, 0) << forgotten.errors;
  EXPECT_THAT(forgotten.output, HasSubstr(job));
  EXPECT_FALSE(fs::exists(data("fab") / "jobs" / job));
  EXPECT_TRUE(fs::is_empty(data("fab") / "incoming"));
  EXPECT_EQ(text_of(data("fab") / "records" / (job + ".json")), record);
  EXPECT_THAT(at_fab({"jobs"}).output, Not(HasSubstr(job)));
  EXPECT_THAT(text_of(data("fab") / "audit.log"), HasSubstr("forget " + job));
  EXPECT_NE(at_fab({"forget", job}).code, 0) << "there is no such job any more";
  EXPECT_THAT(telefab({"jobs"}).output, HasSubstr(job)) << "the other site keeps its own";
}

TEST_F(Forget, RefusesAJobThatHasNotEnded) {
  start_fab({"--start", "on-approval"});
  start_scan();
  const std::string job = submit_torus();
  for (int tries = 0; tries < 400 && at_fab({"jobs"}).output.find("awaiting-approval") == std::string::npos; ++tries)
    ::usleep(25'000);
  const Outcome refused = at_fab({"forget", job});
  EXPECT_NE(refused.code, 0);
  EXPECT_THAT(refused.errors, HasSubstr("only a job that has ended"));
  EXPECT_TRUE(fs::exists(data("fab") / "jobs" / job / "plan"));
}

// What the page and other programs ask, by the rules of signing in, at both sites.
TEST_F(Forget, OverThePageTakesAnOperatorWhomTheAuditLogNames) {
  const auto token_at = [&](const std::string& program, const std::string& site) {
    const Outcome made = run({std::string{std::getenv("TELEFAB_BIN")} + "/" + program, "tokens", "add", "ana", "--data",
                              data(site).string()});
    EXPECT_EQ(made.code, 0) << made.errors;
    return made.output.substr(0, made.output.find('\n'));
  };
  start_fab({"--web", "127.0.0.1:0", "--start", "on-approval"});
  start_scan({"--web", "127.0.0.1:0"});
  const std::string job = submit_torus();
  for (int tries = 0; tries < 400 && at_fab({"jobs"}).output.find("awaiting-approval") == std::string::npos; ++tries)
    ::usleep(25'000);
  const std::pair<std::string, std::string> sites[] = {{"telefab-fab", "fab"}, {"telefab-scan", "scan"}};
  const auto forget = [&](const std::string& site, const std::string& token) {
    const auto port = static_cast<std::uint16_t>(std::stoi(text_of(data(site) / "web-port")));
    return http_ask(port, "POST", "/v1/jobs/" + job + "/forget",
                    token.empty() ? "" : "Authorization: Bearer " + token + "\r\n");
  };
  std::map<std::string, std::string> tokens;
  for (const auto& [program, site] : sites) {
    tokens[site] = token_at(program, site);
    EXPECT_THAT(forget(site, ""), HasSubstr(" 401 ")) << site;
    std::string shared = text_of(data(site) / "web-token");
    shared.pop_back();
    EXPECT_THAT(forget(site, shared), HasSubstr(" 401 ")) << site;
    const std::string stays = forget(site, tokens[site]);
    EXPECT_THAT(stays, HasSubstr(" 409 ")) << site;
    EXPECT_THAT(stays, HasSubstr("only a job that has ended")) << site;
  }
  ASSERT_EQ(telefab({"cancel", job}).code, 0);
  for (const auto& [program, site] : sites) {
    std::string gone;
    for (int tries = 0; tries < 100 && gone.find(" 200 ") == std::string::npos; ++tries) {
      ::usleep(50'000);  // its accuracy picture may still be under way
      gone = forget(site, tokens[site]);
    }
    EXPECT_THAT(gone, HasSubstr(" 200 ")) << site;
    EXPECT_THAT(gone, HasSubstr(R"({"forgotten":")" + job)) << site;
    EXPECT_FALSE(fs::exists(data(site) / "jobs" / job)) << site;
    EXPECT_THAT(text_of(data(site) / "audit.log"), HasSubstr("forget " + job)) << site;
    EXPECT_THAT(text_of(data(site) / "audit.log"), HasSubstr("ana")) << site;
    EXPECT_THAT(forget(site, tokens[site]), HasSubstr(" 404 ")) << site;
  }
}

// A list that was lost begins again by what the scan site offers; a print that had begun does not go on by itself.
TEST_F(Forget, APrintOfWhichTheListKnowsNothingWaitsForAnOperator) {
  set_machine(40);
  start_both();
  const std::string job = submit_torus();
  const auto journal = data("fab") / "jobs" / job / "journal";
  for (int tries = 0; tries < 1000 && text_of(journal).find(R"("layer":2)") == std::string::npos; ++tries)
    ::usleep(10'000);
  kill_fab();
  for (const char* part : {"", "-wal", "-shm"}) fs::remove(data("fab") / ("jobs.sqlite" + std::string{part}));
  for (int number = 1; number <= kStoreBackups; ++number)
    fs::remove(data("fab") / ("jobs.sqlite.backup-" + std::to_string(number)));
  const std::string before = text_of(journal);
  start_fab();
  std::string jobs;
  for (int tries = 0; tries < 400 && jobs.find("a print of it had begun before") == std::string::npos; ++tries) {
    ::usleep(25'000);
    jobs = at_fab({"jobs"}).output;
  }
  EXPECT_THAT(jobs, HasSubstr("a print of it had begun before"));
  EXPECT_EQ(text_of(journal), before) << "no word was put into it";
}

TEST_F(Forget, AgeTakesWhatHasEndedAndNothingElse) {
  std::string old, living;
  fs::create_directories(data("fab"));
  {
    const VirtualClock then;  // 1970
    const auto store = JobStore::open(data("fab") / "jobs.sqlite", then).value();
    old = store->create({.name = "a", .machine = "toy", .owner = "ana"}).value().id;
    living = store->create({.name = "b", .machine = "toy", .owner = "ana"}).value().id;
    ASSERT_TRUE(store->move(old, JobState::Failed, "no support holds it"));
    ASSERT_TRUE(store->move(living, JobState::Sending, ""));
  }
  fs::create_directories(data("fab") / "jobs" / old / "plan");
  start_fab({"--keep-days", "30"});
  for (int tries = 0; tries < 200 && fs::exists(data("fab") / "jobs" / old); ++tries) ::usleep(25'000);
  EXPECT_FALSE(fs::exists(data("fab") / "jobs" / old));
  EXPECT_THAT(at_fab({"jobs"}).output, HasSubstr(living));
  EXPECT_THAT(at_fab({"jobs"}).output, Not(HasSubstr(old)));
  EXPECT_THAT(text_of(data("fab") / "audit.log"), HasSubstr("forget " + old + ": it ended more than 30 days ago"));
}

using Audit = TwoSites;

TEST_F(Audit, IsFollowedThroughAllOfItsPartsAndSaysWhereItWasChanged) {
  const auto log = folder() / "fab" / "audit.log";
  fs::create_directories(log.parent_path());
  const SystemClock clock;
  {
    const auto small = AuditLog::open(log, clock, 500).value();
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(small->add("ana", "submit j" + std::to_string(i)));
  }
  const std::vector<std::string> command{std::string{std::getenv("TELEFAB_BIN")} + "/telefab-fab", "audit", "--data",
                                         (folder() / "fab").string()};
  const Outcome sound = run(command);
  EXPECT_EQ(sound.code, 0) << sound.errors;
  EXPECT_THAT(sound.output, HasSubstr("10 entries in "));
  std::string text = text_of(log.string() + ".000001");
  text.replace(text.find("submit j1"), 9, "cancel j1");
  std::ofstream{log.string() + ".000001"} << text;
  const Outcome changed = run(command);
  EXPECT_EQ(changed.code, 4) << changed.output;
  EXPECT_THAT(changed.errors, HasSubstr("line 2 of the audit log"));
}

}  // namespace
}  // namespace telefab::test
