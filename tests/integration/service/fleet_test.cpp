// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <telefab/fab/daemon/serve_fab_site.hpp>
#include <telefab/net/connection.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/test/two_sites.hpp>
#include <telefab/transfer/chunk_spool.hpp>
#include <thread>

// A fab in a fleet, whose queue the test plays: what it claims, binds, lights and reports.

namespace telefab::test {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
namespace fs = std::filesystem;

/// What the queue knows, and what was asked of it. All of it guarded by `mutex`.
struct Fleet {
  std::mutex mutex;
  bool is_away = false;
  bool binds = true;  ///< false: bind() is not answered, as by a database that hangs
  fleet::State state = fleet::State::Waiting;
  std::uint32_t attempt = 0;
  std::vector<fleet::Machine> machines;
  int claims = 0, renewals = 0, bindings = 0, releases = 0, ends = 0;
};

/// A queue with one job, "part".
class PlayedQueue final : public FleetQueue {
 public:
  explicit PlayedQueue(Fleet& fleet) : fleet_{fleet} {}
  Result<void> announce(const fleet::Fab&, std::span<const fleet::Machine> machines) override {
    return on<void>([&]() -> Result<void> {
      fleet_.machines.assign(machines.begin(), machines.end());
      return {};
    });
  }
  Result<std::vector<fleet::Fab>> fabs() override { return std::vector<fleet::Fab>{}; }
  Result<std::vector<fleet::Machine>> machines() override { return std::vector<fleet::Machine>{}; }
  Result<void> drain(std::string_view, bool, std::string_view) override { return {}; }
  Result<std::vector<fleet::Job>> submit(const fleet::NewJob&) override { return std::vector<fleet::Job>{}; }
  Result<std::vector<fleet::Job>> jobs(std::span<const fleet::State>, std::uint64_t, std::size_t) override {
    return std::vector<fleet::Job>{};
  }
  Result<fleet::Job> find(std::string_view) override {
    return on<fleet::Job>([&]() -> Result<fleet::Job> {
      fleet::Job job;
      job.id = "part";
      job.state = fleet_.state;
      job.attempt = fleet_.attempt;
      return job;
    });
  }
  Result<fleet::Job> cancel(std::string_view job, std::string_view) override { return find(job); }
  using FleetQueue::claim;
  Result<std::optional<fleet::Lease>> claim(std::span<const std::string> machines, Nanoseconds) override {
    return on<std::optional<fleet::Lease>>([&]() -> Result<std::optional<fleet::Lease>> {
      if (fleet_.state != fleet::State::Waiting) return std::optional<fleet::Lease>{};
      ++fleet_.claims;
      fleet_.state = fleet::State::Claimed;
      return fleet::Lease{"part", machines.front(), ++fleet_.attempt, 30'000, false};
    });
  }
  Result<std::optional<fleet::Lease>> renew(std::string_view job, std::uint32_t attempt, Nanoseconds) override {
    return on<std::optional<fleet::Lease>>([&]() -> Result<std::optional<fleet::Lease>> {
      ++fleet_.renewals;
      if (!is_own(attempt)) return std::optional<fleet::Lease>{};
      return fleet::Lease{std::string{job}, "fab-toy", attempt, 30'000, fleet_.state == fleet::State::Bound};
    });
  }
  Result<bool> bind(std::string_view, std::uint32_t attempt) override {
    return on<bool>([&]() -> Result<bool> {
      if (!fleet_.binds) return fail(ErrorCode::Unreachable, "the database hangs");
      if (!is_own(attempt)) return false;
      ++fleet_.bindings;
      fleet_.state = fleet::State::Bound;
      return true;
    });
  }
  Result<bool> release(std::string_view, std::uint32_t, std::string_view) override {
    return on<bool>([&]() -> Result<bool> {
      ++fleet_.releases;
      return true;
    });
  }
  Result<bool> finish(std::string_view, std::uint32_t attempt, fleet::State state, std::string_view) override {
    return on<bool>([&]() -> Result<bool> {
      ++fleet_.ends;
      if (!is_own(attempt)) return false;
      fleet_.state = state;
      return true;
    });
  }
  Result<std::vector<fleet::Lease>> leases_of(std::string_view machine) override {
    return on<std::vector<fleet::Lease>>([&]() -> Result<std::vector<fleet::Lease>> {
      std::vector<fleet::Lease> own;
      if (is_own(fleet_.attempt))
        own.push_back({"part", std::string{machine}, fleet_.attempt, 30'000, fleet_.state == fleet::State::Bound});
      return own;
    });
  }
  Result<std::size_t> expire() override { return std::size_t{0}; }
  Result<fleet::Job> decide(std::string_view job, fleet::State, std::string_view) override { return find(job); }
  Result<void> add_event(std::string_view, const fleet::Event&) override { return {}; }
  Result<std::vector<fleet::Event>> events(std::uint64_t, std::size_t) override { return std::vector<fleet::Event>{}; }
  Result<std::vector<fleet::Event>> newest_events(std::size_t) override { return std::vector<fleet::Event>{}; }
  Result<bool> wait(Nanoseconds) override {
    std::this_thread::sleep_for(5ms);
    return on<bool>([]() -> Result<bool> { return true; });
  }
  Result<std::int64_t> now_unix_ms() override { return 0; }

 private:
  template <class Value, class Work>
  Result<Value> on(const Work& work) {
    const std::lock_guard lock{fleet_.mutex};
    if (fleet_.is_away) return fail(ErrorCode::Unreachable, "the database is away");
    return work();
  }
  [[nodiscard]] bool is_own(std::uint32_t attempt) const {
    return attempt == fleet_.attempt && (fleet_.state == fleet::State::Claimed || fleet_.state == fleet::State::Bound);
  }
  Fleet& fleet_;
};

/// Brings a stack that a scan site has cut to the fab as any attempt of the job, unsigned as on loopback.
class Bringer {
 public:
  Bringer(const fs::path& cut, const std::string& fab, std::uint32_t attempt)
      : offer_{saved_offer(cut).value()}, spool_{ChunkSpool::look_into(cut / "chunks").value()} {
    offer_.job = id_of_attempt("part", attempt);
    offer_.attempt = attempt;
    offer_.public_key.clear(), offer_.signature.clear();
    net::connect_to(loop_, {net::endpoint_from_text(fab).value(), nullptr, net::Role::FabSite, {}},
                    [this](Result<net::ConnectionPtr> made) {
                      ASSERT_TRUE(made) << made.error().what;
                      connection_ = *made;
                      connection_->start({[this](const Frame& frame) { on_frame(frame); }, {}, [](const Error&) {}});
                      send(Hello{kProtocolVersion, Side::ScanSite, "bringer", {}, {}});
                    });
  }
  ~Bringer() {
    if (connection_) connection_->close({});
  }
  template <class Condition>
  bool await(Condition condition, int tries = 4000) {
    for (; tries > 0 && !condition(); --tries) loop_.run_for(5ms);
    return condition();
  }
  std::string fault;
  int deferrals = 0, chunks = 0;
  std::optional<Job> job;

 private:
  void send(const Message& message) { EXPECT_TRUE(connection_->send(to_frame(message))); }
  void on_frame(const Frame& frame) {
    const auto message = from_frame(frame);
    ASSERT_TRUE(message) << message.error().what;
    if (std::holds_alternative<Hello>(*message)) {
      connection_->set_ready();
      send(offer_);
    } else if (const auto* refused = std::get_if<Fault>(&*message)) {
      fault = refused->error.what;
    } else if (std::holds_alternative<OfferDeferred>(*message)) {
      ++deferrals;
      loop_.after(50ms, [this] { send(offer_); });
    } else if (const auto* taken = std::get_if<OfferAccepted>(&*message); taken && !taken->complete) {
      for (std::uint32_t each = taken->next_sequence; each < spool_.chunk_count(); ++each, ++chunks) {
        auto chunk = spool_.read(each).value();
        send(SendChunk{offer_.job, each, chunk.first_layer, chunk.layer_count, std::move(chunk.payload), chunk.chain});
      }
      send(StackEnd{offer_.job, spool_.chunk_count(), spool_.chain(), spool_.finished().value(), {}});
    } else if (const auto* change = std::get_if<JobChanged>(&*message)) {
      job = change->job;
    }
  }
  Offer offer_;
  ChunkSpool spool_;
  net::Loop loop_;
  net::ConnectionPtr connection_;
};

class FleetOfOneFab : public TwoSites {
 protected:
  void SetUp() override {
    set_way_to_fab("127.0.0.1:9");  // it cuts, and nobody takes it
    start_scan();
    const std::string job = submit_torus();
    cut_ = folder() / "scan" / "jobs" / job;
    std::error_code none_yet;
    ASSERT_TRUE(await([&] {
      const auto spool = fs::exists(cut_ / "chunks", none_yet) ? ChunkSpool::look_into(cut_ / "chunks")
                                                               : Result<ChunkSpool>{fail(ErrorCode::NotFound, "")};
      return spool && spool->finished();
    }));
    kill_scan();
  }
  void TearDown() override { stop_fab(); }
  void begin_fab() {
    fab::FabSiteConfig config;
    config.serve.listen = "127.0.0.1:0";
    config.serve.data = (folder() / "fab").string();
    config.serve.machines = (folder() / "machines").string();
    config.serve.log_level = "warning";
    config.serve.retry_every = 50ms;
    config.fleet.name = "fab";
    if (queue_.empty())
      config.fleet.open = [this](const Clock&) -> Result<std::unique_ptr<FleetQueue>> {
        return std::make_unique<PlayedQueue>(fleet);
      };
    config.fleet.where = queue_;
    fs::remove(folder() / "fab" / "port");
    thread_ = std::jthread{[config](const std::stop_token& stop) {
      const SystemClock clock;
      const auto served = fab::serve_fab_site(config, clock, stop);
      EXPECT_TRUE(served) << served.error().what;
    }};
    ASSERT_TRUE(await([&] { return text_of(folder() / "fab" / "port").ends_with('\n'); }));
    address_ = text_of(folder() / "fab" / "port");
    address_ = "127.0.0.1:" + address_.substr(0, address_.size() - 1);
  }
  void stop_fab() { thread_ = {}; }
  [[nodiscard]] std::unique_ptr<Bringer> bring(std::uint32_t attempt) const {
    return std::make_unique<Bringer>(cut_, address_, attempt);
  }
  [[nodiscard]] std::string journal(std::uint32_t attempt) const {
    const auto path = folder() / "fab" / "jobs" / id_of_attempt("part", attempt) / "journal";
    std::error_code none;
    return fs::exists(path, none) ? text_of(path) : std::string{};
  }
  template <class Look>
  auto of_fleet(Look look) {
    const std::lock_guard lock{fleet.mutex};
    return look(fleet);
  }
  template <class Condition>
  static bool await(Condition condition) {
    for (int tries = 0; tries < 4000; ++tries, std::this_thread::sleep_for(5ms))
      if (condition()) return true;
    return condition();
  }

  Fleet fleet;

 protected:
  std::string queue_;  ///< empty: the played one

 private:
  fs::path cut_;
  std::string address_;
  std::jthread thread_;
};

constexpr const char* kExposing = "\"exposing\"";

TEST_F(FleetOfOneFab, PrintsTheJobThatItClaimedAndReportsItsEnd) {
  begin_fab();
  const auto bringer = bring(1);
  ASSERT_TRUE(bringer->await([&] { return of_fleet([](Fleet& f) { return f.state == fleet::State::Done; }); }))
      << bringer->fault << (bringer->job ? bringer->job->message : "");
  EXPECT_EQ(of_fleet([](Fleet& f) { return f.claims; }), 1);
  EXPECT_EQ(of_fleet([](Fleet& f) { return f.bindings; }), 1);
  EXPECT_THAT(journal(1), HasSubstr("\"attempt\":1"));
  const auto machines = of_fleet([](Fleet& f) { return f.machines; });
  ASSERT_EQ(machines.size(), 1U);
  EXPECT_EQ(machines.front().name, "fab-toy");
  EXPECT_EQ(machines.front().light.size(), 64U);
}

TEST_F(FleetOfOneFab, LightsNothingBeforeTheQueueHasBoundItAndGoesOnOnceItHas) {
  of_fleet([](Fleet& f) { return f.binds = false; });
  begin_fab();
  const auto bringer = bring(1);
  ASSERT_TRUE(bringer->await([&] { return journal(1).find("\"ready\"") != std::string::npos; }));
  (void)bringer->await([] { return false; }, 300);
  EXPECT_EQ(journal(1).find(kExposing), std::string::npos) << "a layer was announced without a binding";
  of_fleet([](Fleet& f) { return f.binds = true; });
  ASSERT_TRUE(bringer->await([&] { return of_fleet([](Fleet& f) { return f.state == fleet::State::Done; }); }))
      << (bringer->job ? bringer->job->message : "");
}

TEST_F(FleetOfOneFab, PrintsOnWhileTheQueueIsAwayOnceItIsBoundAndReportsTheEndLater) {
  begin_fab();
  const auto bringer = bring(1);
  ASSERT_TRUE(bringer->await([&] { return of_fleet([](Fleet& f) { return f.bindings == 1; }); }));
  of_fleet([](Fleet& f) { return f.is_away = true; });
  ASSERT_TRUE(bringer->await([&] { return bringer->job && bringer->job->state == JobState::Done; }))
      << (bringer->job ? bringer->job->message : "");
  stop_fab();  // the end is known over a restart
  begin_fab();
  of_fleet([](Fleet& f) { return f.is_away = false; });
  EXPECT_TRUE(await([&] { return of_fleet([](Fleet& f) { return f.state == fleet::State::Done; }); }));
}

TEST_F(FleetOfOneFab, PutsOffAnAttemptItHasNoLeaseOfAndRefusesAnOlderOne) {
  of_fleet([](Fleet& f) {
    f.attempt = 4;  // the next claim is the fifth
    return 0;
  });
  begin_fab();
  ASSERT_TRUE(await([&] { return fs::exists(folder() / "fab" / "fleet" / "part.json"); }));
  const auto early = bring(6);
  EXPECT_TRUE(early->await([&] { return early->deferrals > 1; })) << early->fault;
  const auto late = bring(4);
  EXPECT_TRUE(late->await([&] { return !late->fault.empty(); }));
  EXPECT_THAT(late->fault, HasSubstr("attempt 4 of job part is over"));
  EXPECT_EQ(late->chunks, 0);
}

TEST_F(FleetOfOneFab, TakesTheLayersOfAnEarlierAttemptOverInsteadOfHavingThemSentAgain) {
  begin_fab();
  const auto first = bring(1);
  ASSERT_TRUE(first->await([&] { return of_fleet([](Fleet& f) { return f.state == fleet::State::Done; }); }));
  EXPECT_GT(first->chunks, 0);
  of_fleet([](Fleet& f) { return f.state = fleet::State::Waiting; });  // somebody has it made again
  const auto second = bring(2);
  ASSERT_TRUE(second->await([&] { return of_fleet([](Fleet& f) { return f.state == fleet::State::Done; }); }))
      << second->fault << (second->job ? second->job->message : "");
  EXPECT_EQ(second->chunks, 0);
  EXPECT_EQ(of_fleet([](Fleet& f) { return f.bindings; }), 2);
  EXPECT_THAT(journal(2), HasSubstr("\"attempt\":2"));
}

TEST_F(FleetOfOneFab, PrintsAJobOfAQueueInAFile) {
  queue_ = fmt::format("sqlite:{}", (folder() / "fleet.sqlite").string());
  const SystemClock clock;
  const auto queue = open_fleet(queue_, clock);
  ASSERT_TRUE(queue) << queue.error().what;
  fleet::NewJob part;
  part.id = "part";
  part.name = "torus.xyz";
  part.owner = "ana";
  part.site = "local";
  part.needs.machine = "toy";
  ASSERT_TRUE((*queue)->submit(part));
  begin_fab();
  const auto bringer = bring(1);
  ASSERT_TRUE(bringer->await([&] { return (*queue)->find("part").value().state == fleet::State::Done; }))
      << (*queue)->find("part")->message << bringer->fault;
  EXPECT_EQ((*queue)->find("part")->machine, "fab-toy");
  const auto machines = (*queue)->machines();
  ASSERT_TRUE(machines);
  ASSERT_EQ(machines->size(), 1U);
  EXPECT_EQ(machines->front().profile, "toy");
}

TEST_F(FleetOfOneFab, LightsNothingOfAnAttemptThatTheFleetGaveAwayBeforeItsFirstLight) {
  of_fleet([](Fleet& f) { return f.binds = false; });
  begin_fab();
  const auto bringer = bring(1);
  ASSERT_TRUE(bringer->await([&] { return journal(1).find("\"ready\"") != std::string::npos; }));
  of_fleet([](Fleet& f) {
    f.attempt = 2;  // another fab has it
    f.state = fleet::State::Bound;
    f.binds = true;
    return 0;
  });
  ASSERT_TRUE(bringer->await([&] { return bringer->job && is_final(bringer->job->state); }))
      << (bringer->job ? bringer->job->message : "");
  EXPECT_EQ(bringer->job->state, JobState::Cancelled);
  EXPECT_EQ(journal(1).find(kExposing), std::string::npos);
  EXPECT_EQ(of_fleet([](Fleet& f) { return f.ends + f.releases; }), 0) << "it is no longer this fab's to end";
}

}  // namespace
}  // namespace telefab::test
