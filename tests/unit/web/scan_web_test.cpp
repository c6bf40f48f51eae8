// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <telefab/job/slice_parameters.hpp>
#include <telefab/test/recording_scan_backend.hpp>

namespace telefab::scan {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;

class ScanWebTest : public testing::Test {
 protected:
  WebResponse ask(const std::string& method, const std::string& target, const std::string& shown = {}) {
    return web.answer({method, target, shown, {}, {}});
  }
  static std::string concrete(std::string_view pattern) {
    std::string path{pattern};
    if (const auto at = path.find("{id}"); at != std::string::npos) path.replace(at, 4, "job-1");
    return path;
  }
  RecordingScanBackend backend;
  VirtualClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  ScanWeb web{backend, sign_in, "0.1.0"};
};

TEST_F(ScanWebTest, AnswersEveryRouteOfItsTable) {
  for (const WebRoute& route : web_routes()) {
    const WebResponse response = ask(std::string{route.method}, concrete(route.path), "Bearer secret");
    EXPECT_THAT(response.status, testing::AnyOf(200U, 409U, route.path == "/v1/sign-in" ? 400U : 200U)) << route.path;
    EXPECT_FALSE(response.body.empty()) << route.path;
  }
}

TEST_F(ScanWebTest, DescribesEveryParameterOfTheTable) {
  const json list = json::parse(ask("GET", "/v1/parameters").body);
  const json schema = json::parse(ask("GET", "/openapi.json").body)["components"]["schemas"]["SliceParameters"];
  const auto table = slice_parameter_table();
  ASSERT_EQ(list.size(), table.size());
  EXPECT_EQ(schema["properties"].size(), table.size());
  for (std::size_t i = 0; i < table.size(); ++i) {
    EXPECT_EQ(list[i]["key"], table[i].key);
    EXPECT_EQ(schema["properties"][std::string{table[i].key}]["description"], table[i].help);
    EXPECT_EQ(schema["properties"][std::string{table[i].key}]["type"], list[i]["type"]);
  }
}

/// A list of jobs that cannot be read any more.
class UnreadableScanBackend final : public RecordingScanBackend {
 public:
  Result<std::vector<Job>> jobs() override { return fail(ErrorCode::NotTrusted, "job store: malformed"); }
};

TEST_F(ScanWebTest, IsSickRatherThanForbiddenWhereItsListIsDamaged) {
  UnreadableScanBackend unreadable;
  ScanWeb sick{unreadable, sign_in, "0.1.0"};
  EXPECT_EQ(sick.answer({"GET", "/v1/health", {}, {}, {}}).status, 503U);
}

TEST_F(ScanWebTest, NeverChangesStateOnGetOrHead) {
  for (const WebRoute& route : web_routes())
    for (const char* method : {"GET", "HEAD"}) (void)ask(method, concrete(route.path), "Bearer secret");
  EXPECT_THAT(backend.commands, IsEmpty());
}

TEST_F(ScanWebTest, WantsTheTokenForEveryCommand) {
  for (const WebRoute& route : web_routes()) {
    if (route.needs != Access::Operators) continue;
    for (const char* shown : {"", "Bearer ", "Bearer secre", "Bearer SECRET", "Basic secret"})
      EXPECT_EQ(ask("POST", concrete(route.path), shown).status, 401U) << route.path << ' ' << shown;
  }
  EXPECT_THAT(backend.commands, IsEmpty());
}

TEST_F(ScanWebTest, PassesACancelOnWithTheToken) {
  EXPECT_EQ(ask("POST", "/v1/jobs/job-1/cancel", "Bearer secret").status, 200U);
  ASSERT_EQ(backend.commands.size(), 1U);
  EXPECT_EQ(backend.commands[0].second, JobCommand::Cancel);
}

TEST_F(ScanWebTest, ForgetsAJobWithTheTokenAndAnswersItsName) {
  const WebResponse gone = ask("POST", "/v1/jobs/job-1/forget", "Bearer secret");
  EXPECT_EQ(gone.status, 200U);
  EXPECT_EQ(json::parse(gone.body), json({{"forgotten", "job-1"}}));
  ASSERT_EQ(backend.commands.size(), 1U);
  EXPECT_EQ(backend.commands[0].second, JobCommand::Forget);
}

TEST_F(ScanWebTest, TellsHowFarEachStageIsAndWhetherTheFabIsReached) {
  const json list = json::parse(ask("GET", "/v1/jobs").body);
  EXPECT_EQ(list["jobs"][0]["name"], "a \"statue\" <b>.ply");
  EXPECT_EQ(list["jobs"][0]["layers_sent"], 500);
  EXPECT_EQ(list["jobs"][0]["layers_printed"], 77);
  EXPECT_EQ(list["link"]["up"], false);
  EXPECT_EQ(list["link"]["why_down"], "connection refused");
  EXPECT_EQ(json::parse(ask("GET", "/v1/link").body), list["link"]);
  EXPECT_EQ(web.event_data().find('\n'), std::string::npos);
}

TEST_F(ScanWebTest, MetricsTellLayersBytesAndTheLine) {
  const std::string text = ask("GET", "/metrics").body;
  EXPECT_THAT(text, HasSubstr("telefab_jobs{state=\"printing\"} 1"));
  EXPECT_THAT(text, HasSubstr("telefab_fab_link_up 0"));
  EXPECT_THAT(text,
              HasSubstr("telefab_job_layers_acknowledged{job=\"job-1\",machine=\"machine-a\",state=\"printing\"} 500"));
  EXPECT_THAT(text, HasSubstr("telefab_job_stage_seconds{job=\"job-1\",stage=\"send\"} 1.4"));
}

TEST_F(ScanWebTest, ServesItsOwnPageWithoutOutsideRequests) {
  EXPECT_THAT(ask("GET", "/").body, HasSubstr("scan site"));
  for (const char* path : {"/", "/page.css", "/jobs.js", "/page.js"})
    EXPECT_THAT(ask("GET", path).body, testing::Not(HasSubstr("://"))) << path;
}

TEST_F(ScanWebTest, RefusesPathTricks) {
  for (const char* target :
       {"/../etc/passwd", "/v1/jobs/../../etc/passwd", "/v1/jobs/%2e%2e", "/v1/jobs//events", "*", ""})
    EXPECT_EQ(ask("GET", target).status, 404U) << target;
}

}  // namespace
}  // namespace telefab::scan
