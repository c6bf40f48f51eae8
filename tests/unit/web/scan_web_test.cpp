// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <telefab/job/slice_parameters.hpp>
#include <telefab/test/recording_scan_backend.hpp>
#include <telefab/test/recording_staging.hpp>

namespace telefab::scan {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;

class ScanWebTest : public testing::Test {
 protected:
  WebResponse ask(const std::string& method, const std::string& target, const std::string& shown = {},
                  const std::string& body = {}) {
    return web.answer({method, target, shown, {}, body});
  }
  static std::string concrete(std::string_view pattern) {
    std::string path{pattern};
    const bool is_upload = path.starts_with("/v1/uploads/");
    if (const auto at = path.find("{id}"); at != std::string::npos) path.replace(at, 4, is_upload ? "scan-1" : "job-1");
    if (const auto at = path.find("{layer}"); at != std::string::npos) path.replace(at, 7, "3");
    if (path.ends_with("/part")) path += "?from=0";
    if (path.find("/levels/") != std::string::npos) path += "?revision=7";
    return path;
  }
  /// A body that the route takes.
  static std::string body_of(const WebRoute& route) {
    if (route.path == "/v1/uploads")
      return R"({"name":"a.ply","size_bytes":3,"sha256":")" + std::string(64, 'a') + R"("})";
    if (route.path.ends_with("/part")) return "xyz";
    if (route.path.ends_with("/join")) return R"({"with":["scan-2"]})";
    return route.method == "POST" && route.path.starts_with("/v1/uploads/") ? R"({"machine":"machine-a"})" : "";
  }
  RecordingScanBackend backend;
  RecordingStaging staging;
  VirtualClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  ScanWeb web{backend, staging, sign_in, {.version = "0.1.0", .three_js = "var THREE = {};"}};
};

TEST_F(ScanWebTest, AnswersEveryRouteOfItsTable) {
  for (const WebRoute& route : web_routes()) {
    const WebResponse response = ask(std::string{route.method}, concrete(route.path), "Bearer secret", body_of(route));
    EXPECT_THAT(response.status, testing::AnyOf(200U, 201U, 409U, route.path == "/v1/sign-in" ? 400U : 200U))
        << route.path << response.body;
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
  ScanWeb sick{unreadable, staging, sign_in, {.version = "0.1.0"}};
  EXPECT_EQ(sick.answer({"GET", "/v1/health", {}, {}, {}}).status, 503U);
}

TEST_F(ScanWebTest, NeverChangesStateOnGetOrHead) {
  for (const WebRoute& route : web_routes())
    for (const char* method : {"GET", "HEAD"}) (void)ask(method, concrete(route.path), "Bearer secret", body_of(route));
  EXPECT_THAT(backend.commands, IsEmpty());
  EXPECT_THAT(staging.calls, IsEmpty());
}

TEST_F(ScanWebTest, WantsTheTokenForEveryCommand) {
  for (const WebRoute& route : web_routes()) {
    if (route.needs != Access::Operators) continue;
    for (const char* shown : {"", "Bearer ", "Bearer secre", "Bearer SECRET", "Basic secret"})
      EXPECT_EQ(ask("POST", concrete(route.path), shown, body_of(route)).status, 401U) << route.path << ' ' << shown;
  }
  EXPECT_THAT(backend.commands, IsEmpty());
  EXPECT_THAT(staging.calls, IsEmpty());
}

TEST_F(ScanWebTest, PassesACancelOnWithTheToken) {
  EXPECT_EQ(ask("POST", "/v1/jobs/job-1/cancel", "Bearer secret").status, 200U);
  ASSERT_EQ(backend.commands.size(), 1U);
  EXPECT_EQ(backend.commands[0].second, JobCommand::Cancel);
}

TEST_F(ScanWebTest, ApprovesAHeldJobByTheNamesInTheBodyAndPassesWordsAboutALayerOn) {
  const auto post = [&](const char* path, const char* body) { return ask("POST", path, "Bearer secret", body).status; };
  EXPECT_EQ(post("/v1/jobs/job-1/approve", R"({"although":["carry","islands"]})"), 200U);
  EXPECT_EQ(backend.although, "carry,islands");
  EXPECT_EQ(post("/v1/jobs/job-1/approve", ""), 200U);
  EXPECT_EQ(backend.although, "");
  EXPECT_EQ(post("/v1/jobs/job-1/resume", R"({"as":"expose-again"})"), 200U);
  ASSERT_EQ(backend.commands.size(), 3U);
  EXPECT_EQ(backend.commands[2].second, JobCommand::ExposeAgain);
  EXPECT_EQ(post("/v1/jobs/job-1/approve", R"({"although":"carry"})"), 400U);
  EXPECT_EQ(post("/v1/jobs/job-1/resume", R"({"as":"before"})"), 400U);
  EXPECT_EQ(backend.commands.size(), 3U);
  EXPECT_EQ(json::parse(ask("GET", "/v1/jobs/job-1/preflight").body)["verdict"], "passed");
}

TEST_F(ScanWebTest, ForgetsAJobWithTheTokenAndAnswersItsName) {
  const WebResponse gone = ask("POST", "/v1/jobs/job-1/forget", "Bearer secret");
  EXPECT_EQ(gone.status, 200U);
  EXPECT_EQ(json::parse(gone.body), json({{"forgotten", "job-1"}}));
  ASSERT_EQ(backend.commands.size(), 1U);
  EXPECT_EQ(backend.commands[0].second, JobCommand::Forget);
}

TEST_F(ScanWebTest, TellsHowFarEachStageIsAndWhetherTheFabIsReached) {
  const json page = json::parse(ask("GET", "/v1/jobs?search=vase").body);
  EXPECT_EQ(page["next"], 7);
  EXPECT_EQ(page["jobs"].size(), 1U);
  EXPECT_TRUE(page.contains("link"));
  EXPECT_EQ(ask("GET", "/v1/jobs?most=many").status, 400U);
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

TEST_F(ScanWebTest, LetsBrowsersKeepALayerThatIsCutAndNothingElseOfAJob) {
  EXPECT_TRUE(ask("GET", "/v1/jobs/job-1/layers/2").is_immutable);
  for (const char* path : {"/v1/jobs", "/v1/jobs/job-1", "/v1/jobs/job-1/report", "/v1/uploads/scan-1"})
    EXPECT_FALSE(ask("GET", path).is_immutable || ask("GET", path).cacheable) << path;
  EXPECT_FALSE(ask("GET", "/v1/jobs/job-1/layers/500").is_immutable) << "what is not there may come";
}

TEST_F(ScanWebTest, ServesItsOwnPageWithoutOutsideRequests) {
  EXPECT_THAT(ask("GET", "/").body, HasSubstr("scan site"));
  for (const char* path :
       {"/", "/page.css", "/jobs.js", "/page.js", "/place.css", "/uploads.js", "/cloud.js", "/place.js", "/layers.js"})
    EXPECT_THAT(ask("GET", path).body, testing::Not(HasSubstr("://"))) << path;
}

TEST_F(ScanWebTest, TakesAPartBehindTheBytesItNames) {
  EXPECT_EQ(ask("POST", "/v1/uploads/scan-1/part?from=4096", "Bearer secret", "xyz").status, 200U);
  EXPECT_THAT(staging.calls, testing::ElementsAre("append scan-1 4096+3"));
}

TEST_F(ScanWebTest, RefusesAPartThatDoesNotSayWhereItGoes) {
  for (const char* query : {"", "?", "?from=", "?from=-1", "?from=1x", "?from=99999999999999999999", "?form=1"})
    EXPECT_EQ(ask("POST", std::string{"/v1/uploads/scan-1/part"} + query, "Bearer secret", "xyz").status, 400U)
        << query;
  EXPECT_THAT(staging.calls, IsEmpty());
}

TEST_F(ScanWebTest, ListensToALargePartOfAnOperatorAlone) {
  const WebRequest head{"POST", "/v1/uploads/scan-1/part?from=0", "Bearer secret", {}, {}};
  EXPECT_EQ(web.most_body(head), 4U << 20U);
  EXPECT_EQ(web.most_body({"POST", "/v1/uploads/scan-1/part?from=0", {}, {}, {}}), 0U);
  EXPECT_EQ(web.most_body({"POST", "/v1/jobs/job-1/cancel", "Bearer secret", {}, {}}), 0U);
}

TEST_F(ScanWebTest, AnnouncesAFileByNameSizeAndDigest) {
  const std::string digest(64, 'b');
  EXPECT_EQ(ask("POST", "/v1/uploads", "Bearer secret",
                R"({"name":"../../etc/passwd","size_bytes":12,"sha256":")" + digest + R"("})")
                .status,
            200U);
  EXPECT_THAT(staging.calls, testing::ElementsAre("begin ../../etc/passwd 12 by web"))
      << "the name goes on as it was sent, to whoever judges it";
  for (const std::string& body : {std::string{}, std::string{"[]"}, std::string{"{}"},
                                  R"({"name":"a","size_bytes":-1,"sha256":")" + digest + R"("})",
                                  std::string{R"({"name":"a","size_bytes":1,"sha256":"abc"})"},
                                  R"({"name":7,"size_bytes":1,"sha256":")" + digest + R"("})"})
    EXPECT_EQ(ask("POST", "/v1/uploads", "Bearer secret", body).status, 400U) << body;
  EXPECT_EQ(staging.calls.size(), 1U);
}

TEST_F(ScanWebTest, PassesMachineParametersAndGoalOnAndRefusesWhatIsNoQuestion) {
  EXPECT_EQ(ask("POST", "/v1/uploads/scan-1/orient", "Bearer secret",
                R"({"machine":"m","parameters":{"height_mm":40},"for":"height"})")
                .status,
            200U);
  EXPECT_THAT(staging.calls, testing::ElementsAre(R"(orient scan-1 m {"height_mm":40} for height)"));
  for (const char* body :
       {"", "{}", "[]", R"({"machine":""})", R"({"machine":"m","parameters":[]})", R"({"machine":5})"})
    for (const char* what : {"look", "estimate", "orient", "submit"})
      EXPECT_EQ(ask("POST", std::string{"/v1/uploads/scan-1/"} + what, "Bearer secret", body).status, 400U)
          << what << body;
  EXPECT_EQ(staging.calls.size(), 1U);
}

TEST_F(ScanWebTest, MakesAJobOfAnUploadUnderTheOperatorsName) {
  const WebResponse made = ask("POST", "/v1/uploads/scan-1/submit", "Bearer secret",
                               R"({"machine":"machine-a","parameters":{"rotate":"90,0,0"}})");
  EXPECT_EQ(made.status, 201U);
  EXPECT_EQ(made.location, "/v1/jobs/job-9");
  EXPECT_THAT(staging.calls, testing::ElementsAre(R"(submit scan-1 machine-a {"rotate":"90,0,0"} by web)"));
}

TEST_F(ScanWebTest, PassesTheOtherViewsOnThatAreToBeJoined) {
  EXPECT_EQ(ask("POST", "/v1/uploads/scan-1/join", "Bearer secret", R"({"with":["scan-2","scan-3"]})").status, 200U);
  EXPECT_THAT(staging.calls, testing::ElementsAre("join scan-1 with 2"));
  for (const char* body : {"", "{}", "[]", R"({"with":[1]})", R"({"with":7})"})
    EXPECT_EQ(ask("POST", "/v1/uploads/scan-1/join", "Bearer secret", body).status, 400U) << body;
}

TEST_F(ScanWebTest, GivesALevelOfThePictureThatIsAskedForAndNotOfAnother) {
  EXPECT_EQ(ask("GET", "/v1/uploads/scan-1/levels/2?revision=7").body, "22222222");
  EXPECT_EQ(ask("GET", "/v1/uploads/scan-1/levels/2?revision=6").status, 409U);
  EXPECT_EQ(ask("GET", "/v1/uploads/scan-1/levels/2").status, 400U);
}

TEST_F(ScanWebTest, ServesTheLibraryOfThe3DViewWhereItIsInstalled) {
  EXPECT_EQ(ask("GET", "/three.js").body, "var THREE = {};");
  ScanWeb without{backend, staging, sign_in, {.version = "0.1.0"}};
  EXPECT_EQ(without.answer({"GET", "/three.js", {}, {}, {}}).status, 404U);
}

TEST_F(ScanWebTest, RefusesPathTricks) {
  for (const char* target :
       {"/../etc/passwd", "/v1/jobs/../../etc/passwd", "/v1/jobs/%2e%2e", "/v1/jobs//events", "*", ""})
    EXPECT_EQ(ask("GET", target).status, 404U) << target;
}

}  // namespace
}  // namespace telefab::scan
