// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <telefab/fab/web/accepted_files.hpp>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/recording_backend.hpp>

// Shapes and status codes as PrusaLink's specification has them (Prusa-Link-Web, spec/openapi.yaml).
namespace telefab::fab {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pair;
using testing::SizeIs;
using testing::StartsWith;

/// A backend with the jobs it is given.
class ListedBackend final : public RecordingBackend {
 public:
  Result<std::vector<JobView>> jobs() override { return list; }
  Result<JobView> job(std::string_view id) override {
    for (const JobView& each : list)
      if (each.id == id) return each;
    return fail(ErrorCode::NotFound, "no job");
  }
  Result<void> approve(std::string_view id, std::string_view although, std::string_view) override {
    approvals.emplace_back(std::string{id}, std::string{although});
    if (is_held) return fail(ErrorCode::NotPermitted, "islands hold it");
    return {};
  }
  std::vector<JobView> list;
  bool is_held = false;
};

class PrusaLinkTest : public testing::Test {
 protected:
  WebResponse ask(const std::string& method, const std::string& target, const std::string& body = {},
                  const std::string& overwrite = "?1", const std::string& print = {}) {
    WebRequest request{method, target, "Bearer secret", "text/x.gcode", body};
    request.host = "fab.example:7480";
    request.overwrite = overwrite;
    request.print_after_upload = print;
    return answer(request, backend, sign_in, options);
  }
  JobView& add(const std::string& id, const std::string& name, JobState state) {
    JobView job;
    job.id = id;
    job.name = name;
    job.machine = "machine-a";
    job.state = state;
    backend.list.push_back(job);
    return backend.list.back();
  }
  [[nodiscard]] std::string printed_job() {
    return std::to_string(json::parse(ask("GET", "/api/v1/job").body)["id"].get<std::uint32_t>());
  }
  ListedBackend backend;
  VirtualClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  WebOptions options{"0.1.0", ""};
};

TEST_F(PrusaLinkTest, IsThreeKindsOfHostUnderThreeAddresses) {
  const auto text = [&](const std::string& at) { return json::parse(ask("GET", at + "/api/version").body); };
  EXPECT_THAT(text("")["text"].get<std::string>(), StartsWith("OctoPrint"));
  EXPECT_THAT(text("/prusalink")["text"].get<std::string>(), StartsWith("PrusaLink"));
  EXPECT_EQ(text("/prusalink")["api"], "2.0.0");
  EXPECT_THAT(text("/prusa-sla")["text"].get<std::string>(), StartsWith("Prusa SLA"));
  for (const char* at : {"", "/prusalink", "/prusa-sla"}) {
    EXPECT_EQ(text(at)["capabilities"]["upload-by-put"], true) << at;
    EXPECT_EQ(ask("GET", std::string{at} + "/api/v1/status").status, 200U) << at;
    EXPECT_EQ(ask("PUT", std::string{at} + "/api/v1/files/local/part.sl1", "x").status, 201U) << at;
  }
  EXPECT_EQ(ask("GET", "/prusalink/v1/jobs").status, 404U) << "no second address of the page's own API";
  EXPECT_EQ(ask("GET", "/prusalink/prusa-sla/api/version").status, 404U);
}

TEST_F(PrusaLinkTest, ListsItsStorageFirst) {
  const std::string body = ask("GET", "/api/v1/storage").body;
  EXPECT_THAT(body, StartsWith("{\"storage_list\":"));
  const json storage = json::parse(body)["storage_list"][0];
  EXPECT_EQ(storage["path"], "/local");
  EXPECT_EQ(storage["read_only"], false);
  EXPECT_EQ(storage["available"], true);
  backend.health = fail(ErrorCode::StorageFailed, "disk full");
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/storage").body)["storage_list"][0]["available"], false);
}

TEST_F(PrusaLinkTest, HasNoJobBeforeOneIsPrinted) {
  add("u1", "part.sl1", JobState::AwaitingApproval);
  EXPECT_EQ(ask("GET", "/api/v1/job").status, 204U);
  const json status = json::parse(ask("GET", "/api/v1/status").body);
  EXPECT_EQ(status["printer"]["state"], "IDLE");
  EXPECT_FALSE(status.contains("job"));
  EXPECT_EQ(ask("GET", "/api/v1/transfer").status, 204U);
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/info").body)["hostname"], "fab.example");
}

TEST_F(PrusaLinkTest, DescribesThePrintUnderWay) {
  JobView& job = add("u1", "part.sl1", JobState::Printing);
  job.progress = 0.4567;
  job.seconds_left = 100.4;
  job.stage_seconds = {{JobStage::Print, 81.6}};
  job.layers = 3;
  const json shown = json::parse(ask("GET", "/api/v1/job").body);
  EXPECT_EQ(shown["state"], "PRINTING");
  EXPECT_TRUE(shown["id"].is_number_unsigned());
  EXPECT_EQ(shown["progress"], 45.6);
  EXPECT_EQ(shown["time_remaining"], 100);
  EXPECT_EQ(shown["time_printing"], 82);
  EXPECT_EQ(shown["file"]["display_name"], "part.sl1");
  EXPECT_EQ(shown["file"]["refs"]["thumbnail"], "/v1/jobs/u1/view.png");
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/status").body)["job"]["id"], shown["id"]);
}

TEST_F(PrusaLinkTest, SaysWhenSomebodyMustComeToTheMachine) {
  add("u1", "a.sl1", JobState::Paused);
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/status").body)["printer"]["state"], "PAUSED");
  backend.list[0].exposure_unknown = true;
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/status").body)["printer"]["state"], "ATTENTION");
  backend.list[0] = {};
  add("u2", "b.sl1", JobState::Ready).waits_for_platform = true;
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/status").body)["printer"]["state"], "ATTENTION");
}

TEST_F(PrusaLinkTest, PausesResumesAndEndsTheJobItNames) {
  add("u1", "part.sl1", JobState::Printing);
  const std::string id = printed_job();
  EXPECT_EQ(ask("PUT", "/api/v1/job/" + id + "/resume").status, 409U);
  EXPECT_EQ(ask("PUT", "/api/v1/job/" + id + "/pause").status, 204U);
  backend.list[0].state = JobState::Paused;
  EXPECT_EQ(ask("PUT", "/api/v1/job/" + id + "/pause").status, 409U);
  EXPECT_EQ(ask("PUT", "/api/v1/job/" + id + "/resume").status, 204U);
  EXPECT_EQ(ask("PUT", "/api/v1/job/" + id + "/continue").status, 204U);
  EXPECT_EQ(ask("DELETE", "/api/v1/job/" + id).status, 204U);
  EXPECT_THAT(backend.actions, ElementsAre(Pair("u1", JobCommand::Pause), Pair("u1", JobCommand::Resume),
                                           Pair("u1", JobCommand::Resume), Pair("u1", JobCommand::Cancel)));
}

TEST_F(PrusaLinkTest, TouchesNoJobByAWrongNumber) {
  add("u1", "part.sl1", JobState::Printing);
  for (const char* id : {"0", "1", "u1", "4294967296", "-1", "007"})
    for (const char* what : {"/pause", "/resume", "/continue"})
      EXPECT_EQ(ask("PUT", std::string{"/api/v1/job/"} + id + what).status, 404U) << id << what;
  backend.list[0].state = JobState::Ready;
  EXPECT_EQ(ask("DELETE", "/api/v1/job/1").status, 404U);
  EXPECT_THAT(backend.actions, IsEmpty());
}

TEST_F(PrusaLinkTest, MakesAJobOfAnUploadAndStartsItOnlyWhereAsked) {
  const WebResponse made = ask("PUT", "/api/v1/files/local/part.sl1", "bytes");
  EXPECT_EQ(made.status, 201U);
  EXPECT_EQ(made.location, "/v1/jobs/u1");
  EXPECT_EQ(ask("PUT", "/api/v1/files/usb/part.sl1", "bytes", "?1", "?0").status, 201U);
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/part.sl1", "bytes", "?1", "?1").status, 201U);
  ASSERT_THAT(backend.files, SizeIs(3));
  EXPECT_EQ(backend.files[0].name, "part.sl1");
  EXPECT_EQ(backend.files[0].content, "bytes");
  EXPECT_FALSE(backend.files[0].start);
  EXPECT_FALSE(backend.files[1].start);
  EXPECT_TRUE(backend.files[2].start);
}

TEST_F(PrusaLinkTest, RefusesFlagsThatAreNone) {
  for (const char* flag : {"1", "true", "True", "?2", "?1;x", "?1, ?0"}) {
    EXPECT_EQ(ask("PUT", "/api/v1/files/local/part.sl1", "x", "?1", flag).status, 400U) << flag;
    EXPECT_EQ(ask("PUT", "/api/v1/files/local/part.sl1", "x", flag).status, 400U) << flag;
  }
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST_F(PrusaLinkTest, ReadsNamesOfAnyLanguageAndKeepsTheirLastPart) {
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/prints/B%C3%BCste%20%E2%84%961.sl1", "x").status, 201U);
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/a%2Fb%5Cc.sl1?x=y", "x").status, 201U);
  ASSERT_THAT(backend.files, SizeIs(2));
  EXPECT_EQ(backend.files[0].name, "B\u00fcste \u21161.sl1");
  EXPECT_EQ(backend.files[1].name, "c.sl1");
}

TEST_F(PrusaLinkTest, RefusesNamesThatCannotBeKept) {
  const std::string root = "/api/v1/files/local/";
  for (const std::string& name : {std::string{".."}, std::string{"..%2f..%2fetc%2f.sl1"}, std::string{"a/"},
                                  std::string{"a%00.sl1"}, std::string{"a%0a.sl1"}, std::string{"%ff.sl1"},
                                  std::string{"a%E2%80%AEb.sl1"}, std::string(300, 'a') + ".sl1"})
    EXPECT_EQ(ask("PUT", root + name, "x").status, 400U) << name;
  for (const char* name : {"%", "%4", "%zz.sl1", ""})
    EXPECT_THAT(ask("PUT", root + name, "x").status, testing::AnyOf(404U, 405U)) << name;
  EXPECT_EQ(ask("PUT", "/api/v1/files/sdcard/part.sl1", "x").status, 404U);
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST_F(PrusaLinkTest, RefusesWhatNoFabPrintsByName) {
  for (const char* name : {"part.gcode", "part.STL", "part", "sl1", "part.sl1.exe"}) {
    const WebResponse refused = ask("PUT", std::string{"/api/v1/files/local/"} + name, "x");
    EXPECT_EQ(refused.status, 415U) << name;
    EXPECT_THAT(json::parse(refused.body)["message"].get<std::string>(), HasSubstr(name));
  }
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/empty.sl1", "").status, 400U) << "as who reads it says";
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST_F(PrusaLinkTest, OverwritesANameOnlyWhereAsked) {
  add("u1", "part.sl1", JobState::AwaitingApproval);
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/part.sl1", "x", "").status, 409U);
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/part.sl1", "x", "?0").status, 409U);
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/other.sl1", "x", "?0").status, 201U);
  EXPECT_EQ(ask("PUT", "/api/v1/files/local/part.sl1", "x", "?1").status, 201U);
  EXPECT_THAT(backend.actions, IsEmpty()) << "the job that has the name stays";
}

TEST_F(PrusaLinkTest, ShowsJobsAsFilesByNameAndById) {
  add("u2", "part.sl1", JobState::Printing);
  add("u1", "part.sl1", JobState::Done);
  const json folder = json::parse(ask("GET", "/api/v1/files/local").body);
  EXPECT_EQ(folder["type"], "FOLDER");
  EXPECT_THAT(folder["children"], SizeIs(2));
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/files/local/").body), folder);
  EXPECT_EQ(json::parse(ask("GET", "/api/v1/files/local/part.sl1").body)["name"], "u2") << "the newest";
  const WebResponse old = ask("HEAD", "/api/v1/files/local/u1");
  EXPECT_THAT(old.headers, ElementsAre(Pair("Read-Only", "false"), Pair("Currently-Printed", "false")));
  EXPECT_THAT(ask("GET", "/api/v1/files/local/u2").headers, testing::Contains(Pair("Currently-Printed", "true")));
  EXPECT_EQ(ask("GET", "/api/v1/files/local/other.sl1").status, 404U);
  EXPECT_EQ(ask("GET", "/api/v1/files/sdcard").status, 404U);
}

TEST_F(PrusaLinkTest, StartsAFileThatNothingHolds) {
  add("u1", "part.sl1", JobState::AwaitingApproval);
  EXPECT_EQ(ask("POST", "/api/v1/files/local/part.sl1").status, 204U);
  backend.is_held = true;
  const WebResponse held = ask("POST", "/api/v1/files/local/part.sl1");
  EXPECT_EQ(held.status, 409U);
  EXPECT_THAT(held.body, HasSubstr("islands"));
  EXPECT_THAT(backend.approvals, testing::Each(Pair("u1", ""))) << "it lets nothing through by name";
  EXPECT_EQ(ask("POST", "/api/v1/files/local/other.sl1").status, 404U);
}

TEST_F(PrusaLinkTest, DeletesNoFileThatIsBeingPrinted) {
  add("u1", "part.sl1", JobState::Printing);
  EXPECT_EQ(ask("DELETE", "/api/v1/files/local/part.sl1").status, 409U);
  backend.list[0].state = JobState::Paused;
  EXPECT_EQ(ask("DELETE", "/api/v1/files/local/part.sl1").status, 409U);
  EXPECT_THAT(backend.actions, IsEmpty());
  backend.list[0].state = JobState::AwaitingApproval;
  EXPECT_EQ(ask("DELETE", "/api/v1/files/local/part.sl1").status, 204U);
  EXPECT_THAT(backend.actions, ElementsAre(Pair("u1", JobCommand::Cancel), Pair("u1", JobCommand::Forget)));
  EXPECT_EQ(ask("DELETE", "/api/v1/files/local/other.sl1").status, 404U);
}

TEST_F(PrusaLinkTest, AsksWhoShowsNothingToLogInButNoBrowser) {
  WebRequest request{"PUT", "/api/v1/files/local/part.sl1"};
  const WebResponse asked = answer(request, backend, sign_in, options);
  EXPECT_EQ(asked.status, 401U);
  EXPECT_THAT(asked.challenges, testing::Each(StartsWith("Digest realm=\"Telefab\"")));
  EXPECT_THAT(asked.challenges, SizeIs(2));
  request.origin = "http://localhost:7480";
  EXPECT_THAT(answer(request, backend, sign_in, options).challenges, IsEmpty());
  request = {"PUT", "/api/v1/files/local/part.sl1", "Bearer wrong"};
  EXPECT_EQ(answer(request, backend, sign_in, options).status, 401U);
  EXPECT_THAT(answer({"POST", "/v1/files/part.sl1"}, backend, sign_in, options).challenges, IsEmpty());
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST_F(PrusaLinkTest, TheLogInOfAnOldNonceIsAskedForAgain) {
  WebRequest request{"GET", "/api/v1/status",
                     R"(Digest username="web", realm="Telefab", nonce="x", uri="/api/v1/status", response="y")"};
  const WebResponse refused = answer(request, backend, sign_in, options);
  EXPECT_EQ(refused.status, 401U);
  EXPECT_THAT(refused.challenges.at(0), testing::Not(HasSubstr("stale"))) << "the password was wrong";
}

TEST_F(PrusaLinkTest, ThePageSendsEveryKindThatIsTakenAndNoOther) {
  std::ifstream file{std::string{std::getenv("TELEFAB_SOURCE")} + "/fab_site/web/page/index.html"};
  std::stringstream page;
  page << file.rdbuf();
  std::string listed;
  for (const std::string_view ending : accepted_endings()) listed += (listed.empty() ? "" : ",") + std::string{ending};
  EXPECT_THAT(page.str(), HasSubstr("accept=\"" + listed + "\""));
  for (const std::string_view ending : accepted_endings()) {
    const WebResponse made = ask("POST", "/v1/files/part" + std::string{ending}, "x");
    EXPECT_EQ(made.status, 201U) << ending;
    EXPECT_EQ(made.location, "/v1/jobs/u1");
  }
  EXPECT_EQ(ask("POST", "/v1/files/part.stl", "x").status, 415U);
  EXPECT_THAT(backend.files, testing::Each(testing::Field(&RecordingBackend::File::start, false)));
}

}  // namespace
}  // namespace telefab::fab
