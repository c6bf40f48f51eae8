// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/digest_client.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/recording_backend.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab::fab {
namespace {

using test::DigestClient;
using test::HttpClient;
using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;

/// A page where everybody signs in, and programs that send it files.
class Senders : public testing::Test {
 protected:
  Senders() {
    ada = add_operator_token(tokens, "ada", Access::Operators, {}, DigestUse::Yes).value();
    server = WebServer::listen({"127.0.0.1"}, site, "telefab-fab/0.1.0", clock).value();
  }
  ~Senders() override { server.reset(); }

  /// A file to send, with bytes that no form and no line end may change.
  [[nodiscard]] std::filesystem::path part(const std::string& name) {
    std::ofstream{scratch.path() / name, std::ios::binary} << content;
    return scratch.path() / name;
  }
  [[nodiscard]] std::string at(const std::string& target) const {
    return fmt::format("http://127.0.0.1:{}{}", server->port(), target);
  }
  /// What curl prints: the body, a line end and the status.
  [[nodiscard]] static std::string curl(std::vector<std::string> words) {
    words.insert(words.begin(),
                 {program("curl"), "--silent", "--show-error", "--max-time", "20", "--write-out", "\n%{http_code}\n"});
    test::Process process{words};
    (void)process.finish();
    return process.output() + process.errors();
  }
  /// Where a program is; empty: nowhere.
  [[nodiscard]] static std::string program(const char* name) {
    const char* path = std::getenv("PATH");
    std::stringstream folders{path != nullptr ? path : ""};
    for (std::string folder; std::getline(folders, folder, ':');)
      if (std::filesystem::exists(std::filesystem::path{folder} / name)) return folder + "/" + name;
    return {};
  }

