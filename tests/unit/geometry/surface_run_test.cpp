// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/geometry/layer.hpp>

namespace telefab {
namespace {

constexpr SurfaceRun kSeen{SurfaceClass::Measured};
constexpr SurfaceRun kGap{SurfaceClass::Completed, 1, 2, 0.5};
constexpr SurfaceRun kWiderGap{SurfaceClass::Completed, 1, 3, 0.25};
constexpr SurfaceRun kDoubtful{SurfaceClass::Doubtful};

Contour square() { return Contour::from_vertices({{1, 1}, {2, 1}, {2, 3}, {1, 3}}).value(); }

Layer layer_of(Contour contour) {
  Layer layer;
  layer.index = LayerIndex{0};
  layer.z_mm = cut_height_mm(layer.index, 0.1);
  layer.contours = {std::move(contour)};
  return layer;
}

StackHeader header() {
  StackHeader h;
  h.machine = "m";
  h.layer_thickness_mm = 0.1;
  h.pixel_pitch_mm = 0.05;
  h.layer_count = 1;
  h.bounds = {{0, 0}, {10, 10}};
  return h;
}

TEST(SurfaceRuns, OfOneClassBecomeOneWithTheLargerGapAndError) {
  const Contour with_runs_made = square().with_runs(std::vector{kSeen, kGap, kWiderGap, kSeen}).value();
  ASSERT_EQ(with_runs_made.runs().size(), 3U);
  EXPECT_EQ(with_runs_made.runs()[1], (SurfaceRun{SurfaceClass::Completed, 2, 3, 0.5}));
}

TEST(SurfaceRuns, AreNoneWhereAllIsMeasured) {
  EXPECT_TRUE(square().with_runs(std::vector(4, kSeen)).value().runs().empty());
  EXPECT_EQ(square().with_runs(std::vector(4, kSeen)).value(), square());
}

TEST(SurfaceRuns, MustAccountForEveryEdgeOnce) {
  EXPECT_FALSE(square().with_runs(std::vector(3, kGap)));
  EXPECT_FALSE(square().with_runs(std::vector(5, kGap)));
  EXPECT_TRUE(square().with_runs(std::vector(4, kGap)));
}

TEST(SurfaceRuns, RefuseLengthsThatAreNone) {
  for (const double bad : {-1.0, std::numeric_limits<double>::quiet_NaN(), 1e9}) {
    EXPECT_FALSE(square().with_runs(std::vector(4, SurfaceRun{SurfaceClass::Completed, 1, bad, 0}))) << bad;
    EXPECT_FALSE(square().with_runs(std::vector(4, SurfaceRun{SurfaceClass::Completed, 1, 0, bad}))) << bad;
  }
  EXPECT_FALSE(square().with_runs(std::vector{kSeen, kGap, SurfaceRun{SurfaceClass::Measured, 2, 1, 0}}));
}

TEST(SurfaceRuns, TurnWithTheirRing) {
  // The same square from another corner: the edge from (2, 3) to (1, 3) stays the completed one.
  const Contour turned = Contour::from_vertices({{2, 3}, {1, 3}, {1, 1}, {2, 1}}).value();
  const auto sorted = sorted_canonically({turned.with_runs(std::vector{kGap, kSeen, kSeen, kSeen}).value()});
  EXPECT_EQ(sorted[0], square().with_runs(std::vector{kSeen, kSeen, kGap, kSeen}).value());
}

TEST(SurfaceShares, AddUpTheLengthsByClass) {
  const Layer layer = layer_of(square().with_runs(std::vector{kSeen, kGap, kWiderGap, kDoubtful}).value());
  const SurfaceShares shares = surface_shares(layer);
  EXPECT_DOUBLE_EQ(shares.measured_mm, 1);
  EXPECT_DOUBLE_EQ(shares.completed_mm, 3);
  EXPECT_DOUBLE_EQ(shares.doubtful_mm, 2);
  EXPECT_DOUBLE_EQ(shares.length_mm(), layer.contours[0].length_mm());
  EXPECT_DOUBLE_EQ(shares.largest_gap_mm, 3);
  EXPECT_DOUBLE_EQ(shares.largest_error_mm, 0.5);
}

TEST(ValidateLayer, HoldsTheVerdictAgainstWhatTheContoursRestOn) {
  using Verdict = LayerCertificate::Verdict;
  const Contour completed = square().with_runs(std::vector{kSeen, kGap, kGap, kSeen}).value();
  const Contour doubtful = square().with_runs(std::vector{kSeen, kGap, kDoubtful, kSeen}).value();
  const auto valid = [](const Contour& contour, Verdict verdict, bool doubt) {
    Layer layer = layer_of(contour);
    layer.certificate.verdict = verdict;
    if (doubt) layer.certificate.doubt = Doubt{DoubtReason::WindingDisagrees};
    return validate_layer(header(), layer).has_value();
  };
  EXPECT_TRUE(valid(square(), Verdict::Measured, false));
  EXPECT_FALSE(valid(square(), Verdict::Completed, false));
  EXPECT_TRUE(valid(completed, Verdict::Completed, false));
  EXPECT_FALSE(valid(completed, Verdict::Measured, false));
  EXPECT_FALSE(valid(completed, Verdict::Unchecked, false));
  EXPECT_TRUE(valid(doubtful, Verdict::Doubtful, true));
  EXPECT_TRUE(valid(square(), Verdict::Doubtful, true));  // a doubt may concern the whole plane
  EXPECT_FALSE(valid(doubtful, Verdict::Completed, false));
  EXPECT_FALSE(valid(square(), Verdict::Doubtful, false));
  EXPECT_FALSE(valid(square(), Verdict::Measured, true));
}

TEST(LayerCertificate, IsIncompleteWhereContoursAreMissingAndOnlyThere) {
  for (std::uint8_t n = 1; n <= static_cast<std::uint8_t>(kLastDoubtReason); ++n) {
    LayerCertificate certificate;
    certificate.flag({static_cast<DoubtReason>(n)});
    const bool lacks = certificate.doubt->reason == DoubtReason::ContoursLeftOut ||
                       certificate.doubt->reason == DoubtReason::ContourMissing;
    EXPECT_EQ(certificate.is_incomplete(), lacks) << name_of(certificate.doubt->reason);
    EXPECT_FALSE(certificate.is_certified());
    EXPECT_NE(name_of(certificate.doubt->reason), "unknown");
    EXPECT_EQ(sentence_of(certificate).find("unknown"), std::string::npos);
  }
  EXPECT_FALSE(LayerCertificate{}.is_incomplete());
  EXPECT_EQ(sentence_of(LayerCertificate{}), "");
}

}  // namespace
}  // namespace telefab
