// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <random>
#include <regex>
#include <set>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/recording_backend.hpp>

namespace telefab::fab {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

const VirtualClock kClock;

/// Answers by the token "secret", as somebody on the machine itself.
WebResponse answer(const WebRequest& request, PageBackend& backend, const WebOptions& options = {"0.1.0", ""}) {
  SignIn sign_in{{.shared_token = "secret"}, kClock};
  return answer(request, backend, sign_in, options);
}

WebRequest ask(std::string method, std::string target, std::string authorization) {
  return {std::move(method), std::move(target), std::move(authorization), {}, {}};
}

std::string concrete(std::string_view pattern) {
  std::string path{pattern};
  if (const auto at = path.find("{id}"); at != std::string::npos) path.replace(at, 4, "job-1");
  if (const auto at = path.find("{layer}"); at != std::string::npos) path.replace(at, 7, "2");
  if (const auto at = path.find("{path}"); at != std::string::npos) path.replace(at, 6, "job-1");
  if (const auto at = path.find("{storage}"); at != std::string::npos) path.replace(at, 9, "local");
  return path;
}

TEST(WebRouter, AnswersEveryRouteOfItsTable) {
  RecordingBackend backend;
  for (const WebRoute& route : web_routes()) {
    if (route.path.starts_with("/api/v1/") || route.path.starts_with("/v1/files/")) continue;  // prusalink_test.cpp
    const WebResponse response = answer({std::string{route.method}, concrete(route.path), "Bearer secret"}, backend);
    // Without a body the two POSTs of OctoPrint's API, the sign-in and supports by hand say what is missing.
    EXPECT_THAT(response.status, testing::AnyOf(200U, 201U, 409U, 400U)) << route.path;
    EXPECT_EQ(response.status == 400, route.path == "/v1/sign-in" ||
                                          (route.method == "POST" && route.path.ends_with("/supports")) ||
                                          (route.needs == Access::Operators && route.path.starts_with("/api/")))
        << route.path;
    EXPECT_FALSE(response.body.empty()) << route.path;
  }
}

TEST(WebRouter, ListsTheJobsThatAreAskedForPageByPage) {
  RecordingBackend backend;
  const auto list = [&](const std::string& query) { return answer(ask("GET", "/v1/jobs" + query, ""), backend); };
  EXPECT_FALSE(json::parse(list("").body).contains("next"));
  EXPECT_TRUE(backend.asked_for.empty()) << "nothing is asked for: what goes on, and the newest";
  const json first = json::parse(list("?search=gro%C3%9Fe+vase&state=done,awaiting-approval&most=50").body);
  EXPECT_EQ(first["jobs"].size(), 1U);
  EXPECT_EQ(first["next"], 7);
  EXPECT_EQ(backend.asked_for.back(),
            (JobQuery{50, "gro\u00dfe vase", {JobState::Done, JobState::AwaitingApproval}, 0}));
  EXPECT_TRUE(json::parse(list("?before=7").body)["next"].is_null());
  EXPECT_EQ(backend.asked_for.back(), (JobQuery{.before = 7}));
  for (const char* bad : {"?state=lost", "?state=", "?most=0", "?most=1001", "?most=x", "?before=0", "?before=-1",
                          "?before=99999999999999999999", "?search=%1b[2J"})
    EXPECT_EQ(list(bad).status, 400U) << bad;
  EXPECT_EQ(list("?search=" + std::string(300, 'a')).status, 400U);
}

TEST(WebRouter, MakesANewJobOfTheLayersOfAnotherForAnOperatorAlone) {
  RecordingBackend backend;
  EXPECT_EQ(answer(ask("POST", "/v1/jobs/job-1/again", ""), backend).status, 401);
  EXPECT_EQ(backend.printed_again, 0);
  const WebResponse made = answer(ask("POST", "/v1/jobs/job-1/again", "Bearer secret"), backend);
  EXPECT_EQ(made.status, 201);
  EXPECT_EQ(made.location, "/v1/jobs/u2");
  EXPECT_EQ(backend.printed_again, 1);
  EXPECT_EQ(answer(ask("POST", "/v1/jobs/job-9/again", "Bearer secret"), backend).status, 409);
}

TEST(WebRouter, TellsWhatAPrintDoesThisMomentAndNothingOfMachinesWithoutOne) {
  RecordingBackend backend;
  const auto machines = nlohmann::json::parse(answer(ask("GET", "/v1/machines", ""), backend).body)["machines"];
  EXPECT_EQ(machines[0]["now"],
            nlohmann::json({{"phase", "exposing"}, {"light", true}, {"z_mm", 0.4}, {"resin_celsius", 24.5}}));
  EXPECT_TRUE(machines[1]["now"].is_null());
}

TEST(WebRouter, TellsWhatEachMachineIsAtInTheOrderOfTheFabsList) {
  RecordingBackend backend;
  const WebResponse response = answer(ask("GET", "/v1/machines", ""), backend);
  ASSERT_EQ(response.status, 200U);
  const json machines = json::parse(response.body)["machines"];
  ASSERT_THAT(machines, SizeIs(4));
  EXPECT_EQ(machines[0]["name"], "hall-1");
  EXPECT_EQ(machines[0]["state"], "printing");
  EXPECT_EQ(machines[0]["job"], "job-1");
  EXPECT_EQ(machines[0]["seconds_left"], 84);
  EXPECT_EQ(machines[1]["state"], "occupied");
  EXPECT_TRUE(machines[1]["seconds_left"].is_null()) << "not known";
  EXPECT_EQ(json::parse(event_data(backend))["machines"], machines) << "the stream tells the same";
  const std::string metrics = answer(ask("GET", "/metrics", ""), backend).body;
  EXPECT_THAT(metrics, HasSubstr(R"(telefab_machine_state{machine="hall-1",profile="machine-a",state="printing"} 1)"));
  EXPECT_THAT(metrics, HasSubstr(R"(telefab_machine_state{machine="hall-1",profile="machine-a",state="idle"} 0)"));
  EXPECT_THAT(metrics, HasSubstr(R"(telefab_machine_waiting_jobs{machine="hall-1"} 2)"));
}

TEST(WebRouter, SaysOfItsHealthWhetherChangesCanBeKept) {
  RecordingBackend backend;
  EXPECT_EQ(answer(ask("GET", "/v1/health", ""), backend).status, 200U);
  backend.health = fail(ErrorCode::StorageFailed, "job store: disk full");
  const WebResponse sick = answer(ask("GET", "/v1/health", ""), backend);
  EXPECT_EQ(sick.status, 503U);
  EXPECT_THAT(sick.body, HasSubstr("disk full"));
}

/// A list of jobs that cannot be read any more.
class UnreadableBackend final : public RecordingBackend {
 public:
  [[nodiscard]] Result<std::vector<JobView>> jobs() override {
    return fail(ErrorCode::NotTrusted, "job store: database disk image is malformed");
  }
};

TEST(WebRouter, IsSickRatherThanForbiddenWhereItsListIsDamaged) {
  UnreadableBackend backend;
  const WebResponse sick = answer(ask("GET", "/v1/health", ""), backend);
  EXPECT_EQ(sick.status, 503U);
  EXPECT_THAT(sick.body, HasSubstr("malformed"));
}

TEST(WebRouter, NeverChangesStateOnGetOrHead) {
  RecordingBackend backend;
  for (const WebRoute& route : web_routes())
    for (const char* method : {"GET", "HEAD"})
      (void)answer(ask(method, concrete(route.path), "Bearer secret"), backend);
  EXPECT_THAT(backend.actions, IsEmpty());
  EXPECT_THAT(backend.hand_lists, IsEmpty());
}

TEST(WebRouter, PassesSupportsByHandOnWholeAndUnderTheOperatorsName) {
  RecordingBackend backend;
  const std::string list = R"({"extra":[{"x_mm":1,"y_mm":2,"z_mm":3}]})";
  const WebRequest wanted{"POST", "/v1/jobs/job-1/supports", "Bearer secret", "application/json", list};
  EXPECT_EQ(answer(wanted, backend).status, 200U);
  ASSERT_THAT(backend.hand_lists, SizeIs(1));
  EXPECT_EQ(backend.hand_lists[0], (std::pair<std::string, std::string>{"job-1", list}));
  EXPECT_THAT(backend.names, SizeIs(1));
  EXPECT_THAT(answer(ask("GET", "/v1/jobs/job-1/supports", ""), backend).body, HasSubstr(R"("tip":"light")"));
}

TEST(WebRouter, PicturesOfAPlanAreNotKeptForItMayBePlannedAgain) {
  RecordingBackend backend;
  for (const char* path :
       {"/v1/jobs/job-1/layers/2/mask.png", "/v1/jobs/job-1/preview.png", "/v1/jobs/job-1/accuracy.png"})
    EXPECT_FALSE(answer(ask("GET", path, ""), backend).cacheable) << path;
}

/// Its job was planned at the time that the test says.
class PlannedBackend final : public RecordingBackend {
 public:
  [[nodiscard]] Result<JobView> job(std::string_view id) override {
    auto view = RecordingBackend::job(id);
    if (view) view->planned_unix_ms = planned_unix_ms;
    return view;
  }
  std::int64_t planned_unix_ms = 1234567890123;
};

TEST(WebRouter, PicturesAreKeptByWhoAsksForThoseOfThePlanThereIs) {
  PlannedBackend backend;
  for (const std::string path : {"/v1/jobs/job-1/layers/2/mask.png", "/v1/jobs/job-1/layers/2",
                                 "/v1/jobs/job-1/preview.png", "/v1/jobs/job-1/view.png"}) {
    backend.planned_unix_ms = 1234567890123;
    EXPECT_TRUE(answer(ask("GET", path + "?plan=1234567890123", ""), backend).is_immutable) << path;
    EXPECT_FALSE(answer(ask("GET", path + "?plan=1234567890122", ""), backend).is_immutable) << path;
    EXPECT_FALSE(answer(ask("GET", path, ""), backend).is_immutable) << path;
    backend.planned_unix_ms = 0;
    EXPECT_FALSE(answer(ask("GET", path + "?plan=0", ""), backend).is_immutable) << path << ": it is not planned";
  }
  backend.planned_unix_ms = 1234567890123;
  EXPECT_FALSE(answer(ask("GET", "/v1/jobs/job-1/layers/3/mask.png?plan=1234567890123", ""), backend).is_immutable)
      << "what is not there may come";
  EXPECT_FALSE(answer(ask("GET", "/v1/jobs/job-1/accuracy.png?plan=1234567890123", ""), backend).is_immutable);
}

TEST(WebRouter, NamesEachFileOfItsPageByItsBytesSoThatItIsKeptUntilTheNextRelease) {
  RecordingBackend backend;
  const std::string page = answer(ask("GET", "/", ""), backend).body;
  EXPECT_FALSE(answer(ask("GET", "/", ""), backend).is_immutable);
  static const std::regex named{R"re((src|href)="(/[a-z]+\.(js|css|svg))(\?v=[0-9a-f]{16})?")re"};
  std::size_t count = 0;
  for (std::sregex_iterator each{page.begin(), page.end(), named}, end; each != end; ++each, ++count) {
    const std::string path = (*each)[2], version = (*each)[4];
    EXPECT_FALSE(version.empty()) << path;
    const WebResponse kept = answer(ask("GET", path + version, ""), backend);
    EXPECT_EQ(kept.status, 200U);
    EXPECT_TRUE(kept.is_immutable) << path;
    EXPECT_FALSE(answer(ask("GET", path, ""), backend).is_immutable) << path;
    EXPECT_FALSE(answer(ask("GET", path + "?v=0123456789abcdef", ""), backend).is_immutable) << path;
  }
  EXPECT_GE(count, 8U);
}

TEST(WebRouter, WantsTheTokenForWhateverChangesState) {
  RecordingBackend backend;
  for (const WebRoute& route : web_routes()) {
    if (route.needs != Access::Operators) continue;
    for (const char* shown :
         {"", "Bearer ", "Bearer secre", "Bearer secrets", "Bearer SECRET", "Basic secret", "secret"}) {
      // A wrong key is refused as OctoPrint does; who shows none may still log in.
      const bool is_octoprint = route.path.starts_with("/api/") && !route.path.starts_with("/api/v1/");
      const bool is_key = std::string_view{shown}.starts_with("Bearer ");
      EXPECT_EQ(answer(ask(std::string{route.method}, concrete(route.path), shown), backend).status,
                is_octoprint && is_key ? 403U : 401U)
          << route.method << ' ' << route.path << ' ' << shown;
    }
  }
  EXPECT_THAT(backend.actions, IsEmpty());
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST(WebRouter, ChangesNothingAtAllWhereNoTokenIsSet) {
  RecordingBackend backend;
  SignIn nobody{{}, kClock};
  EXPECT_EQ(answer(ask("POST", "/v1/jobs/job-1/pause", "Bearer "), backend, nobody, {}).status, 401U);
  EXPECT_THAT(backend.actions, IsEmpty());
}

TEST(WebRouter, PausesWithTheToken) {
  RecordingBackend backend;
  EXPECT_EQ(answer(ask("POST", "/v1/jobs/job-1/pause", "Bearer secret"), backend).status, 200U);
  ASSERT_THAT(backend.actions, SizeIs(1));
  EXPECT_EQ(backend.actions[0].second, JobCommand::Pause);
}

/// A job that has not ended.
class UnfinishedBackend final : public RecordingBackend {
 public:
  [[nodiscard]] Result<void> act(std::string_view, JobCommand, std::string_view) override {
    return fail(ErrorCode::Conflict, "job job-1 is printing: only a job that has ended can be forgotten");
  }
};

TEST(WebRouter, ForgetsAJobAndAnswersItsNameOrWhyItStays) {
  RecordingBackend backend;
  const WebResponse gone = answer(ask("POST", "/v1/jobs/job-1/forget", "Bearer secret"), backend);
  EXPECT_EQ(gone.status, 200U);
  EXPECT_EQ(json::parse(gone.body), json({{"forgotten", "job-1"}})) << "there is no job to show any more";
  ASSERT_THAT(backend.actions, SizeIs(1));
  EXPECT_EQ(backend.actions[0].second, JobCommand::Forget);
  UnfinishedBackend unfinished;
  const WebResponse stays = answer(ask("POST", "/v1/jobs/job-1/forget", "Bearer secret"), unfinished);
  EXPECT_EQ(stays.status, 409U);
  EXPECT_THAT(stays.body, HasSubstr("only a job that has ended"));
}

TEST(WebRouter, ResumesWithOrWithoutAWordAboutTheLayerPerhapsExposed) {
  const std::pair<const char*, JobCommand> bodies[]{{"", JobCommand::Resume},
                                                    {"{}", JobCommand::Resume},
                                                    {R"({"as":"treat-as-exposed"})", JobCommand::TreatAsExposed},
                                                    {R"({ "as" : "expose-again" })", JobCommand::ExposeAgain}};
  for (const auto& [body, action] : bodies) {
    RecordingBackend backend;
    EXPECT_EQ(answer({"POST", "/v1/jobs/job-1/resume", "Bearer secret", "application/json", body}, backend).status,
              200U)
        << body;
    ASSERT_THAT(backend.actions, SizeIs(1));
    EXPECT_EQ(backend.actions[0].second, action) << body;
  }
}

TEST(WebRouter, RefusesAnyOtherWordAboutTheLayerPerhapsExposed) {
  for (const char* body : {R"({"as":"lit"})", R"({"as":1})", R"(["expose-again"])", R"({"as":"expose-again","and":1})",
                           "expose-again", "{"}) {
    RecordingBackend backend;
    EXPECT_EQ(answer({"POST", "/v1/jobs/job-1/resume", "Bearer secret", "application/json", body}, backend).status,
              400U)
        << body;
    EXPECT_THAT(backend.actions, IsEmpty());
  }
}

TEST(WebRouter, ApprovesWhatIsHeldOnlyByTheNamesInTheBody) {
  RecordingBackend backend;
  const auto approve = [&](const char* body) {
    return answer({"POST", "/v1/jobs/job-1/approve", "Bearer secret", "application/json", body}, backend).status;
  };
  EXPECT_EQ(approve(R"({"although":["islands","supports"]})"), 200U);
  ASSERT_EQ(backend.approvals.size(), 1U);
  EXPECT_EQ(backend.approvals[0].second, "islands,supports");
  for (const char* body : {"[]", R"({"although":"islands"})", R"({"although":[1]})", R"({"other":[]})", "{"})
    EXPECT_EQ(approve(body), 400U) << body;
  EXPECT_EQ(backend.approvals.size(), 1U);
}

TEST(WebRouter, SaysConflictWithTheReasonOfTheBackend) {
  RecordingBackend backend;
  const WebResponse response = answer(ask("POST", "/v1/jobs/job-1/approve", "Bearer secret"), backend);
  EXPECT_EQ(response.status, 409U);
  EXPECT_THAT(response.body, HasSubstr("does not wait for approval"));
}

TEST(WebRouter, RefusesPathTricksAndUnknownPaths) {
  RecordingBackend backend;
  for (const char* target : {"/../etc/passwd", "/v1/jobs/../../etc/passwd", "/v1/jobs/%2e%2e", "/v1/jobs//events",
                             "/v1/jobs/a b", "/v1/jobs/job-1/layers/-1", "/v1/jobs/job-1/layers/99999999999",
                             "/v1/jobs/job-1/layers/1e3", "//", "", "*", "/v1/jobs/", "/V1/jobs"})
    EXPECT_EQ(answer(ask("GET", target, ""), backend).status, 404U) << target;
  EXPECT_EQ(answer(ask("DELETE", "/v1/jobs/job-1", "Bearer secret"), backend).status, 405U);
}

TEST(WebRouter, ChangesNothingUnderTenThousandMalformedRequests) {
  RecordingBackend backend;
  std::mt19937_64 rng{7};
  const std::vector<std::string> parts{"/",   "v1",       "jobs",   "job-1", "pause", "cancel",
                                       "..",  "%00",      "layers", "api",   "files", "local",
                                       "job", "\xff\xfe", "?",      "{id}",  "0",     std::string(300, 'a')};
  const std::vector<std::string> methods{"GET", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "\r\n", ""};
  for (int i = 0; i < 10'000; ++i) {
    WebRequest request = ask(methods[rng() % methods.size()], "", rng() % 2 ? "Bearer wrong" : "");
    for (auto n = rng() % 8; n > 0; --n) request.target += (rng() % 3 ? "/" : "") + parts[rng() % parts.size()];
    const WebResponse response = answer(request, backend);
    EXPECT_THAT(response.status, testing::AnyOf(200U, 401U, 403U, 404U, 405U));
  }
  EXPECT_THAT(backend.actions, IsEmpty());
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST(WebRouter, EscapesNamesInJson) {
  RecordingBackend backend;
  const json jobs = json::parse(answer(ask("GET", "/v1/jobs", ""), backend).body);
  EXPECT_EQ(jobs["jobs"][0]["name"], "a \"statue\" <b>.ply");
  EXPECT_EQ(event_data(backend).find('\n'), std::string::npos);
}

TEST(WebRouter, HandsOutTheBackendsReportsAndPicturesAsTheyAre) {
  RecordingBackend backend;
  const std::string job = "/v1/jobs/job-1/";
  const std::pair<std::string, std::string> texts[] = {{"report", *backend.report("job-1")},
                                                       {"preflight", *backend.preflight("job-1")},
                                                       {"exposures", *backend.exposures("job-1")},
                                                       {"layers/2", *backend.layer_json("job-1", 2)}};
  for (const auto& [route, text] : texts) {
    const WebResponse response = answer(ask("GET", job + route, ""), backend);
    EXPECT_EQ(response.status, 200U) << route;
    EXPECT_EQ(json::parse(response.body), json::parse(text)) << route;
    EXPECT_THAT(response.content_type, HasSubstr("application/json")) << route;
  }
  for (const char* route : {"preview.png", "accuracy.png", "layers/2/mask.png"}) {
    const WebResponse response = answer(ask("GET", job + route, ""), backend);
    EXPECT_EQ(response.status, 200U) << route;
    EXPECT_EQ(response.body, "\x89") << route;
    EXPECT_EQ(response.content_type, "image/png") << route;
  }
  EXPECT_EQ(answer(ask("GET", job + "layers/3/mask.png", ""), backend).status, 404U);
}

TEST(WebRouter, ServesThePageAndItsPartsWithoutOutsideRequests) {
  RecordingBackend backend;
  for (const char* path : {"/", "/page.css", "/jobs.js", "/page.js", "/supports.js", "/solid.js", "/icon.svg"}) {
    const WebResponse response = answer(ask("GET", path, ""), backend);
    EXPECT_EQ(response.status, 200U) << path;
    std::string body = response.body;
    const std::string name_space = "http://www.w3.org/2000/svg";
    if (const auto at = body.find(name_space); at != std::string::npos) body.erase(at, name_space.size());
    EXPECT_THAT(body, testing::Not(HasSubstr("://"))) << path;
  }
}

TEST(WebRouter, ServesTheThreeDimensionalLibraryOnlyWhereItIsInstalled) {
  RecordingBackend backend;
  EXPECT_EQ(answer(ask("GET", "/three.js", ""), backend).status, 404U);
  WebOptions options;
  options.three_js = "var THREE = {};";
  EXPECT_EQ(answer(ask("GET", "/three.js", ""), backend, options).body, options.three_js);
}

TEST(WebRouter, MetricsTellStatesStagesAndLightInPrometheusText) {
  RecordingBackend backend;
  const WebResponse response = answer(ask("GET", "/metrics", ""), backend);
  EXPECT_THAT(response.body, HasSubstr("# TYPE telefab_jobs gauge"));
  EXPECT_THAT(response.body, HasSubstr("telefab_jobs{state=\"printing\"} 1"));
  EXPECT_THAT(response.body, HasSubstr("telefab_jobs{state=\"failed\"} 0"));
  EXPECT_THAT(response.body, HasSubstr("telefab_job_layers_printed{job=\"job-1\""));
  EXPECT_THAT(response.body, HasSubstr("telefab_job_stage_seconds{job=\"job-1\",stage=\"plan\"} 4.5"));
  EXPECT_THAT(response.body, HasSubstr("telefab_job_planned_exposure_seconds"));
}

}  // namespace
}  // namespace telefab::fab
