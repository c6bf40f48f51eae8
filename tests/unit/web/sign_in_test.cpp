// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <telefab/fab/web/router.hpp>
#include <telefab/scan/web/scan_web.hpp>
#include <telefab/test/recording_backend.hpp>
#include <telefab/test/recording_scan_backend.hpp>
#include <telefab/test/recording_staging.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/web/page_link.hpp>

namespace telefab {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

class SignInTest : public testing::Test {
 protected:
  /// Makes somebody a token.
  std::string add(const std::string& name, Access may = Access::Operators) const {
    return add_operator_token(file, name, may, std::chrono::seconds{1}).value();
  }
  [[nodiscard]] SignIn page(bool is_shown_beyond = false) {
    return SignIn{
        {file, "the-shared-token", is_shown_beyond, key_file},
        clock,
        {[this](std::string_view who, std::string_view what) {
           noted.push_back(std::string{who} + ": " + std::string{what});
         },
         [this](const std::string& address, const Error& why) { refused.push_back(address + " " + why.what); }}};
  }
  static WebRequest with_token(const std::string& token, const std::string& method = "GET") {
    WebRequest request;
    request.method = method;
    if (!token.empty()) request.authorization = "Bearer " + token;
    request.address = "192.0.2.7:5000";
    return request;
  }
  /// As a browser sends it from a page at localhost:7480.
  static WebRequest from_page(const std::string& method, const std::string& cookie, const std::string& body = {}) {
    WebRequest request;
    request.method = method;
    request.host = "localhost:7480";
    if (method != "GET") request.origin = "http://localhost:7480";
    request.cookie = cookie;
    request.body = body;
    return request;
  }
  /// The cookie of a session, without its attributes.
  static std::string cookie_of(const WebResponse& response) {
    return response.cookie.substr(0, response.cookie.find(';'));
  }
  static std::string signed_in(SignIn& sign_in, const std::string& token) {
    const WebResponse response = sign_in.sign_in(from_page("POST", "", json{{"token", token}}.dump()));
    EXPECT_EQ(response.status, 200U);
    return cookie_of(response);
  }
  static WebResponse follow(SignIn& sign_in, const std::string& key) {
    return sign_in.sign_in(from_page("POST", "", json{{"link", key}}.dump()));
  }
  static unsigned status(SignIn& sign_in, const WebRequest& request, Access needed) {
    const auto visitor = sign_in.admit(request, needed);
    return visitor ? 200U : visitor.error().status;
  }

