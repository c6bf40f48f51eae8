// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/base/digest.hpp>
#include <telefab/test/two_sites.hpp>

namespace telefab::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::StartsWith;

class Fax : public TwoSites {};

TEST_F(Fax, PrintsASubmittedScanAndBringsTheReportsBack) {
  start_both();
  const Outcome done =
      telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--watch", "--json"});
  ASSERT_EQ(done.code, 0) << done.errors;
  const json job = json::parse(done.output);
  EXPECT_EQ(job["state"], "done");
  EXPECT_EQ(job["layers"], 20);
  EXPECT_EQ(job["layers_sent"], 20);
  EXPECT_GE(job["layers_printed"], 20);
  EXPECT_EQ(job["layers_printed"], job["print_layers"]);
  EXPECT_GT(job["wire_bytes"], 0);
  EXPECT_LT(job["wire_bytes"], job["scan_bytes"]);
  for (const char* stage : {"slice", "send", "plan", "print"}) EXPECT_TRUE(job["seconds"].contains(stage)) << stage;

  const std::string id = job["id"];
  for (const std::vector<std::string>& words :
       std::vector<std::vector<std::string>>{{"--search", "TORUS done"}, {"--state", "failed,done"}, {"--all"}})
    for (const std::string& site : {scan_site(), fab_site()}) {
      std::vector<std::string> asked{"jobs", "--names", "--site", site};
      asked.insert(asked.end(), words.begin(), words.end());
      EXPECT_EQ(telefab(asked).output, id + "\n") << words[0];
    }
  EXPECT_EQ(telefab({"jobs", "--names", "--state", "failed"}).output, "");
  EXPECT_EQ(telefab({"jobs", "--names", "--search", "torus nobody"}).output, "");

  const auto out = folder() / "out";
  const Outcome report = telefab({"report", job["id"], "--out", out.string()});
  ASSERT_EQ(report.code, 0) << report.errors;
  for (const char* name : {"job.json", "slice.json", "plan.json", "supports.json", "report.json", "print.json"})
    EXPECT_TRUE(json::accept(text_of(out / name))) << name;
  EXPECT_THAT(text_of(out / "preview.png"), testing::StartsWith("\x89PNG"));
}

TEST_F(Fax, ChoosesHowAScanStandsWhereItIsAskedTo) {
  start_both();
  const Outcome done = telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--up",
                                "auto:quality", "--mirror", "x", "--watch", "--json"});
  ASSERT_EQ(done.code, 0) << done.errors;
  const auto out = folder() / "out";
  ASSERT_EQ(telefab({"report", json::parse(done.output)["id"], "--out", out.string()}).code, 0);
  const json report = json::parse(text_of(out / "slice.json"));
  EXPECT_EQ(report["chosen_standing"]["for"], "quality");
  EXPECT_EQ(report["placing"]["mirror"], "x");
  EXPECT_TRUE(report["placing"]["rotate"].is_string());
  EXPECT_NEAR(report["size_mm"][2].get<double>(), 4, 1e-6);
}

TEST_F(Fax, ReportsWhatTheResinOfAPrintCosts) {
  std::filesystem::create_directories(folder() / "resins");
  std::ofstream{folder() / "resins" / "dear.toml"} << "name = \"dear\"\nprice_per_litre = 50\ncurrency = \"EUR\"\n"
                                                      "[resin]\ncritical_dose_mj_per_cm2 = 4.0\npenetration_mm = 0.3\n";
  start_both();
  const Outcome done = telefab(
      {"submit", torus().string(), "--machine", "toy", "--resin", "dear", "--height-mm", "4", "--watch", "--json"});
  ASSERT_EQ(done.code, 0) << done.errors;
  const auto out = folder() / "out";
  ASSERT_EQ(telefab({"report", json::parse(done.output)["id"], "--out", out.string()}).code, 0);
  const json cost = json::parse(text_of(out / "report.json"))["cost"];
  ASSERT_TRUE(cost.is_object()) << cost;
  EXPECT_EQ(cost["currency"], "EUR");
  EXPECT_EQ(cost["per_litre"], 50);
  EXPECT_GT(cost["resin_ml"], 0);
  EXPECT_DOUBLE_EQ(cost["amount"].get<double>(), cost["resin_ml"].get<double>() * 50 / 1000);
}

