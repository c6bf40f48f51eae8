// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <set>

#include "../../campaign/web/web_fab.hpp"
#include "scan_page_site.hpp"

namespace telefab::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

class StagedUploads : public ScanPageSite {};

TEST_F(StagedUploads, GoOnWhereTheyStoppedAfterAKillAndBecomeTheSameJobAsSubmit) {
  start_with_page();
  const std::string bytes = text_of(torus());
  const json begun = begin("torus.xyz", bytes);
  const auto id = begun["id"].get<std::string>();
  ASSERT_EQ(ask("POST", "/v1/uploads/" + id + "/part?from=0", bytes.substr(0, 1000)).status, 200);
  kill_scan();
  start_scan_with_page();
  const json again = begin("torus.xyz", bytes);
  EXPECT_EQ(again["id"], id);
  EXPECT_EQ(again["received_bytes"], 1000) << "it goes on behind what was answered";
  send_rest(again, bytes, 7777);
  const json there = rested(id);
  ASSERT_EQ(there["state"], "whole") << there.dump();
  EXPECT_EQ(there["reading"]["result"]["points"], 90 * 36);

  const std::string question = R"({"machine":"toy","parameters":{"height_mm":4}})";
  ASSERT_EQ(ask("POST", "/v1/uploads/" + id + "/look", question).status, 200);
  ASSERT_EQ(ask("POST", "/v1/uploads/" + id + "/estimate", question).status, 200);
  const json known = rested(id);
  EXPECT_EQ(known["look"]["result"]["kept"], 90 * 36) << known.dump();
  EXPECT_NEAR(known["estimate"]["result"]["figures"]["size_mm"][2].get<double>(), 4, 0.1) << known.dump();
  EXPECT_GE(known["estimate"]["result"]["figures"]["layers"].get<int>(), 20);
  const Answer level = ask(
      "GET", fmt::format("/v1/uploads/{}/levels/0?revision={}", id, known["picture"]["revision"].get<std::uint64_t>()));
  EXPECT_EQ(level.status, 200);
  EXPECT_EQ(level.body.size(), 64 + 12 * known["picture"]["points"].get<std::size_t>());

  // All of it stands in the description of the API, and nothing else.
  const json api = ask("GET", "/openapi.json").json();
  const auto keys = [](const json& of) {
    std::set<std::string> names;
    for (const auto& each : of.items()) names.insert(each.key());
    return names;
  };
  ASSERT_TRUE(api.is_object());
  const json& view_schema = api["components"]["schemas"]["UploadView"]["properties"];
  EXPECT_EQ(keys(known), keys(view_schema));
  EXPECT_EQ(keys(known["picture"]), keys(view_schema["picture"]["properties"]));
  for (const char* task : {"reading", "look", "estimate", "orientation", "joining"})
    for (const std::string& key : keys(known[task]))
      EXPECT_TRUE(api["components"]["schemas"]["StagedTask"]["properties"].contains(key)) << task << ' ' << key;

  // Twice: the upload stays for the next job.
  for (int times = 0; times < 2; ++times) {
    const Answer made = ask("POST", "/v1/uploads/" + id + "/submit", question);
    ASSERT_EQ(made.status, 201) << made.body;
    const json job = made.json();
    EXPECT_EQ(job["name"], "torus.xyz");
    EXPECT_EQ(job["parameters"]["height_mm"], 4);
    EXPECT_EQ(job["scan_bytes"], bytes.size());
    const json done = ended(job["id"]);
    EXPECT_EQ(done["state"], "done") << done.dump();
    EXPECT_EQ(done["layers"], 20);
    const json layer = ask("GET", fmt::format("/v1/jobs/{}/layers/10", job["id"].get<std::string>())).json();
    ASSERT_FALSE(layer["rings"].empty());
    for (std::size_t r = 0; r < layer["rings"].size(); ++r) {
      std::size_t edges = 0;
      for (const json& run : layer["kinds"][r]) edges += run[1].get<std::size_t>();
      EXPECT_EQ(edges, layer["rings"][r].size()) << "every edge rests on something, and is drawn";
    }
    EXPECT_EQ(layer["rings"].size(), 2U) << "a torus cut in the middle: " << layer.dump().substr(0, 300);
    EXPECT_EQ(ask("GET", fmt::format("/v1/jobs/{}/layers/20", job["id"].get<std::string>())).status, 404);
  }
  const std::string submitted = submit_torus();
  const json twin = ended(submitted);
  EXPECT_EQ(twin["state"], "done");
  const auto first = ask("GET", "/v1/jobs").json()["jobs"].back()["id"].get<std::string>();
  EXPECT_EQ(text_of(folder() / "scan" / "jobs" / first / "chunks"),
            text_of(folder() / "scan" / "jobs" / submitted / "chunks"))
      << "the same layers as of a scan that came from a command line";
  EXPECT_EQ(ask("POST", "/v1/uploads/" + id + "/discard").status, 200);
  EXPECT_EQ(ask("GET", "/v1/uploads/" + id).status, 404);
  // The line is written by the daemon's loop, a moment after the answer.
  const auto audit = [&] { return text_of(folder() / "scan" / "audit.log"); };
  for (int tries = 0; tries < 200 && audit().find("discard upload") == std::string::npos; ++tries)
    ::poll(nullptr, 0, 25);
  EXPECT_THAT(audit(), HasSubstr("discard upload " + id));
}