  SystemClock clock;
  test::ScratchFolder scratch;
  std::filesystem::path tokens = scratch.path() / "operator-tokens";
  std::string ada;
  std::string content = std::string{"PK\x03\x04 \r\n--XX\r\n\0 bytes", 22} + std::string(300'000, 'x');
  RecordingBackend backend;
  SignIn sign_in{{tokens, {}, false}, clock};
  FabWeb site{backend, sign_in, {"0.1.0", ""}};
  std::unique_ptr<WebServer> server;
};

/// One request on a connection that stays; the head of the answer and, where it states a length, its body.
std::string talk(const HttpClient& client, const std::string& request) {
  client.send(request);
  std::string answer = client.read_until("\r\n\r\n");
  constexpr std::string_view kLength = "Content-Length: ";
  const auto length = answer.find(kLength);
  const std::size_t body = length == std::string::npos ? 0 : std::stoul(answer.substr(length + kLength.size()));
  while (answer.size() < answer.find("\r\n\r\n") + 4 + body) {
    char byte = 0;
    if (::recv(client.descriptor(), &byte, 1, 0) != 1) break;
    answer += byte;
  }
  return answer;
}

// As PrusaSlicer does with user and password, by libcurl: version, storages, an empty PUT that asks for the challenge,
// then the file under a name with blanks and umlauts.
TEST_F(Senders, PrusaSlicersConversationWithAPrusaLinkUploadsAndStarts) {
  const HttpClient client{server->port()};
  const DigestClient slicer{"ada", ada};
  const auto line = [](const std::string& method, const std::string& target) {
    return method + " " + target +
           " HTTP/1.1\r\nHost: localhost:7480\r\nUser-Agent: PrusaSlicer/2.9\r\nAccept: */*\r\n";
  };
  const std::string version = "/prusalink/api/version", storage = "/prusalink/api/v1/storage";
  const std::string challenge = talk(client, line("GET", version) + "\r\n");
  ASSERT_THAT(challenge, StartsWith("HTTP/1.1 401"));
  std::string nonce = DigestClient::nonce_of(challenge);
  const auto login = [&](const std::string& method, const std::string& target, const char* count) {
    return line(method, target) + "Authorization: " + slicer.answer(method, target, nonce, count) + "\r\n";
  };
  EXPECT_THAT(
      talk(client, login("GET", version, "00000001") + "\r\n"),
      AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("\"text\":\"PrusaLink"), HasSubstr("\"upload-by-put\":true")));
  EXPECT_THAT(talk(client, login("GET", storage, "00000002") + "Accept-Language: en\r\n\r\n"),
              HasSubstr("{\"storage_list\":[{\"path\":\"/local\""));
  const std::string file = "/prusalink/api/v1/files/local/B%C3%BCste%201.sl1";
  const std::string about = "Content-Type: text/x.gcode\r\nOverwrite: ?1\r\nPrint-After-Upload: ?1\r\n";
  const std::string refused = talk(client, line("PUT", file) + about + "Content-Length: 0\r\n\r\n");
  ASSERT_THAT(refused, StartsWith("HTTP/1.1 401"));
  nonce = DigestClient::nonce_of(refused);
  client.send(login("PUT", file, "00000001") + about +
              fmt::format("Content-Length: {}\r\nExpect: 100-continue\r\n\r\n", content.size()));
  ASSERT_THAT(client.read_until("\r\n\r\n"), StartsWith("HTTP/1.1 100"));
  EXPECT_THAT(talk(client, content), StartsWith("HTTP/1.1 201"));
  ASSERT_THAT(backend.files, SizeIs(1));
  EXPECT_EQ(backend.files[0].name, "B\u00fcste 1.sl1");
  EXPECT_EQ(backend.files[0].content, content);
  EXPECT_TRUE(backend.files[0].start);
}

TEST_F(Senders, AnOldLoginOfALargeUploadIsAskedForAgainAndNotCalledTooLarge) {
  const DigestClient slicer{"ada", ada};
  const std::string file = "/api/v1/files/local/part.sl1";
  const std::string answer =
      test::http_ask(server->port(), "PUT", file,
                     "Authorization: " + slicer.answer("PUT", file, std::string(64, '0')) + "\r\n", content);
  EXPECT_THAT(answer, AllOf(StartsWith("HTTP/1.1 401"), HasSubstr("stale=true")));
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST_F(Senders, WhoSendsAWholeFileWithoutALoginStillReadsTheChallenge) {
  const HttpClient client{server->port()};
  const std::string large(8U << 20U, 'x');
  client.send(fmt::format("PUT /api/v1/files/usb/part.sl1 HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n",
                          large.size()));
  client.send(large);
  EXPECT_THAT(client.read_until(""), AllOf(StartsWith("HTTP/1.1 401"), HasSubstr("WWW-Authenticate: Digest")));
  EXPECT_THAT(backend.files, IsEmpty());
}

TEST_F(Senders, CurlUploadsByDigestByKeyAndByForm) {
  if (program("curl").empty()) GTEST_SKIP() << "curl is not installed";
  const std::string file = part("part.sl1").string(), user = "ada:" + ada;
  const std::string to = at("/api/v1/files/local/part.sl1");
  EXPECT_THAT(curl({"--digest", "--user", user, "--upload-file", file, to}), HasSubstr("\n201\n"));
  EXPECT_THAT(curl({"--anyauth", "--user", user, "--upload-file", file, "--header", "Print-After-Upload: ?1", to}),
              HasSubstr("\n201\n"));
  EXPECT_THAT(curl({"--header", "X-Api-Key: " + ada, "--upload-file", file, to}), HasSubstr("\n201\n"));
  EXPECT_THAT(curl({"--header", "X-Api-Key: " + ada, "--form", "file=@" + file, "--form", "print=true",
                    at("/api/files/local")}),
              HasSubstr("\n201\n"));
  EXPECT_THAT(curl({"--digest", "--user", user, "--request", "DELETE", at("/api/v1/job/1")}), HasSubstr("\n404\n"));
  ASSERT_THAT(backend.files, SizeIs(4));
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(backend.files[i].content, content) << i;
    EXPECT_EQ(backend.files[i].start, i % 2 == 1) << i;
  }
  EXPECT_THAT(curl({"--digest", "--user", "ada:wrong", "--upload-file", file, to}), HasSubstr("\n401\n"));
  EXPECT_THAT(curl({"--upload-file", file, to}), HasSubstr("\n401\n"));
  EXPECT_THAT(backend.files, SizeIs(4));
}

// The clients of FDM Monster, as its npm package has them: `npm install --ignore-scripts @fdm-monster/server` in the
// folder that TELEFAB_NPM names.
TEST_F(Senders, FdmMonstersClientsUploadByPrusaLinkAndByOctoPrint) {
  const char* folder = std::getenv("TELEFAB_NPM");
  const std::filesystem::path package =
      std::filesystem::path{folder != nullptr ? folder : "."} / "node_modules" / "@fdm-monster" / "server" / "dist";
  if (folder == nullptr || !std::filesystem::exists(package) || program("node").empty())
    GTEST_SKIP() << "TELEFAB_NPM names no folder with the npm package @fdm-monster/server, or there is no node";
  const auto script = std::filesystem::path{std::getenv("TELEFAB_SOURCE")} / "tests/integration/web/fdm_monster.cjs";
  test::Process node{
      {program("node"), script.string(), package.string(), at(""), "ada", ada, part("part.sl1").string()}};
  EXPECT_EQ(node.finish(), 0) << node.output() << node.errors();
  ASSERT_THAT(backend.files, SizeIs(3)) << node.output();
  EXPECT_THAT(backend.files, testing::Each(testing::Field(&RecordingBackend::File::content, content)));
  EXPECT_FALSE(backend.files[0].start);
  EXPECT_TRUE(backend.files[1].start);
  EXPECT_TRUE(backend.files[2].start);
  EXPECT_THAT(backend.actions, testing::ElementsAre(testing::Pair("job-1", JobCommand::Pause),
                                                    testing::Pair("job-1", JobCommand::Cancel)));
}

}  // namespace
}  // namespace telefab::fab