TEST_F(Fax, PlansTheContoursAsTheyWereCodedAndKeepsThemSo) {
  start_both();
  const std::string job = submit_torus();
  ASSERT_EQ(telefab({"watch", job}).code, 0);
  // Coded once more they would be rounded once more.
  const auto sliced = folder() / "sliced.tfc";
  const Outcome slice =
      run({std::string{::getenv("TELEFAB_BIN")} + "/telefab-scan", "slice", torus().string(), "--machine", "toy",
           "--machines", (folder() / "machines").string(), "--height-mm", "4", "--out", sliced.string()});
  ASSERT_EQ(slice.code, 0) << slice.errors;
  const std::string kept = text_of(folder() / "fab" / "jobs" / job / "plan" / "part.tfc");
  EXPECT_THAT(kept, StartsWith("TFC1"));
  EXPECT_TRUE(kept == text_of(sliced)) << kept.size() << " bytes kept, " << text_of(sliced).size() << " coded";
}

TEST_F(Fax, BringsThePictureOfThePredictedPartOnceItWasComputed) {
  start_both();
  const std::string job = submit_torus();
  EXPECT_EQ(telefab({"watch", job}).code, 0);
  const auto out = folder() / "out";
  // In the background; each look takes a while.
  for (int looks = 0; looks < 400 && !std::filesystem::exists(out / "accuracy.png"); ++looks)
    ASSERT_EQ(telefab({"report", job, "--out", out.string(), "--force", "--site", fab_site()}).code, 0);
  EXPECT_THAT(text_of(out / "accuracy.png"), StartsWith("\x89PNG"));
  const json accuracy = json::parse(text_of(out / "accuracy.json"));
  EXPECT_LT(std::abs(accuracy["cured_mm3"].get<double>() / accuracy["contour_mm3"].get<double>() - 1), 0.05);
}

TEST_F(Fax, PausesResumesAndCancelsThePrintAtTheFab) {
  set_machine(40);
  start_both();
  const std::string job = submit_torus();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("printing: 2"), HasSubstr("printing"));
  EXPECT_EQ(telefab({"pause", job}).code, 0);
  EXPECT_THAT(watch->wait_for_error_line("paused"), HasSubstr("paused"));
  EXPECT_EQ(telefab({"pause", job}).code, 2);
  EXPECT_EQ(telefab({"resume", job}).code, 0);
  EXPECT_THAT(watch->wait_for_error_line("printing"), HasSubstr("printing"));
  EXPECT_EQ(telefab({"cancel", job}).code, 0);
  EXPECT_EQ(watch->finish(), 6);
  EXPECT_EQ(telefab({"cancel", job}).code, 2);
  // The fab heard it too.
  const auto at_fab = telefab({"watch", job, "--site", fab_site(), "--json"});
  EXPECT_THAT(at_fab.output, HasSubstr("\"cancelled\"")) << at_fab.errors;
}

TEST_F(Fax, HearsOfAPrintThatWasResumedAndEndedWhileTheScanSiteWasDown) {
  set_machine(40);
  start_both();
  const std::string job = submit_torus();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("printing: 2"), HasSubstr("printing"));
  ASSERT_EQ(telefab({"pause", job}).code, 0);
  EXPECT_THAT(watch->wait_for_error_line("paused"), HasSubstr("paused"));
  kill_scan();
  ASSERT_EQ(telefab({"resume", job, "--site", fab_site()}).code, 0);
  EXPECT_EQ(telefab({"watch", job, "--site", fab_site()}).code, 0);
  start_scan();
  EXPECT_EQ(telefab({"watch", job}).code, 0);
}

