// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <telefab/fab/web/router.hpp>
#include <telefab/net/authority.hpp>
#include <telefab/test/digest_client.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/https_client.hpp>
#include <telefab/test/recording_backend.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <thread>

namespace telefab::fab {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using test::HttpsClient;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

/// A page off loopback, as far as it knows: over TLS, where everybody signs in.
class TlsPage : public testing::Test {
 protected:
  TlsPage() {
    EXPECT_TRUE(net::make_authority(folder, clock));
    for (const auto& [name, role] :
         std::initializer_list<std::pair<const char*, net::Role>>{{"fab", net::Role::FabSite},
                                                                  {"scan", net::Role::ScanSite},
                                                                  {"ada", net::Role::Operator},
                                                                  {"viewer", net::Role::ReadOnly}})
      EXPECT_TRUE(net::issue_certificate(folder, {name, role, {}, hours{24}}, clock));
    bob = add_operator_token(tokens, "bob", Access::Operators, {}).value();
    WebAddress address{"127.0.0.1"};
    address.trust = net::Trust::load(net::tls_files_in(folder, "fab")).value();
    address.max_connections = 16;
    address.judge_every = milliseconds{50};
    server = WebServer::listen(address, site, "telefab-fab/0", clock).value();
  }
  ~TlsPage() override { server.reset(); }
  [[nodiscard]] std::string ask_as(const std::string& name, const std::string& method, const std::string& target,
                                   const std::string& head = {}) const {
    return test::https_ask(HttpsClient{server->port(), folder, name}, method, target, head);
  }

