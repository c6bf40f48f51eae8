// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <telefab/fab/web/router.hpp>
#include <telefab/test/http_client.hpp>
#include <telefab/test/recording_backend.hpp>

namespace telefab::fab {
namespace {

using std::chrono::hours;
using std::chrono::seconds;
using test::HttpClient;
using testing::HasSubstr;

/// Advanced by the test's thread and read by the page's.
class SharedClock final : public Clock {
 public:
  [[nodiscard]] Nanoseconds now() const override { return Nanoseconds{now_.load()}; }
  [[nodiscard]] Nanoseconds wall() const override { return now(); }
  void sleep_for(Nanoseconds duration) override { advance(duration); }
  void advance(Nanoseconds duration) { now_ += duration.count(); }

 private:
  std::atomic<Nanoseconds::rep> now_{Nanoseconds{hours{1}}.count()};
};

/// News comes when the test says so; as large as it says.
class NewsBackend final : public RecordingBackend {
 public:
  [[nodiscard]] Result<std::vector<JobView>> jobs() override {
    auto jobs = RecordingBackend::jobs();
    jobs->front().message = std::to_string(revision_) + std::string(size, 'x');
    return jobs;
  }
  [[nodiscard]] std::uint64_t revision() override { return revision_; }
  void change() { ++revision_; }
  std::atomic<std::size_t> size{0};

 private:
  std::atomic<std::uint64_t> revision_{1};
};

class PageSoak : public testing::Test {
 protected:
  static WebAddress address() {
    WebAddress address{"127.0.0.1"};
    address.look_every = std::chrono::microseconds{100};
    return address;
  }
  std::unique_ptr<HttpClient> watcher() const {
    auto made = std::make_unique<HttpClient>(server->port());
    made->send("GET /v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
    EXPECT_THAT(made->read_until("job-1"), HasSubstr("event-stream"));
    return made;
  }

  SharedClock clock;
  NewsBackend backend;
  SignIn sign_in{{}, clock};
  FabWeb site{backend, sign_in, {}};
  std::unique_ptr<WebServer> server = WebServer::listen(address(), site, "telefab-fab/0", clock).value();
};

TEST_F(PageSoak, AnIdleStreamIsKeptAliveEveryFifteenSecondsForEightHours) {
  const auto watching = watcher();
  for (int i = 0; i < 8 * 240; ++i) {
    clock.advance(seconds{15});
    ASSERT_THAT(watching->read_until("still here\n\n"), HasSubstr("still here")) << "after " << i << " times 15 s";
  }
  backend.change();
  EXPECT_THAT(watching->read_until("\"message\":\"2\""), HasSubstr("data: "));
}

TEST_F(PageSoak, AStreamCarriesALayerEveryTenSecondsForEightHours) {
  const auto watching = watcher();
  for (int i = 0; i < 8 * 360; ++i) {
    clock.advance(seconds{10});
    backend.change();
    const std::string wanted = "\"message\":\"" + std::to_string(i + 2) + "\"";
    ASSERT_THAT(watching->read_until(wanted), HasSubstr(wanted));
  }
}

TEST_F(PageSoak, AWatcherThatStopsReadingIsLetGoAndTheOthersAreNot) {
  const auto watching = watcher();
  const auto deaf = watcher();
  backend.size = 60'000;
  // Until its socket is full, and then for as long as a write may take; the other one reads on.
  for (int i = 0; i < 600; ++i) {
    clock.advance(seconds{6});
    backend.change();
    const std::string wanted = "\"message\":\"" + std::to_string(i + 2) + "x";
    ASSERT_THAT(watching->read_until(wanted), HasSubstr(wanted)) << i;
    (void)watching->read_until("\n\n");
  }
  // What was on its way is there; behind it the stream has ended long before the newest event.
  EXPECT_THAT(deaf->read_until(""), testing::Not(HasSubstr("\"message\":\"601x")));
}

}  // namespace
}  // namespace telefab::fab