TEST_F(Fax, WaitsForAFabThatIsDownAtSubmit) {
  start_both();
  kill_fab();
  const std::string job = submit_torus();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("waits for the fab"), HasSubstr("waits for the fab"));
  start_fab();
  EXPECT_EQ(watch->finish(), 0) << watch->errors();
}

TEST_F(Fax, GoesOnAfterTheFabWasKilledAndPrintsNoLayerTwice) {
  set_machine(60);
  start_both();
  const std::string job = submit_torus();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("printing: 4"), HasSubstr("printing"));
  kill_fab();
  start_fab({"--after-crash", "treat-as-exposed"});
  EXPECT_THAT(watch->wait_for_error_line("printing: 10"), HasSubstr("printing"));
  kill_fab();
  set_machine(5000);
  start_fab({"--after-crash", "treat-as-exposed"});
  ASSERT_EQ(watch->finish(), 0) << watch->errors();
  const auto out = folder() / "out";
  ASSERT_EQ(telefab({"report", job, "--out", out.string()}).code, 0);
  const json record = json::parse(text_of(out / "print.json"));
  std::vector<int> indices;
  for (const json& layer : record["layers"]) indices.push_back(layer["layer"].get<int>());
  ASSERT_GE(indices.size(), 20U);
  for (std::size_t i = 0; i < indices.size(); ++i) EXPECT_EQ(indices[i], static_cast<int>(i));
}

TEST_F(Fax, AsksTheOperatorAboutALayerPerhapsExposedAndKeepsTheAnswerInJournalLogAndRecord) {
  set_machine(10);  // layers of 0.4 s
  start_fab({"--after-crash", "ask"});
  start_scan();
  const std::string job = submit_torus();
  const auto journal = folder() / "fab" / "jobs" / job / "journal";
  const auto last_line = [&] {
    const std::string text = std::filesystem::exists(journal) ? text_of(journal) : "";
    const auto end = text.find_last_not_of('\n');
    return end == std::string::npos ? std::string{} : text.substr(text.rfind('\n', end) + 1);
  };
  std::vector<json> doubtful;
  for (const char* answer : {"expose-again", "treat-as-exposed"}) {
    SCOPED_TRACE(answer);
    bool is_lit = false;
    while (!is_lit) {
      fab().send_signal(SIGSTOP);
      const std::string line = last_line();
      is_lit = line.find(R"("exposing")") != std::string::npos &&
               (doubtful.empty() || json::parse(line.substr(line.find('{')))["layer"] > doubtful.front()["layer"]);
      if (!is_lit) fab().send_signal(SIGCONT);
    }
    kill_fab();  // SIGKILL
    doubtful.push_back(json::parse(last_line().substr(last_line().find('{'))));
    start_fab({"--after-crash", "ask"});
    const auto watch = telefab_begun({"watch", job});
    EXPECT_THAT(watch->wait_for_error_line("perhaps exposed"), HasSubstr("paused"));
    const Outcome resumed = telefab({"resume", job, "--as", answer, "--who", "ana"});
    ASSERT_EQ(resumed.code, 0) << resumed.errors;
    EXPECT_THAT(watch->wait_for_error_line("printing"), HasSubstr("printing"));
    const Outcome twice = telefab({"resume", job, "--as", answer});
    EXPECT_NE(twice.code, 0);
    EXPECT_THAT(twice.errors, HasSubstr("no layer of it was perhaps exposed"));
  }
  fab().send_signal(SIGTERM);
  EXPECT_EQ(fab().finish(), 0);
  EXPECT_THAT(last_line(), HasSubstr(R"("stopped")"));
  set_machine(5000);
  start_fab({"--after-crash", "ask"});
  ASSERT_EQ(telefab({"watch", job}).code, 0) << "an orderly stop leaves no exposure unknown";
  const std::string written = text_of(journal);
  EXPECT_THAT(written, HasSubstr(R"("step":"decided-again")"));
  EXPECT_THAT(written, HasSubstr(R"("step":"decided-exposed")"));
  const json record = json::parse(text_of(folder() / "fab" / "jobs" / job / "report" / "as-built.json"))["record"];
  const auto decided = [&](std::size_t k) {
    return record["layers"][doubtful[k]["layer"].get<std::size_t>()].value("decided", "");
  };
  EXPECT_THAT(decided(0), StartsWith("again: ana"));
  EXPECT_THAT(decided(1), StartsWith("exposed: ana"));
  const std::string scan = text_of(torus());
  EXPECT_EQ(record["provenance"]["scan_sha256"], to_hex(digest_of(std::as_bytes(std::span{scan}))));
  const std::string log = run({std::string{::getenv("TELEFAB_BIN")} + "/telefab-fab", "logs", job, "--data",
                               (folder() / "fab").string(), "--json"})
                              .output;
  EXPECT_THAT(log, HasSubstr("resume as expose-again"));
  EXPECT_THAT(log, HasSubstr("resume as treat-as-exposed"));
}

