// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/two_sites.hpp>
#include <thread>

// Prints that other programs cut, sent to a fab as files.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::HasSubstr;
namespace fs = std::filesystem;

class ForeignFiles : public TwoSites {
 protected:
  [[nodiscard]] Outcome tool(std::vector<std::string> words) const {
    words[0] = std::string{std::getenv("TELEFAB_BIN")} + "/" + words[0];
    words.insert(words.end(), {"--machines", (folder() / "machines").string()});
    return run(words);
  }
  /// A torus as a plan drawn by cover, in the format of another printer.
  [[nodiscard]] fs::path written(const std::string& format) {
    const std::string tfc = (folder() / "t.tfc").string(), file = (folder() / ("t." + format)).string();
    const Outcome sliced =
        tool({"telefab-scan", "slice", torus().string(), "--machine", "toy", "--height-mm", "4", "--out", tfc});
    EXPECT_EQ(sliced.code, 0) << sliced.errors;
    const Outcome planned = tool({"telefab-fab", "plan", tfc, "--out", own_plan().string(), "--masks", "cover"});
    EXPECT_TRUE(planned.code == 0 || planned.code == 8) << planned.errors;
    std::vector<std::string> words{"telefab-fab", "export", own_plan().string(), "--format", format, "--out", file};
    if (const std::string held = held_of(own_plan()); !held.empty()) words.insert(words.end(), {"--although", held});
    const Outcome exported = tool(words);
    EXPECT_EQ(exported.code, 0) << exported.errors;
    return file;
  }
  /// Names of what holds a plan.
  [[nodiscard]] std::string held_of(const fs::path& plan) const {
    std::string names;
    for (const json& item : json::parse(text_of(plan / "preflight.json"))["items"])
      if (item["verdict"] == "held") names += (names.empty() ? "" : ",") + item["name"].get<std::string>();
    return names;
  }
  [[nodiscard]] fs::path own_plan() const { return folder() / "own"; }
  /// Sends a file as PrusaLink's senders do; the answer.
  [[nodiscard]] std::string sent(const fs::path& file, const std::string& name) const {
    const auto port = static_cast<std::uint16_t>(std::stoi(text_of(folder() / "fab" / "web-port")));
    const std::string token = text_of(folder() / "fab" / "web-token").substr(0, 32);
    return http_ask(port, "PUT", "/api/v1/files/local/" + name, "X-Api-Key: " + token + "\r\n", text_of(file));
  }
  [[nodiscard]] json jobs() const {
    return json::parse(telefab({"jobs", "--json", "--site", fab_site()}).output, nullptr, false);
  }
  /// The only job, once it is in that state.
  [[nodiscard]] json job_in(const std::string& state) const {
    for (int tries = 0; tries < 600; ++tries, std::this_thread::sleep_for(50ms))
      if (const json all = jobs(); all.is_array() && all.size() == 1 && all[0]["state"] == state) return all[0];
    ADD_FAILURE() << "never " << state << ": " << jobs().dump();
    return {};
  }
  [[nodiscard]] json layers_of(const fs::path& plan) const {
    return json::parse(text_of(plan / "plan.json"))["layers"];
  }
};

TEST_F(ForeignFiles, OfMasksArePrintedPixelForPixelOnceSomebodyHasApprovedThem) {
  start_fab({"--web", "127.0.0.1:0"});
  EXPECT_THAT(sent(written("goo"), "torus.goo"), HasSubstr("HTTP/1.1 201"));
  const std::string job = job_in("awaiting-approval")["id"];
  const fs::path plan = folder() / "fab" / "jobs" / job / "plan";
  EXPECT_EQ(layers_of(plan).size(), layers_of(own_plan()).size());
  for (std::size_t i = 0; i < layers_of(plan).size(); ++i)
    EXPECT_EQ(layers_of(plan)[i]["mask_sha256"], layers_of(own_plan())[i]["mask_sha256"]) << "layer " << i;
  EXPECT_THAT(text_of(plan / "preflight.json"), HasSubstr("masks, times and motion are those of a file (goo"));
  // After a restart too: the file lies beside the layers.
  kill_fab();
  start_fab({"--web", "127.0.0.1:0"});
  const std::string names = held_of(plan);
  std::vector<std::string> words{"approve", job, "--site", fab_site()};
  if (!names.empty()) words.insert(words.end(), {"--although", names});
  const Outcome approved = telefab(words);
  ASSERT_EQ(approved.code, 0) << approved.errors;
  EXPECT_EQ(job_in("done")["id"], job);
}

