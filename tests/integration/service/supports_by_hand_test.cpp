// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/two_sites.hpp>

// A job that waits for approval gets other supports over the fab's API, and is planned again with them.

namespace telefab::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

class SupportsByHand : public TwoSites {
 protected:
  void SetUp() override {
    lift_parts();
    fab_starts();
    start_scan();
    job = submit_torus();
    ASSERT_TRUE(comes_to("awaiting-approval")) << view();
    kill_scan();
    ASSERT_GT(supports()["anchors"].size(), 1U) << supports();
  }
  /// On pins: the torus could stand without any.
  void lift_parts() const {
    std::ofstream{folder() / "machines" / "toy.toml", std::ios::app} << "[supports]\nstand_area_share = 1.0\n";
  }
  void fab_starts() { start_fab({"--web", "127.0.0.1:0", "--start", "on-approval"}); }
  [[nodiscard]] fs::path job_folder() const { return folder() / "fab" / "jobs" / job; }
  [[nodiscard]] std::string ask(const std::string& method, const std::string& path,
                                const std::string& body = {}) const {
    const auto port = static_cast<std::uint16_t>(std::stoi(text_of(folder() / "fab" / "web-port")));
    std::string token = text_of(folder() / "fab" / "web-token");
    token.pop_back();
    return http_ask(port, method, "/v1/jobs/" + job + path,
                    method == "GET" ? "" : "Authorization: Bearer " + token + "\r\n", body);
  }
  [[nodiscard]] json view() const { return json::parse(http_body(ask("GET", ""))); }
  [[nodiscard]] json supports() const { return json::parse(http_body(ask("GET", "/supports"))); }
  [[nodiscard]] bool comes_to(const std::string& state) const {
    for (int tries = 0; tries < 1200; ++tries, ::usleep(25'000)) {
      const std::string answer = ask("GET", "");
      if (answer.find(" 200 ") == std::string::npos) continue;  // the fab does not have it yet
      if (json::parse(http_body(answer))["state"] == state) return true;
    }
    return false;
  }
  /// Planned again with the list, as far as its approval.
  void plan_again(const json& list) const {
    const std::string answer = ask("POST", "/supports", list.dump());
    ASSERT_THAT(answer, HasSubstr(" 200 "));
    EXPECT_EQ(json::parse(http_body(answer))["state"], "planning");
    ASSERT_TRUE(comes_to("awaiting-approval")) << view();
  }
  [[nodiscard]] static bool has_pin(const json& supports, const json& like, bool by_hand) {
    for (const json& a : supports["anchors"])
      if (a["by_hand"] == by_hand && a["part_layer"] == like["part_layer"] &&
          std::abs(a["x_mm"].get<double>() - like["x_mm"].get<double>()) < 1e-5 &&
          std::abs(a["y_mm"].get<double>() - like["y_mm"].get<double>()) < 1e-5)
        return true;
    return false;
  }
  static json place(const json& pin) { return {{"x_mm", pin["x_mm"]}, {"y_mm", pin["y_mm"]}}; }

  std::string job;
};

TEST_F(SupportsByHand, AddAndRemovePinsAndKeepThemOverARestart) {
  const json before = supports();
  EXPECT_EQ(before["hand"], json::parse(R"({"extra":[],"forbidden":[],"removed":[]})"));
  const json old = before["anchors"][0];
  json gone = place(old), added = place(old);
  gone["part_layer"] = old["part_layer"];
  added["x_mm"] = old["x_mm"].get<double>() + 0.05;
  added["z_mm"] = old["z_mm"];
  const json list{{"extra", {added}}, {"forbidden", json::array()}, {"removed", {gone}}};
  plan_again(list);
  json moved = added;
  moved["part_layer"] = old["part_layer"];
  json after = supports();
  EXPECT_FALSE(has_pin(after, old, false)) << after;
  EXPECT_TRUE(has_pin(after, moved, true)) << after;
  EXPECT_EQ(after["hand"], list);
  EXPECT_THAT(text_of(folder() / "fab" / "audit.log"), HasSubstr("plans job " + job + " again"));
  EXPECT_FALSE(fs::exists(job_folder() / "supports-wanted.json"));

  kill_fab();
  fab_starts();
  ASSERT_TRUE(comes_to("awaiting-approval"));
  after = supports();
  EXPECT_EQ(after["hand"], list);
  EXPECT_TRUE(has_pin(after, moved, true));
  // Taking everything back gives the plan of before.
  plan_again(before["hand"]);
  EXPECT_EQ(supports(), before);
}

TEST_F(SupportsByHand, KeepAPlaceFreeOfPinsAndShowWhatPreflightFindsThen) {
  const json before = supports();
  const std::string found = http_body(ask("GET", "/preflight"));
  const json pin = before["anchors"][0];
  json disc = place(pin);
  disc["radius_mm"] = 1.5;
  disc["from_z_mm"] = 0;
  disc["to_z_mm"] = 1000;
  plan_again({{"forbidden", {disc}}});
  for (const json& a : supports()["anchors"])
    EXPECT_GT(std::hypot(a["x_mm"].get<double>() - pin["x_mm"].get<double>(),
                         a["y_mm"].get<double>() - pin["y_mm"].get<double>()),
              1.45);
  EXPECT_NE(http_body(ask("GET", "/preflight")), found) << "it judges the new masks";
}

TEST_F(SupportsByHand, AnUnfinishedPlanGoesOnWithTheListAtTheNextStart) {
  const json old = supports()["anchors"][0];
  const std::string plan = text_of(job_folder() / "plan" / "plan.json");
  json gone = place(old);
  gone["part_layer"] = old["part_layer"];
  const json list{{"extra", json::array()}, {"forbidden", json::array()}, {"removed", {gone}}};
  ASSERT_THAT(ask("POST", "/supports", list.dump()), HasSubstr(" 200 "));
  kill_fab();
  EXPECT_FALSE(text_of(job_folder() / "plan" / "plan.json").empty()) << "the plan of before, or the whole new one";
  fab_starts();
  ASSERT_TRUE(comes_to("awaiting-approval"));
  EXPECT_FALSE(has_pin(supports(), old, false));
  EXPECT_EQ(supports()["hand"], list);
}

TEST_F(SupportsByHand, LeaveThePlanOfBeforeWhereNoOtherCanBeMade) {
  const json before = supports();
  const std::string plan = text_of(job_folder() / "plan" / "plan.json");
  kill_fab();
  const fs::path profile = folder() / "machines" / "toy.toml";
  std::string text = text_of(profile);
  const std::string thickness = "thickness_mm = 0.2";
  ASSERT_NE(text.find(thickness), std::string::npos) << text;
  text.replace(text.find(thickness), thickness.size(), "thickness_mm = 0.25");
  std::ofstream{profile} << text;  // a machine that the contours were not cut for
  fab_starts();
  ASSERT_TRUE(comes_to("awaiting-approval"));
  ASSERT_THAT(ask("POST", "/supports", "{}"), HasSubstr(" 200 "));
  ASSERT_TRUE(comes_to("awaiting-approval")) << view();
  EXPECT_THAT(view()["message"].get<std::string>(), HasSubstr("that of before"));
  EXPECT_EQ(text_of(job_folder() / "plan" / "plan.json"), plan);
  EXPECT_EQ(supports(), before);
  EXPECT_FALSE(fs::exists(job_folder() / "supports-wanted.json"));
}

TEST_F(SupportsByHand, RefusesAListThatIsNoneByItsOneErrorAndPlansNothing) {
  const std::string plan = text_of(job_folder() / "plan" / "supports.json");
  const std::pair<const char*, const char*> bad[] = {
      {"", "not a JSON object"},
      {"[]", "not a JSON object"},
      {R"({"pins":[]})", "unknown key"},
      {R"({"removed":[{"x_mm":1,"y_mm":2,"part_layer":-1}]})", "part_layer"},
      {R"({"extra":[{"x_mm":1,"y_mm":2}]})", "x_mm, y_mm, z_mm"},
      {R"({"forbidden":[{"x_mm":1,"y_mm":2,"radius_mm":-3,"from_z_mm":0,"to_z_mm":9}]})", "radius"}};
  for (const auto& [body, why] : bad) {
    const std::string answer = ask("POST", "/supports", body);
    EXPECT_THAT(answer, HasSubstr(" 400 ")) << body;
    EXPECT_THAT(answer, HasSubstr(why)) << body;
  }
  EXPECT_EQ(view()["state"], "awaiting-approval");
  EXPECT_EQ(text_of(job_folder() / "plan" / "supports.json"), plan);
  EXPECT_FALSE(fs::exists(job_folder() / "supports-wanted.json"));
}

TEST_F(SupportsByHand, TakesAnOperatorAndAJobThatWaitsForApproval) {
  const auto port = static_cast<std::uint16_t>(std::stoi(text_of(folder() / "fab" / "web-port")));
  EXPECT_THAT(http_ask(port, "POST", "/v1/jobs/" + job + "/supports", "", "{}"), HasSubstr(" 401 "));
  ASSERT_THAT(ask("POST", "/supports", "{}"), HasSubstr(" 200 "));
  const std::string busy = ask("POST", "/supports", "{}");
  if (busy.find(" 409 ") != std::string::npos) {  // unless it was planned in the meantime
    EXPECT_THAT(busy, HasSubstr("once it is planned"));
  }
  ASSERT_TRUE(comes_to("awaiting-approval"));
  ASSERT_THAT(ask("POST", "/cancel"), HasSubstr(" 200 "));
  const std::string ended = ask("POST", "/supports", "{}");
  EXPECT_THAT(ended, HasSubstr(" 409 "));
  EXPECT_THAT(ended, HasSubstr("it has ended"));
}

TEST_F(SupportsByHand, AreNoLongerChangedOnceTheJobIsApproved) {
  kill_fab();
  set_machine(1);  // a print that lasts
  lift_parts();
  fab_starts();
  ASSERT_TRUE(comes_to("awaiting-approval"));
  json held = json::array();
  for (const json& item : json::parse(http_body(ask("GET", "/preflight")))["items"])
    if (item["verdict"] == "held") held.push_back(item["name"]);
  const std::string supports_before = text_of(job_folder() / "plan" / "supports.json");
  const std::string approved = ask("POST", "/approve", held.empty() ? "" : json{{"although", held}}.dump());
  ASSERT_THAT(approved, HasSubstr(" 200 "));
  const std::string refused = ask("POST", "/supports", "{}");
  EXPECT_THAT(refused, HasSubstr(" 409 "));
  EXPECT_THAT(refused, testing::AnyOf(HasSubstr("it is approved"), HasSubstr("on its machine")));
  EXPECT_EQ(text_of(job_folder() / "plan" / "supports.json"), supports_before);
  EXPECT_FALSE(fs::exists(job_folder() / "supports-wanted.json"));
}

}  // namespace
}  // namespace telefab::test
