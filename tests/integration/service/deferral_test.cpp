// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <telefab/net/listener.hpp>
#include <telefab/service/client_session.hpp>
#include <telefab/test/two_sites.hpp>
#include <telefab/wire/message.hpp>

// What a scan site does with the answer "later".

namespace telefab::test {
namespace {

using std::chrono::milliseconds;
using testing::HasSubstr;

/// A fab that takes no job: it answers offers as it is told to.
class PuttingOffFab {
 public:
  explicit PuttingOffFab(std::string machine_toml, std::uint32_t protocol = kProtocolVersion)
      : machine_toml_{std::move(machine_toml)}, protocol_{protocol} {
    listener_ = net::Listener::open(loop_, {net::endpoint_from_text("127.0.0.1:0").value(), nullptr, {}},
                                    {[this](const net::ConnectionPtr& connection) { on_connection(connection); },
                                     [](const std::string&, const Error&) {}})
                    .value();
  }
  [[nodiscard]] std::string address() const { return fmt::format("127.0.0.1:{}", listener_->port()); }
  template <class Condition>
  bool await(Condition condition) {
    for (int tries = 0; tries < 2000 && !condition(); ++tries) loop_.run_for(milliseconds{5});
    return condition();
  }
  void run_for(milliseconds duration) { loop_.run_for(duration); }
  void send(const Message& message) { EXPECT_TRUE(connection_->send(to_frame(message))); }
  void hang_up() { connection_->close({}); }

  int connections = 0;
  int offers = 0;  ///< on the present connection
  int cancels = 0;
  std::string job;

 private:
  void on_connection(const net::ConnectionPtr& connection) {
    const std::weak_ptr<net::Connection> weak = connection;
    handshake(
        loop_, connection, {protocol_, Side::FabSite, "putting off", {machine_toml_}, "automatic"},
        [this, weak](const Hello& theirs) {
          if (theirs.side != Side::ScanSite) return;
          connection_ = weak.lock();
          ++connections;
          offers = 0;
          connection_->set_events({[this](const Frame& frame) { on_frame(frame); }, {}, [](const Error&) {}});
        },
        [](const Error&) {});
  }
  void on_frame(const Frame& frame) {
    const auto message = from_frame(frame);
    ASSERT_TRUE(message) << message.error().what;
    if (const auto* command = std::get_if<Command>(&*message)) cancels += command->command == JobCommand::Cancel;
    const auto* offer = std::get_if<Offer>(&*message);
    if (!offer) return;
    ++offers;
    job = offer->job;
  }
  std::string machine_toml_;
  std::uint32_t protocol_;
  net::Loop loop_;
  std::unique_ptr<net::Listener> listener_;
  net::ConnectionPtr connection_;
};

class Deferral : public TwoSites {
 protected:
  void SetUp() override {
    fab = std::make_unique<PuttingOffFab>(text_of(folder() / "machines" / "toy.toml"));
    set_way_to_fab(fab->address());
    start_scan();
    job = submit_torus();
    ASSERT_TRUE(fab->await([&] { return fab->offers == 1; }));
    ASSERT_EQ(fab->job, job);
  }
  /// What the scan site says of the job, once it says so.
  [[nodiscard]] std::string listed(const std::string& mark) {
    std::string jobs;
    for (int tries = 0; tries < 200 && jobs.find(mark) == std::string::npos; ++tries) {
      fab->run_for(milliseconds{20});
      jobs = telefab({"jobs"}).output;
    }
    return jobs;
  }
  std::unique_ptr<PuttingOffFab> fab;
  std::string job;
};

TEST_F(Deferral, KeepsTheJobQueuedAndOffersItAgainAtTheStatedTime) {
  fab->send(OfferDeferred{job, DeferReason::Busy, milliseconds{400}, "the fab is busy: it has 256 jobs"});
  EXPECT_THAT(listed("waits: the fab is busy"), HasSubstr("it has 256 jobs"));
  ASSERT_TRUE(fab->await([&] { return fab->offers == 2; }));
  EXPECT_EQ(fab->connections, 1) << "the line is as good as before";
  fab->send(OfferDeferred{job, DeferReason::Full, milliseconds{50}, "the fab is full: 0 MiB of disk are free"});
  EXPECT_THAT(listed("waits: the fab is full"), HasSubstr("0 MiB"));
  ASSERT_TRUE(fab->await([&] { return fab->offers == 3; }));
  fab->send(OfferAccepted{job, 0, false});
  EXPECT_THAT(listed("sending"), testing::Not(HasSubstr("waits")));
}

// Two offers under way are answered twice, the second answer has the chunks sent again, and a fab ends such a job.
TEST_F(Deferral, OffersAJobOnceOnANewConnectionHoweverManyTimesItWasPutOff) {
  fab->send(OfferDeferred{job, DeferReason::Full, milliseconds{600}, "the fab is full"});
  fab->run_for(milliseconds{50});
  fab->hang_up();
  ASSERT_TRUE(fab->await([&] { return fab->connections == 2 && fab->offers == 1; }));
  fab->run_for(milliseconds{900});  // the stated time passes while the offer is not answered yet
  EXPECT_EQ(fab->offers, 1);
}

TEST_F(Deferral, IsNotARefusal) {
  fab->send(Fault{{}, {ErrorCode::TooLarge, "the disk of 2 MiB is too small"}, job});
  EXPECT_THAT(listed("failed"), HasSubstr("the fab refused it: the disk of 2 MiB is too small"));
  fab->run_for(milliseconds{300});
  EXPECT_EQ(fab->offers, 1) << "never is not later";
}

// It was called a refusal of the fab's, and the fab waited for its chunks for good.
TEST_F(Deferral, LayersThatWereChangedOnDiskEndTheJobAtBothSites) {
  const auto chunks = folder() / "scan" / "jobs" / job / "chunks";
  std::error_code none_yet;
  ASSERT_TRUE(fab->await([&] { return std::filesystem::file_size(chunks, none_yet) > 200 && !none_yet; }));
  std::fstream file{chunks, std::ios::in | std::ios::out | std::ios::binary};
  file.seekp(100);
  file.put('\xff');
  file.close();
  fab->send(OfferAccepted{job, 0, false});
  const std::string jobs = listed("failed");
  EXPECT_THAT(jobs, HasSubstr("chunk 0 of"));
  EXPECT_THAT(jobs, HasSubstr("submit the scan again"));
  EXPECT_THAT(jobs, testing::Not(HasSubstr("the fab refused it")));
  EXPECT_TRUE(fab->await([&] { return fab->cancels == 1; }));
}

/// A fab of the release before, which knows no OfferDeferred.
class OlderFab : public TwoSites {};

TEST_F(OlderFab, IsRefusedByNameBeforeAJobIsOfferedToIt) {
  PuttingOffFab fab{text_of(folder() / "machines" / "toy.toml"), kProtocolVersion - 1};
  set_way_to_fab(fab.address());
  start_scan();
  const std::string job = submit_torus();
  fab.run_for(milliseconds{300});
  EXPECT_THAT(
      scan().wait_for_error_line("protocol-version"),
      HasSubstr(fmt::format("this side speaks version {}, the fab {}", kProtocolVersion, kProtocolVersion - 1)));
  EXPECT_EQ(fab.offers, 0);
}

}  // namespace
}  // namespace telefab::test