TEST_F(ForeignFiles, OfMasksThatFitSeveralProfilesGoToTheOneWhosePrinterTheyNameOrToTheFolderOfOne) {
  const fs::path machines = folder() / "machines";
  const std::string toy = text_of(machines / "toy.toml");
  const auto write = [&](const std::string& name, const std::string& model) {
    std::string profile = toy;
    profile.replace(profile.find("\"toy\""), 5, "\"" + name + "\"");
    std::ofstream{machines / (name + ".toml")} << profile << "[file]\nkind = \"goo\"\nmodel = \"" << model << "\"\n";
  };
  std::ofstream{machines / "toy.toml"} << toy << "[file]\nkind = \"goo\"\nmodel = \"Printer B\"\n";
  const fs::path goo = written("goo");  // for Printer B
  fs::remove(machines / "toy.toml");
  write("first", "Printer A");
  write("second", "Printer B");
  write("third", "Printer C");
  start_fab({"--web", "127.0.0.1:0"});
  EXPECT_THAT(sent(goo, "named.goo"), HasSubstr("HTTP/1.1 201"));
  EXPECT_THAT(sent(goo, "third/asked.goo"), HasSubstr("HTTP/1.1 201"));
  EXPECT_THAT(sent(goo, "parts/of-june/folder.goo"), HasSubstr("HTTP/1.1 201")) << "a folder of its sender's own";
  std::map<std::string, std::string> machine_of;
  for (const json& job : jobs()) machine_of[job["name"]] = job["machine"];
  EXPECT_EQ(machine_of["named.goo"], "second");
  EXPECT_EQ(machine_of["asked.goo"], "third");
  EXPECT_EQ(machine_of["folder.goo"], "second");
  kill_fab();
  write("second", "Printer D");
  start_fab({"--web", "127.0.0.1:0"});
  const std::string refused = sent(goo, "nobodys.goo");
  EXPECT_THAT(refused, HasSubstr("HTTP/1.1 400"));
  EXPECT_THAT(refused, HasSubstr("first and second and third"));
  EXPECT_THAT(sent(goo, "second/again.goo"), HasSubstr("HTTP/1.1 201"));
}

TEST_F(ForeignFiles, GoToTheMachineThatStandsThereWithTheResinThatItStates) {
  const fs::path goo = written("goo");
  std::ofstream{folder() / "fab.toml"} << "[[machine]]\nname = \"own\"\nprofile = \"toy\"\nresin = \"generic-blue\"\n";
  start_fab({"--web", "127.0.0.1:0", "--instances", (folder() / "fab.toml").string()});
  EXPECT_THAT(sent(goo, "torus.goo"), HasSubstr("HTTP/1.1 201"));
  const json job = job_in("awaiting-approval");
  EXPECT_EQ(job["machine"], "own") << "toy has no resin of its own, and nobody would print it";
}

TEST_F(ForeignFiles, OfMasksAreTracedByThePlannerAlsoWhereTheFabIsKilledBefore) {
  start_fab({"--web", "127.0.0.1:0"});
  const fs::path goo = written("goo");
  EXPECT_THAT(sent(goo, "torus.goo"), HasSubstr("HTTP/1.1 201"));
  kill_fab();
  const std::string job = [&] {
    for (const auto& each : fs::directory_iterator{folder() / "fab" / "jobs"}) return each.path().filename().string();
    return std::string{};
  }();
  // As it is killed before a layer is traced.
  fs::remove_all(folder() / "fab" / "jobs" / job / "chunks");
  fs::remove_all(folder() / "fab" / "jobs" / job / "offer");
  start_fab({"--web", "127.0.0.1:0"});
  const json planned = job_in("awaiting-approval");
  EXPECT_EQ(planned["id"], job);
  EXPECT_GT(planned["layers"], 0);
}

TEST_F(ForeignFiles, OfContoursArePlannedAsAnyOthers) {
  start_fab({"--web", "127.0.0.1:0"});
  EXPECT_THAT(sent(written("svg"), "torus.svg"), HasSubstr("HTTP/1.1 201"));
  const std::string job = job_in("awaiting-approval")["id"];
  const std::string preflight = text_of(folder() / "fab" / "jobs" / job / "plan" / "preflight.json");
  EXPECT_THAT(preflight, testing::Not(HasSubstr("\"file\"")));
}

TEST_F(ForeignFiles, ThatFitNoMachineAreRefusedWithTheReason) {
  start_fab({"--web", "127.0.0.1:0"});
  const fs::path goo = written("goo");
  std::string profile = text_of(folder() / "machines" / "toy.toml");
  const auto width = profile.find("width_mm = 20.0");
  ASSERT_NE(width, std::string::npos);
  std::ofstream{folder() / "machines" / "toy.toml"} << profile.replace(width, 15, "width_mm = 30.0");
  kill_fab();
  start_fab({"--web", "127.0.0.1:0"});
  EXPECT_THAT(sent(goo, "torus.goo"), HasSubstr("Slice it for this machine"));
  EXPECT_THAT(sent(folder() / "machines" / "toy.toml", "torus.goo"), HasSubstr("HTTP/1.1 4"));
  EXPECT_EQ(jobs().size(), 0U);
}

}  // namespace
}  // namespace telefab::test
