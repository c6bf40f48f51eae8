// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <telefab/fab/web/router.hpp>
#include <telefab/scan/web/scan_web.hpp>
#include <telefab/test/recording_backend.hpp>
#include <telefab/web/api_page.hpp>

namespace telefab {
namespace {

using nlohmann::json;

json api_of(const std::string& site) {
  std::ifstream file{std::string{std::getenv("TELEFAB_SOURCE")} + "/" + site + "/web/page/openapi.json"};
  return json::parse(file);
}

/// Who may call an operation: what it says itself, else what the file says for all.
std::string who_may(const json& api, const json& operation) {
  const json& ways = operation.contains("security") ? operation["security"] : api["security"];
  if (ways.empty()) return "nothing";
  return std::any_of(ways.begin(), ways.end(), [](const json& way) { return way.empty(); }) ? "read-only" : "operator";
}

/// "GET /v1/jobs: summary, read-only" for each operation of a file.
std::set<std::string> documented(const json& api) {
  std::set<std::string> list;
  for (const auto& [path, methods] : api["paths"].items())
    for (const auto& [method, operation] : methods.items()) {
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      list.insert(upper + " " + path + ": " + operation["summary"].get<std::string>() + ", " + who_may(api, operation));
    }
  return list;
}

std::set<std::string> coded(const std::vector<WebRoute>& routes) {
  std::set<std::string> list;
  for (const WebRoute& route : routes)
    list.insert(std::string{route.method} + " " + std::string{route.path} + ": " + std::string{route.summary} + ", " +
                std::string{name_of(route.needs)});
  return list;
}

TEST(OpenApi, ListsExactlyTheRoutesOfTheFab) { EXPECT_EQ(documented(api_of("fab_site")), coded(fab::web_routes())); }

TEST(OpenApi, ListsExactlyTheRoutesOfTheScanSite) {
  EXPECT_EQ(documented(api_of("scan_site")), coded(scan::web_routes()));
}

std::string text_of_page(const std::string& name) {
  std::ostringstream text;
  text << std::ifstream{std::string{std::getenv("TELEFAB_SOURCE")} + "/deploy/docs/" + name}.rdbuf();
  return text.str();
}

TEST(ApiPage, OfTheDocumentsIsWhatTheVerbMakes) {
  for (const auto& [page, program, api] : {std::tuple{"api-fab.md", "telefab-fab", fab::open_api_json()},
                                           {"api-scan.md", "telefab-scan", scan::open_api_json()}})
    EXPECT_EQ(text_of_page(page), api_page(api).value()) << program << " api > deploy/docs/" << page;
}

TEST(ApiPage, HasEveryOperationWithItsParametersAnswersAndBodies) {
  const std::string page = api_page(scan::open_api_json()).value();
  for (const WebRoute& route : scan::web_routes())
    EXPECT_THAT(page,
                testing::HasSubstr(std::string{"### "} + std::string{route.method} + " " + std::string{route.path}));
  EXPECT_THAT(page, testing::HasSubstr("- `from` in the query: integer\n"));
  EXPECT_THAT(page, testing::HasSubstr("| 409 | it goes on at another byte |"));
  EXPECT_THAT(page, testing::HasSubstr("| `reading` | [StagedTask](#stagedtask) |"));
  EXPECT_THAT(page, testing::HasSubstr("| `height_mm` |")) << "what may be asked of slicing";
  EXPECT_EQ(api_page("{}").error().code, ErrorCode::InvalidInput);
}

TEST(OpenApi, EveryOperationSaysWhatItAnswers) {
  for (const char* site : {"fab_site", "scan_site"}) {
    const json api = api_of(site);  // items() keeps nothing alive
    for (const auto& [path, methods] : api["paths"].items())
      for (const auto& [method, operation] : methods.items())
        EXPECT_FALSE(operation["responses"].empty()) << site << ' ' << path << ' ' << method;
  }
}

TEST(OpenApi, NamesEveryMemberOfAJobAndOfAMachineOfTheFab) {
  fab::RecordingBackend backend;
  const VirtualClock clock;
  SignIn sign_in{{}, clock};
  const auto answered = [&](const char* path) {
    return json::parse(fab::answer({"GET", path, {}, {}, {}}, backend, sign_in, {}).body);
  };
  const json paths = api_of("fab_site")["paths"];
  const auto names = [&](const char* path, const json& members) {
    const std::string text = paths[path]["get"]["responses"]["200"]["description"];
    for (const auto& [name, value] : members.items()) EXPECT_THAT(text, testing::HasSubstr(name)) << path;
  };
  names("/v1/jobs/{id}", answered("/v1/jobs/job-1"));
  names("/v1/machines", answered("/v1/machines")["machines"][0]);
}

}  // namespace
}  // namespace telefab
