// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/two_sites.hpp>
#include <thread>

// What was printed once is printed again, from the layers that the fab has.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using testing::HasSubstr;

class Again : public TwoSites {
 protected:
  [[nodiscard]] std::uint16_t page_port() const {
    return static_cast<std::uint16_t>(std::stoi(text_of(folder() / "fab" / "web-port")));
  }
  [[nodiscard]] std::string post(const std::string& path) const {
    const std::string token = text_of(folder() / "fab" / "web-token").substr(0, 32);
    return http_ask(page_port(), "POST", path, "X-Api-Key: " + token + "\r\n", "");
  }
  /// The newest job of the fab, once it is in that state.
  [[nodiscard]] json newest_in(const std::string& state) const {
    for (int tries = 0; tries < 600; ++tries, std::this_thread::sleep_for(50ms)) {
      const json all = json::parse(telefab({"jobs", "--json", "--site", fab_site()}).output, nullptr, false);
      if (all.is_array() && !all.empty() && all[0]["state"] == state) return all[0];
    }
    ADD_FAILURE() << "never " << state;
    return {};
  }
  [[nodiscard]] json plan_of(const std::string& job) const {
    return json::parse(text_of(folder() / "fab" / "jobs" / job / "plan" / "plan.json"));
  }
};

TEST_F(Again, WaitsForApprovalWithTheSameMasksAndIsItsOperatorsOwn) {
  start_fab({"--web", "127.0.0.1:0"});
  start_scan();
  ASSERT_EQ(telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--watch"}).code, 0);
  const std::string first = newest_in("done")["id"];
  ASSERT_THAT(post("/v1/jobs/" + first + "/again"), HasSubstr("HTTP/1.1 201"));
  const json again = newest_in("awaiting-approval");
  const std::string second = again["id"];
  ASSERT_NE(second, first);
  EXPECT_EQ(plan_of(second)["layers"], plan_of(first)["layers"]);
  EXPECT_EQ(text_of(folder() / "fab" / "jobs" / second / "plan" / "part.tfc"),
            text_of(folder() / "fab" / "jobs" / first / "plan" / "part.tfc"))
      << "the layers as they came";
  EXPECT_EQ(again["owner"], "web");
  const std::string layer = http_ask(page_port(), "GET", "/v1/jobs/" + first + "/layers/5", "", "");
  for (const json& side : json::parse(layer.substr(layer.find("\r\n\r\n")))["bounds"])
    EXPECT_TRUE(side.is_number()) << "a part without supports has a place on the page too";
  // It needs nothing of the first any more.
  // Its accuracy is perhaps still computed.
  std::string forgotten = post("/v1/jobs/" + first + "/forget");
  for (int tries = 0; tries < 100 && forgotten.find(" 409 ") != std::string::npos; ++tries) {
    std::this_thread::sleep_for(100ms);
    forgotten = post("/v1/jobs/" + first + "/forget");
  }
  EXPECT_THAT(forgotten, HasSubstr("HTTP/1.1 200"));
  EXPECT_THAT(post("/v1/jobs/" + second + "/approve"), HasSubstr("HTTP/1.1 200"));
  EXPECT_EQ(newest_in("done")["id"], second);
}

TEST_F(Again, IsRefusedWhereNotAllLayersCameAndMakesNoJob) {
  start_fab({"--web", "127.0.0.1:0"});
  EXPECT_THAT(post("/v1/jobs/j0000/again"), HasSubstr("HTTP/1.1 404"));
  EXPECT_EQ(json::parse(telefab({"jobs", "--json", "--site", fab_site()}).output).size(), 0U);
  start_scan();
  ASSERT_EQ(telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "2", "--watch"}).code, 0);
  const std::string job = newest_in("done")["id"];
  const auto jobs = folder() / "fab" / "jobs";
  const auto chunks = jobs / job / "chunks";
  std::filesystem::resize_file(chunks, std::filesystem::file_size(chunks) - 1);  // its end is torn off
  const std::string refused = post("/v1/jobs/" + job + "/again");
  EXPECT_THAT(refused, HasSubstr("HTTP/1.1 409"));
  EXPECT_THAT(refused, HasSubstr("not all layers of job " + job + " are here"));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator{jobs}, {}), 1) << "no folder is left";
}

}  // namespace
}  // namespace telefab::test