TEST_F(StagedUploads, AreCopiedForAJobWhereTheirFileSystemGivesNoSecondName) {
  // The uploads on another file system than the jobs.
  struct stat here {
  }, there{};
  if (::stat(folder().c_str(), &here) != 0 || ::stat("/dev/shm", &there) != 0 || here.st_dev == there.st_dev)
    GTEST_SKIP() << "/dev/shm is no file system of its own here";
  const ScratchFolder elsewhere{"/dev/shm"};
  std::error_code error;
  std::filesystem::create_directories(folder() / "scan", error);
  std::filesystem::create_directory_symlink(elsewhere.path(), folder() / "scan" / "uploads", error);
  ASSERT_FALSE(error) << error.message();
  start_with_page();
  const std::string bytes = text_of(torus());
  const json begun = begin("torus.xyz", bytes);
  send_rest(begun, bytes, 1U << 20U);
  const auto id = begun["id"].get<std::string>();
  ASSERT_EQ(rested(id)["state"], "whole");
  const std::string question = R"({"machine":"toy","parameters":{"height_mm":4}})";
  for (int times = 0; times < 2; ++times) {
    const Answer made = ask("POST", "/v1/uploads/" + id + "/submit", question);
    ASSERT_EQ(made.status, 201) << made.body;
    EXPECT_EQ(ended(made.json()["id"])["state"], "done");
  }
  // Reports that are fetched from the fab come through the same folder.
  for (const auto& left : std::filesystem::directory_iterator{folder() / "scan" / "incoming"})
    EXPECT_EQ(left.path().filename().string().find("staged"), std::string::npos) << left.path();
}

TEST_F(StagedUploads, AreEstimatedAgainOnceTheFabsProfilesTakeThePlaceOfTheSites) {
  start_fab();
  kill_fab();
  start_scan_with_page();
  const std::string bytes = text_of(torus());
  const json begun = begin("torus.xyz", bytes);
  send_rest(begun, bytes, 1U << 20U);
  const auto id = begun["id"].get<std::string>();
  (void)rested(id);
  const auto layers = [&] {
    EXPECT_EQ(
        ask("POST", "/v1/uploads/" + id + "/estimate", R"({"machine":"toy","parameters":{"height_mm":4}})").status,
        200);
    return rested(id)["estimate"]["result"]["figures"]["layers"].get<int>();
  };
  const int of_the_site = layers();
  const auto profile = folder() / "machines" / "toy.toml";
  std::string text = text_of(profile);
  const std::string thickness = "thickness_mm = 0.2";
  ASSERT_NE(text.find(thickness), std::string::npos);
  text.replace(text.find(thickness), thickness.size(), "thickness_mm = 0.1");
  std::ofstream{profile} << text;
  start_fab();
  for (int tries = 0;
       tries < 400 && ask("GET", "/v1/profiles").json()["origin"].get<std::string>().starts_with("this scan site");
       ++tries)
    ::poll(nullptr, 0, 25);
  EXPECT_NEAR(layers(), 2 * of_the_site, 2);
}