TEST_F(Fax, GoesOnAfterTheScanSiteWasKilled) {
  start_both();
  kill_fab();
  const std::string job = submit_torus();
  kill_scan();
  start_scan();
  start_fab();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_EQ(watch->finish(), 0) << watch->errors();
}

TEST_F(Fax, EndsCleanlyOnSigtermAndGoesOnWithTheNextStart) {
  set_machine(60);
  start_both();
  const std::string job = submit_torus();
  {
    const auto watch = telefab_begun({"watch", job});
    EXPECT_THAT(watch->wait_for_error_line("printing: 4"), HasSubstr("printing"));
  }
  fab().send_signal(SIGTERM);
  EXPECT_EQ(fab().finish(), 0);
  scan().send_signal(SIGTERM);
  EXPECT_EQ(scan().finish(), 0);
  set_machine(5000);
  start_both();
  EXPECT_EQ(telefab({"watch", job}).code, 0);
}

TEST_F(Fax, StartsAPrintOnlyAfterApprovalWhereTheFabSaysSo) {
  start_fab({"--start", "on-approval"});
  start_scan();
  const std::string job = submit_torus();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("approve"), HasSubstr("awaiting-approval"));
  // Not the scan site's to say.
  EXPECT_NE(telefab({"approve", job}).code, 0);
  const Outcome approved = telefab({"approve", job, "--site", fab_site()});
  EXPECT_EQ(approved.code, 0) << approved.errors;
  EXPECT_EQ(watch->finish(), 0) << watch->errors();
}

TEST_F(Fax, PrintsNoPlanOfAnotherProfile) {
  start_fab({"--start", "on-approval"});
  start_scan();
  const std::string job = submit_torus();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("approve"), HasSubstr("awaiting-approval"));
  kill_fab();
  const auto toml = folder() / "machines" / "toy.toml";
  const std::string sound = text_of(toml);
  std::string brighter = sound;
  brighter.replace(brighter.find("irradiance_mw_per_cm2 = 3.0"), 27, "irradiance_mw_per_cm2 = 9.0");
  std::ofstream{toml} << brighter;
  start_fab({"--start", "on-approval"});
  EXPECT_EQ(telefab({"approve", job, "--site", fab_site()}).code, 0);
  EXPECT_THAT(watch->wait_for_error_line("profile"), HasSubstr("was changed since the job was planned"));
  EXPECT_EQ(text_of(folder() / "fab" / "jobs" / job / "journal").find("exposing"), std::string::npos);
  kill_fab();
  std::ofstream{toml} << sound;
  start_fab({"--start", "on-approval"});
  EXPECT_EQ(telefab({"resume", job, "--site", fab_site()}).code, 0);
  EXPECT_EQ(watch->finish(), 0) << watch->errors();
}

