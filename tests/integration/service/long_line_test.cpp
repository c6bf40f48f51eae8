// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <set>
#include <telefab/net/listener.hpp>
#include <telefab/test/two_sites.hpp>
#include <telefab/wire/message.hpp>

namespace telefab::test {
namespace {

using std::chrono::milliseconds;

/// A scan site that offers jobs on one connection and never sends a layer.
class OfferingSite {
 public:
  explicit OfferingSite(const std::string& fab) {
    net::connect_to(
        loop_, {net::endpoint_from_text(fab).value(), nullptr, {}, {}}, [this](Result<net::ConnectionPtr> made) {
          if (!made) return;
          connection_ = *made;
          connection_->start(
              {[this](const Frame& frame) { on_frame(frame); }, {}, [this](const Error& why) { fault = why.what; }});
          connection_->set_ready();
          send(Hello{kProtocolVersion, Side::ScanSite, "offering", {}, {}});
        });
    await([&] { return is_ready; });
  }
  void send(const Message& message) {
    if (const auto sent = connection_->send(to_frame(message)); !sent && fault.empty()) fault = sent.error().what;
  }
  template <class Condition>
  void await(Condition condition) {
    for (int tries = 0; tries < 4000 && !condition(); ++tries) loop_.run_for(milliseconds{5});
  }

  bool is_ready = false;
  std::set<std::string> accepted, over;
  std::map<std::string, OfferDeferred> deferred;
  std::string fault;

 private:
  void on_frame(const Frame& frame) {
    const auto message = from_frame(frame);
    ASSERT_TRUE(message) << message.error().what;
    if (std::holds_alternative<Hello>(*message)) is_ready = true;
    if (const auto* taken = std::get_if<OfferAccepted>(&*message)) accepted.insert(taken->job);
    if (const auto* changed = std::get_if<JobChanged>(&*message); changed && is_final(changed->job.state))
      over.insert(changed->job.id);
    if (const auto* later = std::get_if<OfferDeferred>(&*message)) deferred[later->job] = *later;
    if (const auto* refused = std::get_if<Fault>(&*message)) fault = refused->error.what;
  }
  net::Loop loop_;
  net::ConnectionPtr connection_;
};

class LongLine : public TwoSites {
 protected:
  /// The offer of a job that the fab has printed, unsigned, for jobs like it.
  [[nodiscard]] Offer recorded_offer() const {
    const std::string job = submit_torus();
    EXPECT_EQ(telefab({"watch", job}).code, 0);
    FrameReader reader;
    const std::string recorded = text_of(folder() / "fab" / "jobs" / job / "offer");
    reader.feed(std::as_bytes(std::span{recorded}));
    Offer offer = std::get<Offer>(from_frame(reader.take().value().value()).value());
    offer.public_key.clear();
    offer.signature.clear();
    return offer;
  }
};

// The 257th job of a connection once failed for good, however many of those before were over.
TEST_F(LongLine, CarriesAnyNumberOfJobsOneAfterTheOther) {
  start_fab();  // nobody reads its log meanwhile: the pipe is soon full, and the fab must not wait for room in it
  start_scan();
  Offer offer = recorded_offer();
  constexpr std::size_t kBatches = 3, kJobs = 100;
  OfferingSite site{fab_site()};
  ASSERT_TRUE(site.is_ready) << site.fault;
  for (std::size_t batch = 0; batch < kBatches && site.fault.empty(); ++batch) {
    for (std::size_t i = 0; i < kJobs; ++i) {
      offer.job = fmt::format("joffered-{}", batch * kJobs + i);
      site.send(offer);
    }
    site.await([&] { return site.accepted.size() == (batch + 1) * kJobs || !site.fault.empty(); });
    for (std::size_t i = 0; i < kJobs; ++i)
      site.send(Command{{}, fmt::format("joffered-{}", batch * kJobs + i), JobCommand::Cancel, "ana", {}});
    site.await([&] { return site.over.size() == (batch + 1) * kJobs || !site.fault.empty(); });
  }
  EXPECT_EQ(site.fault, "");
  EXPECT_EQ(site.accepted.size(), kBatches * kJobs);
  EXPECT_EQ(site.over.size(), kBatches * kJobs);
}

// Such a job was once refused, and failed at the scan site.
TEST_F(LongLine, PutsOffAJobTooManyUntilOneIsOver) {
  start_fab({"--log-level", "warning"});
  start_scan();
  Offer offer = recorded_offer();
  constexpr std::size_t kJobs = 256;
  OfferingSite site{fab_site()};
  ASSERT_TRUE(site.is_ready) << site.fault;
  for (std::size_t i = 0; i <= kJobs; ++i) {
    offer.job = fmt::format("joffered-{}", i);
    site.send(offer);
  }
  site.await([&] { return !site.deferred.empty() || !site.fault.empty(); });
  ASSERT_TRUE(site.deferred.contains(offer.job)) << site.fault;
  EXPECT_EQ(site.accepted.size(), kJobs);
  EXPECT_EQ(site.deferred[offer.job].reason, DeferReason::Busy);
  EXPECT_GT(site.deferred[offer.job].retry_after.count(), 0);
  site.send(Command{{}, "joffered-7", JobCommand::Cancel, "ana", {}});
  site.await([&] { return site.over.contains("joffered-7"); });
  site.send(offer);
  site.await([&] { return site.accepted.contains(offer.job); });
  EXPECT_TRUE(site.accepted.contains(offer.job));
  EXPECT_EQ(site.fault, "");
}

// A scan site that never heard how its job ended offers it again; it is not printed twice because it was forgotten.
TEST_F(LongLine, RefusesAJobThatEndedAndWasForgotten) {
  start_fab({"--log-level", "warning"});
  start_scan();
  Offer offer = recorded_offer();
  OfferingSite site{fab_site()};
  offer.job = "joffered-1";
  site.send(offer);
  site.send(Command{{}, offer.job, JobCommand::Cancel, "ana", {}});
  site.await([&] { return site.over.contains(offer.job); });
  ASSERT_EQ(telefab({"forget", offer.job, "--site", fab_site()}).code, 0);
  site.send(offer);
  site.await([&] { return !site.fault.empty(); });
  EXPECT_THAT(site.fault, testing::HasSubstr("ended here as cancelled, and was forgotten"));
  EXPECT_FALSE(std::filesystem::exists(folder() / "fab" / "jobs" / offer.job));
}

}  // namespace
}  // namespace telefab::test