TEST_F(StagedUploads, OfHostileFilesFailTheirOwnRequestsAlone) {
  start_with_page();
  const std::string good = text_of(torus());
  const std::string ply = "ply\nformat binary_little_endian 1.0\nelement vertex ";
  const std::vector<std::string> hostile{
      "\x7f"
      "ELF nothing of a scan",
      ply + "4294967295\nproperty float x\nproperty float y\nproperty float z\nend_header\nabc",
      ply + "-7\nproperty float x\nend_header\n",
      std::string(100'000, '\0'),
      "1 2 3\n4 5 nan\ninf inf inf\n1e300 1e300 1e300\n",
      "0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n",
      good.substr(0, good.size() / 2) + std::string(5000, '\xff'),
      "<svg xmlns=\"http://www.w3.org/2000/svg\"><script>alert(1)</script></svg>",
  };
  const std::string question = R"({"machine":"toy","parameters":{"height_mm":4}})";
  int number = 0;
  for (const std::string& bytes : hostile) {
    const json begun = begin(fmt::format("hostile-{}.ply", ++number), bytes);
    const auto id = begun["id"].get<std::string>();
    send_rest(begun, bytes, 1U << 20U);
    (void)rested(id);
    for (const char* what : {"look", "estimate", "orient"})
      EXPECT_EQ(ask("POST", "/v1/uploads/" + id + "/" + what, question).status, 200);
    const json view = rested(id);
    EXPECT_EQ(view["state"], "whole");
    EXPECT_NE(view["estimate"]["state"], "done") << number << view.dump().substr(0, 500);
    EXPECT_EQ(view["reading"]["state"] == "failed", view["reading"].contains("why"));
  }
  const json begun = begin("torus.xyz", good);
  send_rest(begun, good, 1U << 20U);
  const auto id = begun["id"].get<std::string>();
  (void)rested(id);
  ASSERT_EQ(ask("POST", "/v1/uploads/" + id + "/estimate", question).status, 200);
  EXPECT_EQ(rested(id)["estimate"]["state"], "done") << "whoever comes next is served";
}

TEST_F(StagedUploads, RefuseWhatTheyShouldByNameAndStatus) {
  start_with_page();
  const std::string bytes = text_of(torus());
  EXPECT_EQ(
      ask("POST", "/v1/uploads", R"({"name":"../x","size_bytes":1,"sha256":")" + std::string(64, 'a') + "\"}").status,
      400);
  const Answer large = ask("POST", "/v1/uploads",
                           R"({"name":"x","size_bytes":99999999999999,"sha256":")" + std::string(64, 'a') + "\"}");
  EXPECT_EQ(large.status, 413);
  EXPECT_THAT(large.body, HasSubstr("the limit is"));
  const json begun = begin("torus.xyz", bytes);
  const auto id = begun["id"].get<std::string>();
  const std::string question = R"({"machine":"toy","parameters":{"height_mm":4}})";
  for (const char* what : {"look", "estimate", "orient", "submit"})
    EXPECT_EQ(ask("POST", "/v1/uploads/" + id + "/" + what, question).status, 409) << "it is not whole";
  const Answer elsewhere = ask("POST", "/v1/uploads/" + id + "/part?from=5", "abc");
  EXPECT_EQ(elsewhere.status, 409);
  EXPECT_THAT(elsewhere.body, HasSubstr("goes on at byte 0"));
  send_rest(begun, bytes, 1U << 20U);
  (void)rested(id);
  EXPECT_EQ(ask("POST", "/v1/uploads/" + id + "/estimate", R"({"machine":"nobody"})").status, 400);
  EXPECT_EQ(ask("POST", "/v1/uploads/" + id + "/submit", R"({"machine":"toy","parameters":{"heigth_mm":4}})").status,
            400);
  EXPECT_EQ(ask("POST", "/v1/uploads/" + id + "/orient", R"({"machine":"toy","for":"beauty"})").status, 400);
  EXPECT_TRUE(ask("GET", "/v1/jobs").json()["jobs"].empty());
  EXPECT_TRUE(std::filesystem::is_empty(folder() / "scan" / "incoming"));
}

TEST_F(StagedUploads, StandHostileRequestsAndChangeNothing) {
  start_with_page();
  const std::string bytes = text_of(torus());
  const json begun = begin("torus.xyz", bytes);
  const auto id = begun["id"].get<std::string>();
  ASSERT_EQ(ask("POST", "/v1/uploads/" + id + "/part?from=0", bytes.substr(0, 500)).status, 200);
  const HostileCount found = ask_hostile(web_port(), id, 400, 11, HostileSite::Scan);
  EXPECT_EQ(found.asked, 400U);
  EXPECT_EQ(found.wrong, 0U) << found.first_wrong;
  const json view = ask("GET", "/v1/uploads/" + id).json();
  EXPECT_EQ(view["received_bytes"], 500);
  EXPECT_EQ(ask("GET", "/v1/uploads").json()["uploads"].size(), 1U);
  EXPECT_TRUE(ask("GET", "/v1/jobs").json()["jobs"].empty());
}