TEST_F(Fax, PlansEveryJobWithTheMasksTheFabWasToldToMake) {
  start_fab({"--masks", "cover"});
  start_scan();
  const std::string job = submit_torus();
  EXPECT_EQ(telefab({"watch", job}).code, 0);
  EXPECT_THAT(text_of(folder() / "fab" / "jobs" / job / "plan" / "report.json"), HasSubstr("\"method\": \"cover\""));
  EXPECT_THAT(text_of(folder() / "fab" / "jobs" / job / "plan" / "preflight.json"), HasSubstr("by cover"));
  // What cannot go together is said at the start, not at the first job.
  const Outcome refused =
      run({std::string{::getenv("TELEFAB_BIN")} + "/telefab-fab", "serve", "--data", (folder() / "other").string(),
           "--machines", (folder() / "machines").string(), "--masks", "cover", "--pattern", "checker"});
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.errors, HasSubstr("needs masks by blend-stack"));
}

TEST_F(Fax, HoldsAJobWithAnIslandUntilAnOperatorOfTheFabLetsItThroughByName) {
  // Tips far below a pixel: they cure nowhere, so the part floats and the check of the masks must say so.
  std::ofstream{folder() / "machines" / "toy.toml", std::ios::app}
      << "[supports]\nstand_area_share = 1.0\ntip_radius_mm = 0.01\npin_radius_mm = 0.015\nfoot_radius_mm = 0.02\n";
  start_both();
  const std::string job = submit_torus();
  const auto watch = telefab_begun({"watch", job});
  EXPECT_THAT(watch->wait_for_error_line("island"),
              testing::AllOf(HasSubstr("awaiting-approval"), HasSubstr("approve")));
  const Outcome plain = telefab({"approve", job, "--site", fab_site(), "--who", "Ada"});
  EXPECT_NE(plain.code, 0);
  const std::size_t names = plain.errors.find("--although ");
  ASSERT_NE(names, std::string::npos) << plain.errors;
  std::string although = plain.errors.substr(names + 11);
  although = although.substr(0, although.find_first_of(" \n"));
  const auto plan = (folder() / "fab" / "jobs" / job / "plan").string();
  const auto export_plan = [&](const std::vector<std::string>& more) {
    std::vector<std::string> words{std::string{::getenv("TELEFAB_BIN")} + "/telefab-fab",
                                   "export",
                                   plan,
                                   "--format",
                                   "nanodlp",
                                   "--machines",
                                   (folder() / "machines").string(),
                                   "--out",
                                   (folder() / "other.nanodlp").string()};
    words.insert(words.end(), more.begin(), more.end());
    return run(words);
  };
  EXPECT_EQ(export_plan({}).code, 8);
  EXPECT_FALSE(std::filesystem::exists(folder() / "other.nanodlp"));
  EXPECT_EQ(export_plan({"--although", although}).code, 0) << export_plan({"--although", although}).errors;
  const Outcome approved = telefab({"approve", job, "--site", fab_site(), "--who", "Ada", "--although", although});
  EXPECT_EQ(approved.code, 0) << approved.errors;
  EXPECT_EQ(watch->finish(), 0) << watch->errors();
  const json record = json::parse(text_of(folder() / "fab" / "jobs" / job / "report" / "as-built.json"))["record"];
  EXPECT_EQ(record["orders"][0]["by"], "Ada");
  EXPECT_THAT(record["orders"][0]["why"].get<std::string>(), StartsWith("although islands"));
  // Who let it through stays on record.
  std::string audit;
  for (const auto& entry : std::filesystem::recursive_directory_iterator{folder()})
    if (entry.path().filename() == "audit.log") audit += text_of(entry.path());
  EXPECT_THAT(audit, testing::AllOf(HasSubstr("Ada"), HasSubstr("approve " + job)));
}

TEST_F(Fax, FailsABadScanWithItsReasonAndExitCode5) {
  start_both();
  const auto bad = folder() / "bad.ply";
  std::ofstream{bad} << "ply\nformat ascii 1.0\nelement vertex 9223372036854775808\nproperty float x\nend_header\n";
  const Outcome outcome = telefab({"submit", bad.string(), "--machine", "toy", "--watch"});
  EXPECT_EQ(outcome.code, 5);
  EXPECT_THAT(outcome.output, HasSubstr("bad.ply")) << outcome.errors;
}

