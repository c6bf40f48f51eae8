// SPDX-License-Identifier: GPL-3.0-or-later
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/test/loopback.hpp>
#include <telefab/test/two_sites.hpp>
#include <thread>

namespace telefab::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// Takes POSTs on a port of loopback and keeps their bodies; answers the first with 500.
class Listener {
 public:
  Listener() {
    socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address = loopback(0);
    socklen_t size = sizeof address;
    if (::bind(socket_, reinterpret_cast<sockaddr*>(&address), size) != 0 || ::listen(socket_, 8) != 0) return;
    ::getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread{[this](const std::stop_token& stop) { serve(stop); }};
  }
  ~Listener() {
    thread_ = {};
    ::close(socket_);
  }
  [[nodiscard]] std::string url() const { return "http://127.0.0.1:" + std::to_string(port_) + "/telefab"; }
  /// States that were told, once `count` of them have come or patience ends.
  [[nodiscard]] std::vector<std::string> states(std::size_t count) {
    for (int i = 0; i < 300; ++i) {
      {
        const std::lock_guard lock{mutex_};
        if (states_.size() >= count) return states_;
      }
      ::poll(nullptr, 0, 50);
    }
    return states_;
  }

 private:
  void serve(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      pollfd each{socket_, POLLIN, 0};
      if (::poll(&each, 1, 50) <= 0) continue;
      const int client = ::accept(socket_, nullptr, nullptr);
      std::string request;
      char block[4096];
      while (request.find("}\n") == std::string::npos) {
        const ssize_t got = ::read(client, block, sizeof block);
        if (got <= 0) break;
        request.append(block, static_cast<std::size_t>(got));
      }
      const bool first = ++requests_ == 1;
      const std::string answer = first ? "HTTP/1.1 500 No\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
                                       : "HTTP/1.1 204 Yes\r\nConnection: close\r\n\r\n";
      (void)!::write(client, answer.data(), answer.size());
      ::close(client);
      const std::size_t body = request.find("\r\n\r\n");
      const json job = json::parse(request.substr(body == std::string::npos ? 0 : body), nullptr, false);
      const std::lock_guard lock{mutex_};
      if (!first && job.is_object()) states_.push_back(job["state"]);
    }
  }
  int socket_ = -1;
  int port_ = 0;
  int requests_ = 0;
  std::mutex mutex_;
  std::vector<std::string> states_;
  std::jthread thread_;
};

class Hooks : public TwoSites {
 protected:
  [[nodiscard]] std::string script(const std::string& text) const {
    const auto path = folder() / "hook";
    std::ofstream{path} << "#!/bin/sh\n" << text << "\n";
    std::filesystem::permissions(path, std::filesystem::perms::owner_all);
    return path.string();
  }
};

TEST_F(Hooks, AProgramHearsEveryStateInOrderWithTheJobAsItsInput) {
  const auto received = folder() / "received";
  start_fab({"--hook", script("echo $TELEFAB_STATE $TELEFAB_MACHINE >> " + received.string() + "; cat >> " +
                              (folder() / "jobs.jsonl").string())});
  start_scan();
  const std::string job = submit_torus();
  ASSERT_EQ(telefab({"watch", job}).code, 0);
  // The last one runs while the watcher ends already; the daemon's end waits for it or cuts it off, so look first.
  for (int i = 0; i < 100 && text_of(received).find("done") == std::string::npos; ++i) ::poll(nullptr, 0, 50);
  EXPECT_EQ(text_of(received), "sending toy\nplanning toy\nready toy\nprinting toy\ndone toy\n");
  std::ifstream lines{folder() / "jobs.jsonl"};
  std::string line;
  ASSERT_TRUE(std::getline(lines, line));
  EXPECT_EQ(json::parse(line)["id"], job);
}

TEST_F(Hooks, AWebAddressThatFailsOnceIsTriedAgain) {
  Listener listener;
  start_fab({"--webhook", listener.url()});
  start_scan();
  ASSERT_EQ(telefab({"watch", submit_torus()}).code, 0);
  EXPECT_THAT(listener.states(5), testing::ElementsAre("sending", "planning", "ready", "printing", "done"));
}

TEST_F(Hooks, AProgramThatFailsIsLoggedAndHoldsNothingUp) {
  start_fab({"--hook", script("exit 3")});
  start_scan();
  EXPECT_EQ(telefab({"watch", submit_torus()}).code, 0);
  EXPECT_THAT(fab().wait_for_error_line("it ended with exit code 3"), HasSubstr("was not told that job"));
}

TEST_F(Hooks, WhatCannotBeToldIsRefusedAtTheStart) {
  const auto serve = [&](const std::string& option, const std::string& value) {
    return run({std::string{::getenv("TELEFAB_BIN")} + "/telefab-fab", "serve", "--listen", "127.0.0.1:0", "--data",
                (folder() / "other").string(), "--machines", (folder() / "machines").string(), option, value});
  };
  const Outcome no_program = serve("--hook", "/nowhere/hook");
  EXPECT_EQ(no_program.code, 2) << no_program.errors;
  EXPECT_THAT(no_program.errors, HasSubstr("--hook: /nowhere/hook"));
  const Outcome no_address = serve("--webhook", "ftp://here");
  EXPECT_EQ(no_address.code, 2);
  EXPECT_THAT(no_address.errors, HasSubstr("http:// or https://"));
}

class Logs : public TwoSites {};

TEST_F(Logs, OfAJobHoldItsStatesAndWhoAskedForWhat) {
  start_both();
  const std::string job = submit_torus();
  ASSERT_EQ(telefab({"watch", job}).code, 0);
  const auto logs = [&](const std::string& program, const std::string& site, const std::string& id) {
    return run({std::string{::getenv("TELEFAB_BIN")} + "/" + program, "logs", id, "--data", (folder() / site).string(),
                "--json"});
  };
  const Outcome at_fab = logs("telefab-fab", "fab", job);
  ASSERT_EQ(at_fab.code, 0) << at_fab.errors;
  EXPECT_THAT(at_fab.output, HasSubstr("offer " + job));
  EXPECT_THAT(at_fab.output, HasSubstr("done"));
  EXPECT_THAT(logs("telefab-scan", "scan", job).output, HasSubstr("submit " + job));
  const Outcome unknown = logs("telefab-fab", "fab", "j0-9");
  EXPECT_NE(unknown.code, 0);
  EXPECT_THAT(unknown.errors, HasSubstr("j0-9"));
}

}  // namespace
}  // namespace telefab::test