TEST_F(StagedUploads, ThatWaitedForTheirCopyWhenTheSiteEndedBecomeJobsWhenItBeginsAgain) {
  start_with_page();
  const std::string id = upload("torus.xyz", text_of(torus()));
  ASSERT_EQ(rested(id)["state"], "whole");
  kill_scan();
  // As the daemon leaves it; one more whose upload is gone.
  const auto waiting = folder() / "scan" / "waiting";
  std::filesystem::create_directories(waiting);
  const json kept{{"upload", id}, {"machine", "toy"}, {"parameters", {{"height_mm", 4}}}, {"who", "ada"}};
  std::ofstream{waiting / "0a"} << kept.dump();
  json lost = kept;
  lost["upload"] = "0123456789abcdef";
  std::ofstream{waiting / "0b"} << lost.dump();
  start_scan_with_page();
  json jobs;
  for (int tries = 0; tries < 200 && jobs.empty(); ++tries, ::poll(nullptr, 0, 50))
    jobs = ask("GET", "/v1/jobs").json()["jobs"];
  ASSERT_EQ(jobs.size(), 1U);
  EXPECT_EQ(jobs[0]["name"], "torus.xyz");
  EXPECT_EQ(jobs[0]["owner"], "ada");
  EXPECT_TRUE(std::filesystem::is_empty(waiting)) << "each becomes a job once";
  EXPECT_EQ(ended(jobs[0]["id"])["state"], "done");
  EXPECT_THAT(text_of(folder() / "scan" / "audit.log"), HasSubstr("submit failed: 0b waited for its copy"));
  kill_scan();
  start_scan_with_page();
  EXPECT_EQ(ask("GET", "/v1/jobs").json()["jobs"].size(), 1U);
}

TEST_F(StagedUploads, OnAnotherFileSystemThanTheJobsAreCopiedAndNothingWaitsAfterwards) {
  const std::filesystem::path other = "/dev/shm";
  std::filesystem::create_directories(folder() / "scan");
  struct stat here {
  }, there{};
  if (::stat(other.c_str(), &there) != 0 || ::stat((folder() / "scan").c_str(), &here) != 0 ||
      here.st_dev == there.st_dev || ::access(other.c_str(), W_OK) != 0)
    GTEST_SKIP() << "/dev/shm is no other file system here";
  const auto uploads = other / ("telefab-uploads-" + std::to_string(::getpid()));
  std::filesystem::create_directories(uploads);
  std::filesystem::create_directory_symlink(uploads, folder() / "scan" / "uploads");
  start_with_page();
  const std::string id = upload("torus.xyz", text_of(torus()));
  ASSERT_EQ(rested(id)["state"], "whole");
  const Answer sent = ask("POST", "/v1/uploads/" + id + "/submit", R"({"machine":"toy","parameters":{"height_mm":4}})");
  EXPECT_EQ(sent.status / 100, 2) << sent.body;
  EXPECT_EQ(ask("GET", "/v1/jobs").json()["jobs"].size(), 1U);
  EXPECT_TRUE(std::filesystem::is_empty(folder() / "scan" / "waiting")) << "it was kept until it was copied";
  kill_scan();
  std::filesystem::remove_all(uploads);
}

class SignInLink : public ScanPageSite {
 protected:
  [[nodiscard]] Outcome asked_for(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words{std::string{::getenv("TELEFAB_BIN")} + "/telefab-scan", "page-link", "--data",
                                   (folder() / "scan").string()};
    words.insert(words.end(), more.begin(), more.end());
    return run(words);
  }
};

TEST_F(SignInLink, OfADaemonThatRunsSignsInOnce) {
  start_with_page();
  const Outcome made = asked_for();
  ASSERT_EQ(made.code, 0) << made.errors;
  const std::string address = fmt::format("http://127.0.0.1:{}/#sign-in=", web_port());
  ASSERT_EQ(made.output.substr(0, address.size()), address);
  const std::string key = made.output.substr(address.size(), 32);
  const auto shown = [&] {
    return http_ask(web_port(), "POST", "/v1/sign-in", "", json{{"link", key}}.dump()).substr(0, 12);
  };
  EXPECT_EQ(shown(), "HTTP/1.1 200");
  EXPECT_EQ(shown(), "HTTP/1.1 401");
  EXPECT_EQ(asked_for({"--json"}).code, 0);
  kill_scan();
  EXPECT_THAT(text_of(folder() / "scan" / "audit.log"),
              HasSubstr(R"("who":"web","what":"signed in at the page by a link")"));
}

TEST_F(SignInLink, IsRefusedWithWhatToDoWhereNoPageTakesOne) {
  start_with_page();
  const Outcome added = run({std::string{::getenv("TELEFAB_BIN")} + "/telefab-scan", "tokens", "add", "ada", "--data",
                             (folder() / "scan").string()});
  ASSERT_EQ(added.code, 0) << added.errors;
  const Outcome by_name = asked_for();
  EXPECT_EQ(by_name.code, 2);
  EXPECT_THAT(by_name.errors, HasSubstr("tokens add NAME"));
  kill_scan();
  const Outcome stopped = asked_for();
  EXPECT_EQ(stopped.code, 2);
  EXPECT_THAT(stopped.errors, HasSubstr("no daemon works in"));
  EXPECT_FALSE(std::filesystem::exists(folder() / "scan" / "page-link"));
}

}  // namespace
}  // namespace telefab::test
