// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/no_descriptors.hpp>
#include <telefab/test/recording_backend.hpp>
#include <thread>

namespace telefab::fab {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

using Client = test::HttpClient;

class WebServerTest : public testing::Test {
 protected:
  RecordingBackend backend;
  SystemClock clock;
  SignIn sign_in{{.shared_token = "secret"}, clock};
  FabWeb site{backend, sign_in, {"0.1.0", ""}};
  std::unique_ptr<WebServer> server = WebServer::listen({"127.0.0.1"}, site, "telefab-fab/0.1.0", clock).value();

  std::string ask(const std::string& request) {
    const Client client{server->port()};
    client.send(request);
    return client.read_until("");
  }
};

TEST_F(WebServerTest, ServesThePageWithAPolicyThatForbidsOutsideRequests) {
  const std::string text = ask("GET / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(text, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(text, HasSubstr("default-src 'self'"));
  EXPECT_THAT(text, HasSubstr("Telefab"));
}

// A page anywhere whose name is made to mean this address could read masks.
TEST_F(WebServerTest, AnswersOnlyUnderNamesOfItsOwn) {
  const auto named = WebServer::listen({"127.0.0.1", 0, {"Fab.Example.org"}}, site, "telefab-fab/0.1.0", clock).value();
  for (const std::string host :
       {"localhost", "LOCALHOST:8080", "127.0.0.1:7480", "[::1]:1", "[::1]", "fab.example.org"}) {
    const Client client{named->port()};
    client.send("GET /v1/version HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n");
    EXPECT_THAT(client.read_until(""), StartsWith("HTTP/1.1 200")) << host;
  }
  for (const std::string host :
       {"evil.example", "localhost.evil.example", "fab.example.org", "", "127.0.0.1.nip.io", "::1"})
    for (const std::string target : {"/v1/version", "/v1/stream", "/"})
      EXPECT_THAT(ask("GET " + target + " HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n\r\n"),
                  StartsWith("HTTP/1.1 421"))
          << host << target;
  EXPECT_THAT(ask("GET /v1/version HTTP/1.0\r\n\r\n"), StartsWith("HTTP/1.1 421")) << "no name at all";
}

TEST_F(WebServerTest, WithoutDescriptorsItWaitsForThemWithoutUsingTheProcessor) {
  const std::uint16_t port = server->port();  // where no pipe can be opened, a sanitizer knows no object's type
  std::optional<test::NoDescriptors> none{1};
  const Client client{port};
  client.send("GET /v1/version HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  const double before = test::processor_seconds();
  std::this_thread::sleep_for(std::chrono::milliseconds{400});
  EXPECT_LT(test::processor_seconds() - before, 0.1);
  none.reset();
  EXPECT_THAT(client.read_until(""), StartsWith("HTTP/1.1 200")) << "who waited meanwhile is answered";
}

TEST_F(WebServerTest, KeepsTheConnectionForTheNextRequest) {
  const Client client{server->port()};
  client.send("GET /v1/version HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(client.read_until("\"v1\""), HasSubstr("200 OK"));
  client.send("GET /v1/devices HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_THAT(client.read_until("\"light\""), HasSubstr("200 OK"));
}

TEST_F(WebServerTest, StreamsTheJobList) {
  const Client client{server->port()};
  client.send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
  const std::string text = client.read_until("job-1");
  EXPECT_THAT(text, HasSubstr("text/event-stream"));
  EXPECT_THAT(text, HasSubstr("data: {\"jobs\""));
}

TEST_F(WebServerTest, TakesTheOperatorsTokenAsApiKeyToo) {
  EXPECT_THAT(
      ask("POST /v1/jobs/job-1/pause HTTP/1.1\r\nHost: localhost\r\nX-Api-Key: secret\r\nConnection: close\r\n\r\n"),
      HasSubstr("200 OK"));
  EXPECT_THAT(
      ask("POST /v1/jobs/job-1/pause HTTP/1.1\r\nHost: localhost\r\nX-Api-Key: wrong\r\nConnection: close\r\n\r\n"),
      HasSubstr("401"));
  EXPECT_EQ(backend.actions.size(), 1U);
}

TEST_F(WebServerTest, AnswersHeadWithTheLengthAndNoBody) {
  const std::string text = ask("HEAD /v1/version HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  EXPECT_THAT(text, HasSubstr("Content-Length: "));
  EXPECT_EQ(text.substr(text.find("\r\n\r\n")), "\r\n\r\n");
}

TEST_F(WebServerTest, RefusesAnOversizedBodyAndOversizedHeaders) {
  EXPECT_THAT(ask("POST /v1/jobs/job-1/pause HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9999999\r\n\r\n" +
                  std::string(1000, 'x')),
              HasSubstr(" 413 "));
  EXPECT_THAT(ask("GET / HTTP/1.1\r\nHost: localhost\r\nX-Long: " + std::string(40'000, 'x') + "\r\n\r\n"),
              HasSubstr(" 413 "));
}

TEST_F(WebServerTest, OutlivesNoiseAndStillAnswers) {
  std::mt19937_64 rng{3};
  for (int i = 0; i < 300; ++i) {
    std::string noise(rng() % 200, '\0');
    for (char& c : noise) c = static_cast<char>(rng());
    Client client{server->port()};
    client.send(noise + "\r\n\r\n");
  }
  EXPECT_THAT(ask("GET /v1/version HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"), HasSubstr("200 OK"));
  EXPECT_TRUE(backend.actions.empty());
}

TEST_F(WebServerTest, LeavesRoomForAnOperatorBesideManyWatchers) {
  std::vector<std::unique_ptr<Client>> watchers;
  for (int i = 0; i < 60; ++i) {
    watchers.push_back(std::make_unique<Client>(server->port()));
    watchers.back()->send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
    (void)watchers.back()->read_until("\n");
  }
  EXPECT_THAT(
      ask("POST /v1/jobs/job-1/cancel HTTP/1.1\r\nHost: localhost\r\nX-Api-Key: secret\r\nConnection: close\r\n\r\n"),
      HasSubstr("200 OK"));
}

TEST(WebServer, SaysWhichPortIsTaken) {
  RecordingBackend backend;
  const SystemClock clock;
  SignIn sign_in{{}, clock};
  FabWeb site{backend, sign_in, {}};
  const auto first = WebServer::listen({"127.0.0.1"}, site, "", clock);
  ASSERT_TRUE(first);
  const auto second = WebServer::listen({"127.0.0.1", (*first)->port()}, site, "", clock);
  ASSERT_FALSE(second);
  EXPECT_THAT(second.error().what, HasSubstr(std::to_string((*first)->port())));
}

}  // namespace
}  // namespace telefab::fab