  SystemClock clock;
  test::ScratchFolder scratch;
  std::filesystem::path folder = scratch.path();
  std::filesystem::path tokens = folder / "operator-tokens";
  std::string bob;
  RecordingBackend backend;
  SignIn sign_in{{tokens, "shared", true}, clock};
  FabWeb site{backend, sign_in, {}};
  std::unique_ptr<WebServer> server;
};

const std::string kMask = "/v1/jobs/job-1/layers/2/mask.png", kPause = "/v1/jobs/job-1/pause";

TEST_F(TlsPage, ShowsAPartToHoldersOfCertificatesAndOfTokensAlone) {
  for (const std::string target : {kMask.c_str(), "/v1/jobs", "/v1/stream", "/metrics"}) {
    EXPECT_THAT(ask_as("", "GET", target), StartsWith("HTTP/1.1 401")) << target;
    EXPECT_THAT(ask_as("", "GET", target, "X-Api-Key: shared\r\n"), StartsWith("HTTP/1.1 401")) << target;
    EXPECT_THAT(ask_as("scan", "GET", target), StartsWith("HTTP/1.1 403")) << target;
  }
  EXPECT_THAT(ask_as("", "GET", "/"), StartsWith("HTTP/1.1 200")) << "the page that asks for the token";
  for (const char* name : {"ada", "viewer"})
    EXPECT_THAT(ask_as(name, "GET", kMask), StartsWith("HTTP/1.1 200")) << name;
  EXPECT_THAT(ask_as("", "GET", kMask, "Authorization: Bearer " + bob + "\r\n"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(ask_as("ada", "GET", kMask), HasSubstr("Cache-Control: no-store"));
}

TEST_F(TlsPage, CarriesOutACommandUnderTheNameOfTheCertificateOrTheToken) {
  EXPECT_THAT(ask_as("viewer", "POST", kPause), StartsWith("HTTP/1.1 403"));
  EXPECT_THAT(ask_as("scan", "POST", kPause), StartsWith("HTTP/1.1 403"));
  EXPECT_THAT(ask_as("", "POST", kPause), StartsWith("HTTP/1.1 401"));
  EXPECT_TRUE(backend.actions.empty());
  EXPECT_THAT(ask_as("ada", "POST", kPause), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(ask_as("", "POST", kPause, "X-Api-Key: " + bob + "\r\n"), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(backend.names, testing::ElementsAre("ada", "bob"));
}

TEST_F(TlsPage, ForgetsARevokedCertificateOnAnOpenConnectionAndEndsItsStream) {
  const HttpsClient open{server->port(), folder, "ada"}, watcher{server->port(), folder, "ada"};
  open.send("GET /v1/version HTTP/1.1\r\nHost: localhost\r\n\r\n");
  ASSERT_THAT(open.read_until("\"v1\""), HasSubstr("200 OK"));
  watcher.send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
  ASSERT_THAT(watcher.read_until("job-1"), HasSubstr("event-stream"));
  ASSERT_TRUE(net::revoke_certificate(folder, "ada", clock));
  (void)watcher.read_until("");  // returns because the server has closed
  open.send("POST " + kPause + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(open.read_until(""), HasSubstr(" 401 "));
  EXPECT_TRUE(backend.actions.empty());
  EXPECT_THAT(ask_as("ada", "GET", kMask), Not(HasSubstr("200 OK")));
}

TEST_F(TlsPage, EndsTheStreamOfARevokedToken) {
  const HttpsClient watcher{server->port()};
  watcher.send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\nX-Api-Key: " + bob + "\r\n\r\n");
  ASSERT_THAT(watcher.read_until("job-1"), HasSubstr("event-stream"));
  ASSERT_TRUE(revoke_operator_token(tokens, "bob"));
  EXPECT_THAT(watcher.read_until(""), Not(HasSubstr("still here")));
}

TEST_F(TlsPage, KeepsAStreamThatWasOpenedByDigestAndOpensNoOtherByTheSameLogin) {
  const std::string password = add_operator_token(tokens, "eve", Access::Readers, {}, DigestUse::Yes).value();
  const std::string challenge = ask_as("", "GET", "/api/v1/status");  // the pages offer no digest themselves
  const test::DigestClient eve{"eve", password};
  const std::string login =
      "Authorization: " + eve.answer("GET", "/v1/stream", test::DigestClient::nonce_of(challenge)) + "\r\n";
  const HttpsClient watcher{server->port()};
  watcher.send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\n" + login + "\r\n");
  ASSERT_THAT(watcher.read_until("job-1"), HasSubstr("event-stream"));
  EXPECT_THAT(ask_as("", "GET", "/v1/stream", login), StartsWith("HTTP/1.1 401")) << "what was overheard";
  std::this_thread::sleep_for(milliseconds{200});  // it is judged several times
  ++backend.revised;
  EXPECT_THAT(watcher.read_until("data: "), HasSubstr("data: ")) << "it still watches";
  ASSERT_TRUE(revoke_operator_token(tokens, "eve"));
  (void)watcher.read_until("");  // returns because the server has closed
}

TEST_F(TlsPage, TakesNoCertificateOfAnotherAuthority) {
  const auto other = folder / "other";
  std::filesystem::create_directories(other);
  ASSERT_TRUE(net::make_authority(other, clock));
  ASSERT_TRUE(net::issue_certificate(other, {"ada", net::Role::Operator, {}, hours{24}}, clock));
  const HttpsClient forged{server->port(), other, "ada"};
  EXPECT_THAT(test::https_ask(forged, "GET", kMask), Not(HasSubstr("200 OK")));
}

TEST_F(TlsPage, ANewcomerTakesThePlaceOfAFloodAndNotOfWhoHasSignedIn) {
  const HttpsClient known{server->port(), folder, "ada"};
  known.send("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\n\r\n");
  ASSERT_THAT(known.read_until("job-1"), HasSubstr("200 OK"));
  std::vector<std::unique_ptr<test::HttpClient>> silent;
  for (int i = 0; i < 64; ++i) silent.push_back(std::make_unique<test::HttpClient>(server->port()));
  EXPECT_THAT(ask_as("", "GET", kMask, "X-Api-Key: " + bob + "\r\n"), StartsWith("HTTP/1.1 200"));
  known.send("GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(known.read_until("job-1"), HasSubstr("200 OK"));
}

}  // namespace
}  // namespace telefab::fab