struct BadSubmit {
  std::vector<std::string> arguments;
  int code;
  const char* says;
};

TEST_F(Fax, RefusesWhatCannotBecomeAJobAtTheClient) {
  start_both();
  const auto empty = folder() / "empty.ply";
  std::ofstream{empty}.close();
  const std::string scan = torus().string();
  const BadSubmit bad[]{
      {{"submit", (folder() / "none.ply").string(), "--machine", "toy"}, 7, "does not exist"},
      {{"submit", folder().string(), "--machine", "toy"}, 2, "not a regular file"},
      {{"submit", empty.string(), "--machine", "toy"}, 2, "is empty"},
      {{"submit", scan, "--machine", "gigantic"}, 2, "toy"},
      {{"submit", scan, "--machine", "toy", "--method", "magic"}, 1, "reeb"},
      {{"submit", scan, "--machine", "toy", "--layer-mm", "50"}, 1, "--layer-mm: 50 is not above 0 and up to 1"},
      {{"submit", scan, "--machine", "toy", "--height-mm", "-5"}, 1, "--height-mm: -5 is not above 0"},
      {{"submit", scan, "--machine", "toy", "--height-mm", "7,5"}, 1, "7.5"},
      {{"submit", scan, "--machine", "toy", "--height", "7"}, 1, "did you mean --height-mm?"},
      {{"sumbit", scan, "--machine", "toy"}, 1, "did you mean 'submit'?"},
      {{"status", "j0-0"}, 2, "no job"},
      {{"status", "../../etc"}, 2, "no job"},
      {{"report", "j0-0", "--out", (folder() / "o").string()}, 2, "no job"},
  };
  for (const BadSubmit& each : bad) {
    const Outcome outcome = telefab(each.arguments);
    EXPECT_EQ(outcome.code, each.code) << each.arguments[1] << ": " << outcome.errors;
    EXPECT_THAT(outcome.errors, HasSubstr(each.says));
  }
  kill_scan();
  EXPECT_EQ(telefab({"jobs"}).code, 3);
}

/// Processes whose parent is `parent`, by /proc.
std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> found;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{"/proc", error}) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::ifstream in{entry.path() / "stat"};
    std::string line;
    std::getline(in, line);
    const auto end = line.rfind(')');
    if (end == std::string::npos || line.size() < end + 4) continue;
    if (std::atoi(line.c_str() + end + 4) == parent) found.push_back(std::atoi(name.c_str()));
  }
  return found;
}

TEST_F(Fax, AKilledFabLeavesNoChildRunning) {
  set_machine(1);
  start_both();
  (void)submit_torus();
  std::vector<pid_t> children;
  for (int tries = 0; tries < 2000 && children.empty(); ++tries) {
    children = children_of(fab().id());
    // Before its exec it is a copy of the fab that has not said yet with whom it ends.
    std::erase_if(children, [&](pid_t child) {
      return text_of("/proc/" + std::to_string(child) + "/cmdline").find("predict") == std::string::npos;
    });
    ::usleep(5000);
  }
  ASSERT_EQ(children.size(), 1U) << "the prediction of what the masks cure";
  ASSERT_EQ(::kill(children[0], SIGSTOP), 0) << "so that it cannot end by itself";
  kill_fab();
  bool is_gone = false;
  for (int tries = 0; tries < 2000 && !is_gone; ++tries) {
    std::ifstream in{"/proc/" + std::to_string(children[0]) + "/stat"};
    std::string line;
    is_gone = !std::getline(in, line) || line.find(") Z ") != std::string::npos;  // dead, its new parent to be told
    ::usleep(5000);
  }
  EXPECT_TRUE(is_gone);
  if (!is_gone) ::kill(children[0], SIGKILL);
}

}  // namespace
}  // namespace telefab::test
