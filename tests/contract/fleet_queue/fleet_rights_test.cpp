// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/store/fleet_queue.hpp>
#include <telefab/test/postgres_server.hpp>
#include <thread>

// What roles of a database may do in the queue of a fleet, as deploy/config/fleet-roles.sql has it: everybody his own.

namespace telefab {
namespace {

using namespace std::chrono_literals;
using fleet::State;
using testing::ElementsAre;
using testing::SizeIs;

class FleetRights : public testing::Test {
 protected:
  void SetUp() override {
    server_ = test::PostgresServer::start();
    if (!server_) GTEST_SKIP() << "no PostgreSQL 15 server on this computer";
    const std::string owner = server_->uri_of("fleet");
    ASSERT_TRUE(open_fleet_database(owner)) << "makes the tables";
    const char* source = std::getenv("TELEFAB_SOURCE");
    const auto file = std::filesystem::path{source ? source : "."} / "deploy/config/fleet-roles.sql";
    for (int times = 0; times < 2; ++times)
      ASSERT_TRUE(server_->carry_out("fleet", file)) << "again it changes nothing";
    for (const auto& [role, group] : {std::pair{"chicago", "submit"},
                                      {"boston", "submit"},
                                      {"la", "print"},
                                      {"sf", "print"},
                                      {"ana", "operate"},
                                      {"bo", "administer"}})
      ASSERT_TRUE(server_->carry_out("fleet", fmt::format("CREATE ROLE {} LOGIN IN ROLE telefab_{}", role, group)));
  }
  [[nodiscard]] std::unique_ptr<FleetQueue> as(const std::string& role) {
    return open_fleet_database(server_->uri_of("fleet", role)).value();
  }
  static fleet::Machine machine(const std::string& name) {
    fleet::Machine m;
    m.name = name, m.profile = "a", m.light = "l", m.resin = "grey";
    m.width_mm = m.depth_mm = m.height_mm = 100;
    return m;
  }
  static fleet::NewJob job(const std::string& id, const std::string& site) {
    fleet::NewJob j;
    j.id = id, j.name = id + ".ply", j.owner = "ana", j.site = site;
    return j;
  }
  std::unique_ptr<test::PostgresServer> server_;
};

TEST_F(FleetRights, LetAWholeJobThroughByTheRolesOfItsSites) {
  const auto chicago = as("chicago"), la = as("la");
  const std::array stands{machine("la-1")};
  auto announced = la->announce({"la", "la:7420", "", "{}"}, stands);
  ASSERT_TRUE(announced) << announced.error().what;
  const auto submitted = chicago->submit(job("vase", "chicago"));
  ASSERT_TRUE(submitted) << submitted.error().what;
  const auto lease = la->claim("la-1", 10s);
  ASSERT_TRUE(lease && *lease) << (lease ? "nothing" : lease.error().what);
  EXPECT_TRUE(*la->renew("vase", 1, 10s));
  EXPECT_TRUE(*la->bind("vase", 1));
  EXPECT_EQ(chicago->find("vase")->state, State::Bound);
  EXPECT_EQ(chicago->cancel("vase", "ana").error().code, ErrorCode::Conflict);
  const auto finished = la->finish("vase", 1, State::Done, "");
  ASSERT_TRUE(finished) << finished.error().what;
  EXPECT_EQ(chicago->find("vase")->state, State::Done);
  EXPECT_THAT(chicago->events(0, 100).value(), SizeIs(3)) << "submitted, attempt 1, done";
}

TEST_F(FleetRights, KeepTheJobsOfScanSitesApart) {
  const auto chicago = as("chicago"), boston = as("boston");
  ASSERT_TRUE(chicago->submit(job("vase", "chicago")));
  EXPECT_FALSE(boston->submit(job("cup", "chicago"))) << "in the name of another";
  EXPECT_EQ(boston->find("vase").error().code, ErrorCode::NotFound);
  EXPECT_THAT(boston->jobs({}, 0, 100).value(), SizeIs(0));
  EXPECT_THAT(boston->events(0, 100).value(), SizeIs(0));
  EXPECT_FALSE(boston->cancel("vase", "eve"));
  EXPECT_EQ(chicago->find("vase")->state, State::Waiting);
  const auto cancelled = chicago->cancel("vase", "ana");
  ASSERT_TRUE(cancelled) << cancelled.error().what;
  EXPECT_EQ(cancelled->state, State::Cancelled);
}

TEST_F(FleetRights, KeepTheMachinesAndLeasesOfFabsApart) {
  const auto la = as("la"), sf = as("sf"), chicago = as("chicago");
  const std::array stands{machine("la-1")}, other{machine("sf-1")};
  ASSERT_TRUE(la->announce({"la", "la:7420", "", "{}"}, stands));
  ASSERT_TRUE(sf->announce({"sf", "sf:7420", "", "{}"}, other));
  EXPECT_EQ(sf->announce({"la", "evil:7420", "", "{}"}, stands).error().code, ErrorCode::NotPermitted);
  EXPECT_EQ(chicago->announce({"la", "evil:7420", "", "{}"}, stands).error().code, ErrorCode::NotPermitted);
  EXPECT_EQ(la->fabs()->front().address, "la:7420");
  ASSERT_TRUE(chicago->submit(job("vase", "chicago")));
  EXPECT_FALSE(sf->claim("la-1", 10s)) << "a machine of another fab";
  ASSERT_TRUE(*la->claim("la-1", 10s));
  EXPECT_FALSE(*sf->renew("vase", 1, 10s));
  EXPECT_FALSE(*sf->bind("vase", 1));
  EXPECT_FALSE(*sf->release("vase", 1, ""));
  EXPECT_FALSE(*sf->finish("vase", 1, State::Done, ""));
  EXPECT_EQ(chicago->find("vase")->state, State::Claimed);
  EXPECT_EQ(sf->submit(job("cup", "sf")).error().code, ErrorCode::NotPermitted);
  EXPECT_EQ(la->drain("la-1", true, "la").error().code, ErrorCode::NotPermitted) << "an administrator's matter";
}

TEST_F(FleetRights, LetAnotherFabEndWhatAFabThatIsGoneLeftBehind) {
  const auto la = as("la"), sf = as("sf"), chicago = as("chicago");
  const std::array stands{machine("la-1")}, other{machine("sf-1")};
  ASSERT_TRUE(la->announce({"la", "la:7420", "", "{}"}, stands));
  ASSERT_TRUE(sf->announce({"sf", "sf:7420", "", "{}"}, other));
  ASSERT_TRUE(chicago->submit(job("vase", "chicago")));
  ASSERT_TRUE(*la->claim("la-1", 1ms));
  std::this_thread::sleep_for(20ms);
  const auto expired = sf->expire();
  ASSERT_TRUE(expired) << expired.error().what;
  EXPECT_EQ(*expired, 1U);
  EXPECT_TRUE(*sf->claim("sf-1", 10s));
  EXPECT_EQ(chicago->find("vase")->attempt, 2U);
}

TEST_F(FleetRights, LetOperatorsCancelAndAdministratorsDrainAndDecide) {
  const auto la = as("la"), chicago = as("chicago"), ana = as("ana"), bo = as("bo");
  const std::array stands{machine("la-1")};
  ASSERT_TRUE(la->announce({"la", "la:7420", "", "{}"}, stands));
  for (const char* id : {"vase", "cup"}) ASSERT_TRUE(chicago->submit(job(id, "chicago")));
  EXPECT_THAT(ana->jobs({}, 0, 100).value(), SizeIs(2));
  ASSERT_TRUE(ana->cancel("cup", "ana"));
  EXPECT_EQ(ana->drain("la-1", true, "ana").error().code, ErrorCode::NotPermitted);
  EXPECT_EQ(ana->submit(job("jug", "ana")).error().code, ErrorCode::NotPermitted);
  ASSERT_TRUE(*la->claim("la-1", 1ms));
  ASSERT_TRUE(*la->bind("vase", 1));
  std::this_thread::sleep_for(20ms);
  ASSERT_EQ(*la->expire(), 1U);
  EXPECT_FALSE(ana->decide("vase", State::Done, "ana"));
  auto drained = bo->drain("la-1", true, "bo");
  EXPECT_TRUE(drained) << drained.error().what;
  const auto decided = bo->decide("vase", State::Failed, "bo");
  ASSERT_TRUE(decided) << decided.error().what;
  EXPECT_EQ(chicago->find("vase")->state, State::Failed);
  EXPECT_TRUE(la->machines()->front().is_draining);
}

}  // namespace
}  // namespace telefab