  test::ScratchFolder scratch;
  std::filesystem::path folder = scratch.path(), file = folder / "operator-tokens", key_file = folder / "page-link";
  VirtualClock clock;
  std::vector<std::string> noted, refused;
};

TEST_F(SignInTest, OnTheMachineItselfThePartIsShownAndTheSharedTokenCommands) {
  SignIn sign_in = page();
  EXPECT_EQ(status(sign_in, with_token(""), Access::Readers), 200U);
  EXPECT_EQ(status(sign_in, with_token(""), Access::Operators), 401U);
  EXPECT_EQ(sign_in.admit(with_token("the-shared-token"), Access::Operators).value().name, "web");
  EXPECT_FALSE(sign_in.must_sign_in());
}

TEST_F(SignInTest, WithTheFirstTokenNothingIsShownToNobodyAndTheSharedTokenEnds) {
  SignIn sign_in = page();
  const std::string ada = add("ada");
  EXPECT_TRUE(sign_in.must_sign_in());
  EXPECT_EQ(status(sign_in, with_token(""), Access::Readers), 401U);
  EXPECT_EQ(status(sign_in, with_token("the-shared-token"), Access::Operators), 401U);
  EXPECT_EQ(status(sign_in, with_token("the-shared-token"), Access::Readers), 401U);
  EXPECT_EQ(status(sign_in, with_token(""), Access::Anybody), 200U);
  EXPECT_EQ(sign_in.admit(with_token(ada), Access::Operators).value(), (Visitor{"ada", Access::Operators}));
}

TEST_F(SignInTest, ShownBeyondItsMachineNobodyIsLetInByTheSharedToken) {
  SignIn sign_in = page(true);
  EXPECT_EQ(status(sign_in, with_token(""), Access::Readers), 401U);
  EXPECT_EQ(status(sign_in, with_token("the-shared-token"), Access::Readers), 401U);
}

TEST_F(SignInTest, KeepsNoTokenThatCouldBeUsed) {
  const std::string ada = add("ada");
  std::stringstream kept;
  kept << std::ifstream{file}.rdbuf();
  EXPECT_THAT(kept.str(), HasSubstr("ada operator "));
  EXPECT_THAT(kept.str(), Not(HasSubstr(ada)));
  struct stat status_of {};
  ASSERT_EQ(::stat(file.c_str(), &status_of), 0);
  EXPECT_EQ(status_of.st_mode & 0777U, 0600U);
  // Two with the same bits would not look alike: each line has a salt of its own.
  add("bob");
  const auto tokens = read_operator_tokens(file).value();
  ASSERT_THAT(tokens, SizeIs(2));
  EXPECT_NE(tokens[0].salt, tokens[1].salt);
}

TEST_F(SignInTest, ARevokedTokenOpensNothingFromTheNextRequestOnNorDoesItsSession) {
  SignIn sign_in = page();
  const std::string ada = add("ada"), bob = add("bob");
  const std::string cookie = signed_in(sign_in, ada);
  EXPECT_EQ(status(sign_in, from_page("GET", cookie), Access::Readers), 200U);
  ASSERT_TRUE(revoke_operator_token(file, "ada"));
  EXPECT_EQ(status(sign_in, with_token(ada), Access::Readers), 401U);
  EXPECT_EQ(status(sign_in, from_page("GET", cookie), Access::Readers), 401U);
  EXPECT_EQ(status(sign_in, with_token(bob), Access::Operators), 200U);
  // One made again under her name is another.
  add("ada");
  EXPECT_EQ(status(sign_in, from_page("GET", cookie), Access::Readers), 401U);
}

TEST_F(SignInTest, TheLastRevokeOpensThePageToNobody) {
  SignIn sign_in = page();
  const std::string ada = add("ada");
  ASSERT_TRUE(revoke_operator_token(file, "ada"));
  EXPECT_EQ(status(sign_in, with_token(""), Access::Readers), 401U);
  EXPECT_EQ(status(sign_in, with_token("the-shared-token"), Access::Operators), 401U);
}

TEST_F(SignInTest, WhoMayOnlyReadCommandsNothing) {
  SignIn sign_in = page();
  const std::string reader = add("prometheus", Access::Readers);
  EXPECT_EQ(status(sign_in, with_token(reader), Access::Readers), 200U);
  EXPECT_EQ(status(sign_in, with_token(reader, "POST"), Access::Operators), 403U);
}

TEST_F(SignInTest, CountsNobodysTokenWhereOthersCanReadTheFileOrItIsDamaged) {
  const std::string ada = add("ada");
  ASSERT_EQ(::chmod(file.c_str(), 0604), 0);
  SignIn sign_in = page();
  EXPECT_EQ(status(sign_in, with_token(ada), Access::Readers), 401U);
  EXPECT_EQ(status(sign_in, with_token(""), Access::Readers), 401U);
  ASSERT_THAT(refused, Not(IsEmpty()));
  EXPECT_THAT(refused[0], HasSubstr("read or changed by others"));
  ASSERT_EQ(::chmod(file.c_str(), 0600), 0);
  EXPECT_EQ(status(sign_in, with_token(ada), Access::Readers), 200U);
  std::ofstream{file, std::ios::app} << "eve operator 00 00 1\n";
  EXPECT_EQ(status(sign_in, with_token(ada), Access::Readers), 401U);
  EXPECT_THAT(refused, testing::Contains(HasSubstr("line 2")));
}

TEST_F(SignInTest, NamesNobodyByWhatTheDaemonCallsTheNamelessAndNobodyTwice) {
  for (const char* name : {"", "web", "local", "ada lovelace", "a/b", "\n"})
    EXPECT_EQ(add_operator_token(file, name, Access::Operators, {}).error().code, ErrorCode::InvalidInput) << name;
  add("ada");
  EXPECT_EQ(add_operator_token(file, "ada", Access::Operators, {}).error().code, ErrorCode::Conflict);
  EXPECT_EQ(revoke_operator_token(file, "bob").error().code, ErrorCode::NotFound);
}

TEST_F(SignInTest, ASessionsCookieIsKeptFromScriptsAndFromOtherSites) {
  SignIn sign_in = page();
  const WebRequest asked = from_page("POST", "", json{{"token", add("ada")}}.dump());
  EXPECT_THAT(sign_in.sign_in(asked).cookie, HasSubstr("; Max-Age=43200; Path=/; HttpOnly; SameSite=Strict"));
  EXPECT_THAT(sign_in.sign_in(asked).cookie, Not(HasSubstr("Secure")));
  WebRequest over_tls = asked;
  over_tls.is_encrypted = true;
  over_tls.origin = "https://localhost:7480";
  EXPECT_THAT(sign_in.sign_in(over_tls).cookie, HasSubstr("; Secure"));
  EXPECT_THAT(noted,
              ElementsAre("ada: signed in at the page", "ada: signed in at the page", "ada: signed in at the page"));
}

TEST_F(SignInTest, TwoDaemonsOfOneMachineHaveCookiesOfTheirOwn) {
  SignIn sign_in = page();
  const std::string cookie = signed_in(sign_in, add("ada"));
  EXPECT_TRUE(cookie.starts_with("telefab-7480="));
  EXPECT_EQ(status(sign_in, from_page("GET", "telefab-7481=x; other=y; " + cookie), Access::Readers), 200U);
  WebRequest other_port = from_page("GET", cookie);
  other_port.host = "localhost:7481";
  EXPECT_EQ(status(sign_in, other_port, Access::Readers), 401U);
}

TEST_F(SignInTest, ASessionEndsAfterTwelveHoursAndAtTheSignOut) {
  SignIn sign_in = page();
  const std::string ada = add("ada");
  const std::string first = signed_in(sign_in, ada);
  clock.advance(std::chrono::hours{12} - std::chrono::seconds{1});
  EXPECT_EQ(status(sign_in, from_page("POST", first), Access::Operators), 200U);
  clock.advance(std::chrono::seconds{1});
  EXPECT_EQ(status(sign_in, from_page("POST", first), Access::Operators), 401U);
  const std::string second = signed_in(sign_in, ada);
  EXPECT_EQ(status(sign_in, from_page("GET", second), Access::Readers), 200U);
  const WebResponse out = sign_in.sign_out(from_page("POST", second));
  EXPECT_THAT(out.cookie, HasSubstr("telefab-7480=; Max-Age=0"));
  EXPECT_THAT(out.headers, testing::Contains(std::pair<std::string, std::string>{"Clear-Site-Data", "\"cache\""}))
      << "pictures of parts that the browser kept";
  EXPECT_EQ(status(sign_in, from_page("GET", second), Access::Readers), 401U);
  EXPECT_EQ(noted.back(), "ada: signed out at the page");
}

TEST_F(SignInTest, CarriesOutNothingThatAPageOfSomebodyElseSendsWithTheOperatorsCookie) {
  SignIn sign_in = page();
  const std::string cookie = signed_in(sign_in, add("ada"));
  // A page of another port of this machine is of the same site for a browser, which sends the cookie.
  for (const char* origin :
       {"", "null", "http://localhost:7481", "http://evil.example", "http://localhost:7480.evil.example",
        "http://localhost", "localhost:7480", "https://localhost:7481"}) {
    WebRequest forged = from_page("POST", cookie);
    forged.origin = origin;
    EXPECT_EQ(status(sign_in, forged, Access::Operators), 403U) << origin;
  }
  EXPECT_EQ(status(sign_in, from_page("POST", cookie), Access::Operators), 200U);
  WebRequest login = from_page("POST", "", R"({"token":"x"})");
  login.origin = "http://evil.example";
  EXPECT_EQ(sign_in.sign_in(login).status, 403U);
}

TEST_F(SignInTest, ACertificateNamesItsHolderAndIsNotUsedByForeignPages) {
  SignIn sign_in = page(true);
  WebRequest request = from_page("POST", "");
  request.is_encrypted = true;
  request.origin.clear();
  request.certified = Visitor{"ada", Access::Operators};
  EXPECT_EQ(sign_in.admit(request, Access::Operators).value().name, "ada");
  request.origin = "https://localhost:7480";
  EXPECT_EQ(status(sign_in, request, Access::Operators), 200U);
  for (const char* origin : {"http://localhost:7480", "https://evil.example"}) {
    request.origin = origin;
    EXPECT_EQ(status(sign_in, request, Access::Operators), 403U) << origin;
  }
  request.origin.clear();
  request.certified = Visitor{"los-angeles", Access::Anybody};  // a site's
  EXPECT_EQ(status(sign_in, request, Access::Readers), 403U);
}

TEST_F(SignInTest, SaysWhoIsSignedInAndWhetherSomebodyHasToBe) {
  SignIn sign_in = page();
  EXPECT_EQ(json::parse(sign_in.session(from_page("GET", "")).body),
            (json{{"name", nullptr}, {"may", "read-only"}, {"must_sign_in", false}, {"by", nullptr}}));
  const std::string cookie = signed_in(sign_in, add("ada"));
  EXPECT_EQ(json::parse(sign_in.session(from_page("GET", "")).body),
            (json{{"name", nullptr}, {"may", "nothing"}, {"must_sign_in", true}, {"by", nullptr}}));
  EXPECT_EQ(json::parse(sign_in.session(from_page("GET", cookie)).body),
            (json{{"name", "ada"}, {"may", "operator"}, {"must_sign_in", true}, {"by", "session"}}));
}

TEST_F(SignInTest, HoldsNoMoreSessionsThanItsLimit) {
  SignIn sign_in = page();
  const std::string ada = add("ada");
  const std::string first = signed_in(sign_in, ada);
  for (int i = 0; i < 256; ++i) {
    clock.advance(std::chrono::seconds{1});
    (void)signed_in(sign_in, ada);
  }
  EXPECT_EQ(status(sign_in, from_page("GET", first), Access::Readers), 401U);
}

TEST_F(SignInTest, LeavesThePasswordOfAProxyBeforeItToTheProxy) {
  SignIn sign_in = page(true);
  WebRequest request = from_page("POST", signed_in(sign_in, add("ada")));
  request.authorization = "Basic YWRhOnByb3h5";
  EXPECT_EQ(sign_in.admit(request, Access::Operators).value().name, "ada");
  request.cookie.clear();
  EXPECT_EQ(status(sign_in, request, Access::Readers), 401U);
}

TEST_F(SignInTest, CountsARefusedTokenOnceForARequestWhoseHeadIsLookedAtFirst) {
  SignIn sign_in = page();
  add("ada");
  WebRequest request = with_token("wrong");
  request.is_whole = false;
  EXPECT_EQ(status(sign_in, request, Access::Readers), 401U);
  EXPECT_THAT(refused, IsEmpty());
  request.is_whole = true;
  EXPECT_EQ(status(sign_in, request, Access::Readers), 401U);
  ASSERT_THAT(refused, SizeIs(1));
  EXPECT_THAT(refused[0], HasSubstr("192.0.2.7:5000"));
}

TEST_F(SignInTest, ALinkOpensOnceWhatTheSharedTokenOpens) {
  SignIn sign_in = page();
  const std::string key = make_page_key(key_file, clock.wall()).value();
  const WebResponse first = follow(sign_in, key);
  ASSERT_EQ(first.status, 200U);
  EXPECT_EQ(sign_in.admit(from_page("POST", cookie_of(first)), Access::Operators).value().name, "web");
  EXPECT_THAT(noted, ElementsAre("web: signed in at the page by a link"));
  const WebResponse second = follow(sign_in, key);
  EXPECT_EQ(second.status, 401U);
  EXPECT_THAT(second.body, HasSubstr("page-link"));
  EXPECT_TRUE(second.cookie.empty());
  EXPECT_THAT(refused, SizeIs(1));
  EXPECT_EQ(page().sign_in(from_page("POST", "", json{{"link", key}}.dump())).status, 401U) << "a daemon begun again";
}

TEST_F(SignInTest, ALinkEndsAfterItsTimeAndWithTheNextOne) {
  SignIn sign_in = page();
  const std::string old = make_page_key(key_file, clock.wall()).value();
  const std::string key = make_page_key(key_file, clock.wall()).value();
  EXPECT_EQ(follow(sign_in, old).status, 401U);
  clock.advance(kPageLinkLasts - std::chrono::seconds{1});
  EXPECT_EQ(follow(sign_in, key).status, 200U) << "a wrong key takes nothing from the right one";
  const std::string late = make_page_key(key_file, clock.wall()).value();
  clock.advance(kPageLinkLasts);
  EXPECT_EQ(follow(sign_in, late).status, 401U);
  EXPECT_FALSE(std::filesystem::exists(key_file));
}

TEST_F(SignInTest, AClockThatWasSetBackMakesNoLinkLastLonger) {
  SignIn sign_in = page();
  const std::string key = make_page_key(key_file, clock.wall() + std::chrono::hours{24}).value();
  EXPECT_EQ(follow(sign_in, key).status, 401U);
}

TEST_F(SignInTest, NoLinkOpensWhereEverybodySignsInByName) {
  const std::string key = make_page_key(key_file, clock.wall()).value();
  SignIn beyond = page(true);
  EXPECT_EQ(follow(beyond, key).status, 401U);
  SignIn sign_in = page();
  const WebResponse opened = follow(sign_in, key);
  ASSERT_EQ(opened.status, 200U);
  add("ada");
  EXPECT_EQ(status(sign_in, from_page("GET", cookie_of(opened)), Access::Readers), 401U) << "nor what one has opened";
  const std::string later = make_page_key(key_file, clock.wall()).value();
  const WebResponse refusal = follow(sign_in, later);
  EXPECT_EQ(refusal.status, 401U);
  EXPECT_THAT(refusal.body, HasSubstr("tokens add NAME"));
}

TEST_F(SignInTest, NoPageOfSomebodyElseSignsInByALink) {
  SignIn sign_in = page();
  const std::string key = make_page_key(key_file, clock.wall()).value();
  WebRequest request = from_page("POST", "", json{{"link", key}}.dump());
  request.origin = "http://localhost:9999";
  EXPECT_EQ(sign_in.sign_in(request).status, 403U);
  EXPECT_EQ(follow(sign_in, key).status, 200U) << "and it is not used up";
}

TEST_F(SignInTest, KeepsNoLinkThatCouldBeUsedAndTrustsNoFileThatOthersRead) {
  SignIn sign_in = page();
  const std::string key = make_page_key(key_file, clock.wall()).value();
  std::stringstream kept;
  kept << std::ifstream{key_file}.rdbuf();
  EXPECT_THAT(kept.str(), Not(HasSubstr(key)));
  ASSERT_EQ(::chmod(key_file.c_str(), 0644), 0);
  EXPECT_EQ(follow(sign_in, key).status, 401U);
}

TEST_F(SignInTest, WantsATokenOrALinkAndNotBoth) {
  SignIn sign_in = page();
  const std::string key = make_page_key(key_file, clock.wall()).value();
  for (const json& body : {json{{"token", "the-shared-token"}, {"link", key}}, json::object(), json{{"link", 7}}})
    EXPECT_EQ(sign_in.sign_in(from_page("POST", "", body.dump())).status, 400U) << body.dump();
  EXPECT_EQ(follow(sign_in, key).status, 200U);
}

/// What may be asked without signing in where everybody has to.
constexpr std::array kOpen{"/v1/session", "/v1/sign-in", "/v1/sign-out", "/v1/version", "/v1/health", "/v1/parameters"};

TEST_F(SignInTest, EveryGetOfBothPagesThatShowsAPartWantsASignIn) {
  SignIn sign_in = page();
  const std::string ada = add("ada");
  fab::RecordingBackend fab_backend;
  scan::RecordingScanBackend scan_backend;
  scan::RecordingStaging staging;
  scan::ScanWeb scan{scan_backend, staging, sign_in, {.version = "0"}};
  fab::FabWeb fab{fab_backend, sign_in, {}};
  std::size_t closed = 0;
  const auto look = [&](WebSite& site, const std::vector<WebRoute>& routes) {
    for (const WebRoute& route : routes) {
      std::string path{route.path};
      if (const auto at = path.find("{id}"); at != std::string::npos) path.replace(at, 4, "job-1");
      if (const auto at = path.find("{layer}"); at != std::string::npos) path.replace(at, 7, "2");
      if (const auto at = path.find("{path}"); at != std::string::npos) path.replace(at, 6, "job-1");
      if (const auto at = path.find("{storage}"); at != std::string::npos) path.replace(at, 9, "local");
      if (path.find("/levels/") != std::string::npos) path += "?revision=7";
      WebRequest request = with_token("", std::string{route.method});
      request.target = path;
      const bool is_open = std::ranges::find(kOpen, path) != kOpen.end();
      const WebResponse shown = site.answer(request);
      EXPECT_EQ(shown.status == 401, !is_open) << path;
      EXPECT_THAT(shown.body, Not(HasSubstr("job-1"))) << path;
      EXPECT_EQ(site.admit(request).has_value(), is_open) << path;
      closed += !is_open;
      if (route.method != "GET") continue;
      request.authorization = "Bearer " + ada;
      EXPECT_EQ(site.answer(request).status, path == "/api/v1/transfer" ? 204U : 200U) << path;
    }
  };
  look(fab, fab::web_routes());
  look(scan, scan::web_routes());
  EXPECT_EQ(closed, fab::web_routes().size() + scan::web_routes().size() - 11);
}

}  // namespace
}  // namespace telefab
