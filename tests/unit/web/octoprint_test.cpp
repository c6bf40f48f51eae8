// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/recording_backend.hpp>
#include <telefab/web/form_data.hpp>

// Shapes as OctoPrint's documentation states them (docs.octoprint.org, REST API: version, job, printer, files).
namespace telefab::fab {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class OctoPrintTest : public testing::Test {
 protected:
  WebResponse get(const std::string& target, const std::string& shown = "Bearer secret") {
    return answer({"GET", target, shown, {}, {}}, backend, sign_in, options);
  }
  WebResponse post(const std::string& target, const std::string& body, const std::string& type = "application/json") {
    return answer({"POST", target, "Bearer secret", type, body}, backend, sign_in, options);
  }
  WebResponse upload(const std::string& name, const std::string& content, const std::string& more = {}) {
    return post("/api/files/local",
                "--XX\r\nContent-Disposition: form-data; name=\"file\"; filename=\"" + name +
                    "\"\r\nContent-Type: application/octet-stream\r\n\r\n" + content + "\r\n" + more + "--XX--\r\n",
                "multipart/form-data; boundary=XX");
  }
  RecordingBackend backend;
  VirtualClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  WebOptions options{"0.1.0", ""};
};

TEST_F(OctoPrintTest, TellsItsVersionAsClientsLookForIt) {
  const json version = json::parse(get("/api/version").body);
  EXPECT_TRUE(version["api"].is_string());
  EXPECT_TRUE(version["server"].is_string());
  EXPECT_TRUE(version["text"].get<std::string>().starts_with("OctoPrint"));
}

TEST_F(OctoPrintTest, RefusesAWrongKeyWith403EvenWhereNoneIsNeeded) {
  EXPECT_EQ(get("/api/version", "Bearer wrong").status, 403U);
  EXPECT_EQ(get("/api/version", "").status, 200U);
  EXPECT_TRUE(json::parse(get("/api/version", "Bearer wrong").body)["error"].is_string());
}

TEST_F(OctoPrintTest, DescribesTheJobOnTheMachine) {
  const json job = json::parse(get("/api/job").body);
  EXPECT_EQ(job["state"], "Printing");
  EXPECT_TRUE(job["job"]["file"]["name"].is_string());
  EXPECT_EQ(job["job"]["file"]["origin"], "local");
  EXPECT_TRUE(job["job"]["file"]["size"].is_number());
  EXPECT_TRUE(job["job"]["file"]["date"].is_number());
  EXPECT_TRUE(job["job"].contains("estimatedPrintTime"));
  EXPECT_TRUE(job["job"].contains("filament"));
  EXPECT_TRUE(job["progress"]["completion"].is_number());
  for (const char* key : {"filepos", "printTime", "printTimeLeft"}) EXPECT_TRUE(job["progress"].contains(key)) << key;
}

TEST_F(OctoPrintTest, DescribesThePrinterWithEveryFlag) {
  const json printer = json::parse(get("/api/printer?exclude=temperature").body);
  EXPECT_EQ(printer["state"]["text"], "Printing");
  for (const char* flag :
       {"operational", "paused", "printing", "cancelling", "pausing", "sdReady", "error", "ready", "closedOrError"})
    EXPECT_TRUE(printer["state"]["flags"][flag].is_boolean()) << flag;
  EXPECT_EQ(printer["state"]["flags"]["printing"], true);
  EXPECT_EQ(printer["state"]["flags"]["ready"], false);
}

TEST_F(OctoPrintTest, PausesAndCancelsTheJobOnTheMachine) {
  EXPECT_EQ(post("/api/job", R"({"command":"pause","action":"pause"})").status, 204U);
  EXPECT_EQ(post("/api/job", R"({"command":"pause"})").status, 204U);  // without action: toggle
  EXPECT_EQ(post("/api/job", R"({"command":"cancel"})").status, 204U);
  ASSERT_THAT(backend.actions, SizeIs(3));
  EXPECT_EQ(backend.actions[0].second, JobCommand::Pause);
  EXPECT_EQ(backend.actions[1].second, JobCommand::Pause);
  EXPECT_EQ(backend.actions[2].second, JobCommand::Cancel);
}

/// Two machines print.
class TwoPrints final : public RecordingBackend {
 public:
  Result<std::vector<JobView>> jobs() override {
    auto list = RecordingBackend::jobs();
    if (!list) return list;
    JobView other = list->front();
    other.id = "job-other";
    other.state = JobState::Paused;
    list->push_back(std::move(other));
    return list;
  }
};

TEST_F(OctoPrintTest, RefusesACommandThatCouldMeanOneOfSeveralPrints) {
  TwoPrints two;
  for (const char* body : {R"({"command":"pause","action":"pause"})", R"({"command":"pause","action":"resume"})",
                           R"({"command":"cancel"})"}) {
    const WebResponse refused =
        answer({"POST", "/api/job", "Bearer secret", "application/json", body}, two, sign_in, options);
    EXPECT_EQ(refused.status, 409U) << body;
    EXPECT_THAT(refused.body, HasSubstr("several machines"));
  }
  EXPECT_THAT(two.actions, IsEmpty());
}

TEST_F(OctoPrintTest, TakesAResumeOfARunningPrintForDone) {
  EXPECT_EQ(post("/api/job", R"({"command":"pause","action":"resume"})").status, 204U);
  EXPECT_THAT(backend.actions, IsEmpty());
}

TEST_F(OctoPrintTest, SaysConflictForWhatTheStateDoesNotAllow) {
  EXPECT_EQ(post("/api/job", R"({"command":"start"})").status, 409U);
  EXPECT_EQ(post("/api/job", R"({"command":"restart"})").status, 409U);
}

TEST_F(OctoPrintTest, RefusesCommandsThatAreNone) {
  for (const char* body : {"", "[]", "{", "null", R"({"command":5})", R"({"command":"explode"})",
                           R"({"command":"pause","action":"sideways"})", "\xff\xfe"})
    EXPECT_EQ(post("/api/job", body).status, 400U) << body;
  EXPECT_THAT(backend.actions, IsEmpty());
}

TEST_F(OctoPrintTest, TakesATfcFileAndSaysWhereItsJobIs) {
  const WebResponse made = upload("part.tfc", "TFC\r\n\r\n--X bytes");
  EXPECT_EQ(made.status, 201U);
  EXPECT_EQ(made.location, "/v1/jobs/u1");
  const json answer = json::parse(made.body);
  EXPECT_EQ(answer["done"], true);
  EXPECT_EQ(answer["files"]["local"]["name"], "part.tfc");
  EXPECT_EQ(answer["files"]["local"]["origin"], "local");
  EXPECT_TRUE(answer["files"]["local"]["refs"]["resource"].is_string());
  EXPECT_EQ(answer["effectivePrint"], false);
  ASSERT_THAT(backend.files, SizeIs(1));
  EXPECT_EQ(backend.files[0].content, "TFC\r\n\r\n--X bytes");
  EXPECT_FALSE(backend.files[0].start);
}

TEST_F(OctoPrintTest, PrintsAtOnceWhereTheFormAsksForIt) {
  EXPECT_EQ(upload("part.tfc", "x", "--XX\r\nContent-Disposition: form-data; name=\"print\"\r\n\r\ntrue\r\n").status,
            201U);
  ASSERT_THAT(backend.files, SizeIs(1));
  EXPECT_TRUE(backend.files[0].start);
}

TEST_F(OctoPrintTest, RefusesAPointCloudAndSaysWhereToSendIt) {
  const WebResponse refused = upload("statue.PLY", "ply");
  EXPECT_EQ(refused.status, 415U);
  EXPECT_THAT(refused.body, HasSubstr("telefab submit"));
  EXPECT_EQ(upload("part.gcode", "G1").status, 415U);
  EXPECT_EQ(upload("../../etc/cron.d/x", "x").status, 415U);
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST_F(OctoPrintTest, KeepsOnlyTheLastPartOfAFileName) {
  EXPECT_EQ(upload("..\\..\\C:\\prints/part.tfc", "x").status, 201U);
  ASSERT_THAT(backend.files, SizeIs(1));
  EXPECT_EQ(backend.files[0].name, "part.tfc");
}

TEST_F(OctoPrintTest, TakesNoBodyToSpeakOfWithoutTheKey) {
  FabWeb web{backend, sign_in, options};
  EXPECT_EQ(web.most_body({"POST", "/api/files/local", "Bearer wrong", {}, {}}), 0U);
  EXPECT_EQ(web.most_body({"POST", "/v1/jobs/job-1/pause", "Bearer secret", {}, {}}), 0U);
  EXPECT_GE(web.most_body({"POST", "/api/files/local", "Bearer secret", {}, {}}), 64U << 20U);
}

TEST(FormData, RefusesWhatIsNoForm) {
  for (const auto& [type, body] : std::vector<std::pair<std::string, std::string>>{
           {"application/json", "{}"},
           {"multipart/form-data", "--XX--"},
           {"multipart/form-data; boundary=", "----"},
           {"multipart/form-data; boundary=XX", ""},
           {"multipart/form-data; boundary=XX", "--XX"},
           {"multipart/form-data; boundary=XX", "--XX\r\nname"},
           {"multipart/form-data; boundary=XX", "--XX\r\n\r\nopen"},
           {"multipart/form-data; boundary=XX", "--XXjunk\r\n\r\n\r\n--XX--"}})
    EXPECT_FALSE(form_fields(type, body)) << type << '\n' << body;
}

TEST(FormData, OutlivesDamagedForms) {
  const std::string whole =
      "--XX\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a\\\"b.tfc\"\r\n\r\n1234\r\n--XX\r\n"
      "content-disposition: form-data; name=print\r\n\r\ntrue\r\n--XX--\r\n";
  const auto good = form_fields("multipart/form-data; boundary=\"XX\"", whole);
  ASSERT_TRUE(good) << good.error().what;
  ASSERT_THAT(*good, SizeIs(2));
  EXPECT_EQ((*good)[0].file_name, "a\"b.tfc");
  EXPECT_EQ((*good)[1].name, "print");
  EXPECT_EQ((*good)[1].content, "true");
  std::mt19937_64 rng{11};
  for (int i = 0; i < 5'000; ++i) {
    std::string damaged = whole.substr(0, rng() % (whole.size() + 1));
    for (auto n = rng() % 4; n > 0 && !damaged.empty(); --n) damaged[rng() % damaged.size()] = static_cast<char>(rng());
    const auto fields = form_fields("multipart/form-data; boundary=XX", damaged);
    if (!fields) continue;
    for (const FormField& field : *fields) EXPECT_LE(field.content.size(), damaged.size());
  }
}

}  // namespace
}  // namespace telefab::fab
