// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <telefab/test/two_sites.hpp>

#include "cutting_proxy.hpp"

namespace telefab::test {
namespace {

class Cut : public TwoSites {};

TEST_F(Cut, LinesDeliverTheSameChunksAndKeepWhatWasAcknowledged) {
  constexpr int kCuts = 30;
  start_fab();
  const CuttingProxy proxy{fab_port(), 17, kCuts, 6000};
  set_way_to_fab("127.0.0.1:" + proxy.port());
  start_scan();
  const Outcome done = telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--layer-mm", "0.2",
                                "--coding", "exact", "--watch", "--json"});
  ASSERT_EQ(done.code, 0) << done.errors;
  const auto job = nlohmann::json::parse(done.output);
  EXPECT_GE(proxy.cuts_made(), 3);
  // Both sites keep their chunks in the same form: the fab's are the scan site's, byte for byte.
  const std::string id = job["id"];
  const std::string sent = text_of(folder() / "scan" / "jobs" / id / "chunks");
  EXPECT_EQ(sent, text_of(folder() / "fab" / "jobs" / id / "chunks"));
  EXPECT_FALSE(sent.empty());
  RecordProperty("cuts", proxy.cuts_made());
  RecordProperty("wire_bytes", job["wire_bytes"].dump());
}

}  // namespace
}  // namespace telefab::test
