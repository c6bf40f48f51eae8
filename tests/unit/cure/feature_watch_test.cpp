// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <nlohmann/json.hpp>
#include <telefab/fab/cure/dose_field.hpp>
#include <telefab/fab/cure/feature_watch.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/test/block_stack.hpp>

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using telefab::test::rectangle;

/// A block with a wall of some width on it, standing at pixel columns from 200 on.
class WalledBlock {
 public:
  WalledBlock(double width_mm, std::uint32_t wall_layers) {
    std::vector<std::vector<Contour>> rings(4, {rectangle(5, 5, 30, 25)});
    rings.resize(4 + wall_layers, {rectangle(20, 6, 20 + width_mm, 24)});
    stack = telefab::test::stack_of(rings);
  }
  /// With the cover of every layer as its mask, each lit for `lit`.
  [[nodiscard]] ThinReport watched(std::chrono::nanoseconds lit, std::uint32_t lift = 0, bool with_dose = true) const {
    FeatureWatch watch{stack.layers(), lift, machine.projection.pixel_pitch_mm,
                       with_dose ? std::optional{cure_model(machine).value()} : std::nullopt};
    const auto count = static_cast<std::uint32_t>(stack.layers().size()) + lift;
    watch.look(count / 2);  // in two steps, as a planner does
    for (std::uint32_t i = 0; i < count; ++i) {
      if (i == count / 2) watch.look(count);
      const Mask mask =
          rasterise(i < lift ? std::vector<Contour>{} : stack.layers()[i - lift].contours, mask_frame(machine));
      watch.add(i, watch.light_of(i, {mask.view(), lit}));
    }
    return watch.finish();
  }
  MachineProfile machine = telefab::test::small_machine();
  LayerStack stack = telefab::test::table(1, 1);
};

TEST(FeatureWatch, TellsAWallNarrowerThanAPixelWithItsPlaceAndLayers) {
  const ThinReport report = WalledBlock{0.06, 6}.watched(2s, 3);
  EXPECT_EQ(report.walls.fine_layers, 6U);
  EXPECT_NEAR(report.walls.fine_mm, 6 * 18, 6 * 0.5);
  ASSERT_TRUE(report.walls.narrowest);
  EXPECT_NEAR(report.walls.narrowest->place.width_mm, 0.06, 1e-9);
  EXPECT_NEAR(report.walls.narrowest->place.middle.x_mm, 20.03, 1e-9);
  EXPECT_GE(report.walls.narrowest->layer.count(), 3U + 4U);
  EXPECT_EQ(report.gaps.fine_layers, 0U);
}

TEST(FeatureWatch, HasNothingToSayOfAThickWallOrOfWhatOneLayerAloneShows) {
  const ThinReport thick = WalledBlock{0.3, 6}.watched(2s);
  EXPECT_FALSE(thick.walls.narrowest);
  EXPECT_TRUE(thick.weak.empty());
  EXPECT_FALSE(WalledBlock(0.06, 1).watched(2s).walls.narrowest);
}

TEST(FeatureWatch, TakesTheDoseOfAllLaterLayersAsTheCureModelDoes) {
  const WalledBlock block{0.1, 8};
  const CureModel model = cure_model(block.machine).value();
  const ThinReport report = block.watched(500ms);
  ASSERT_TRUE(report.walls.weakest);
  // The dose at the same place by the walk from the top down.
  DoseStream stream{model};
  std::optional<DoseField> field;
  for (auto i = static_cast<std::uint32_t>(block.stack.layers().size()); i-- > report.walls.weakest->layer.count();) {
    const Mask mask = rasterise(block.stack.layers()[i].contours, mask_frame(block.machine));
    field = stream.descend(std::vector{MaskExposure{mask.view(), 500ms}}).value();
  }
  const Point2 at = report.walls.weakest->place.middle;
  const double dose = field->sample({at.x_mm / 0.1, at.y_mm / 0.1}).dose;
  EXPECT_NEAR(*report.walls.weakest->latitude, 1 - model.to_middle() / dose, 1e-4);
}

TEST(FeatureWatch, CountsAsWeakWhatFivePercentOfTheDoseLoses) {
  const WalledBlock block{0.1, 8};
  const double latitude = *block.watched(500ms).walls.weakest->latitude;
  ASSERT_LT(latitude, 1);
  // The exposure with which the weakest place bears so much.
  const auto lit_for = [&](double share) {
    return std::chrono::nanoseconds{static_cast<std::int64_t>(5e8 * (1 - latitude) / (1 - share))};
  };
  const ThinReport enough = block.watched(lit_for(kDoseTolerance + 0.01));
  EXPECT_EQ(enough.walls.weak_layers, 0U);
  EXPECT_TRUE(enough.weak.empty());
  const ThinReport little = block.watched(lit_for(kDoseTolerance - 0.01));
  EXPECT_GE(little.walls.weak_layers, 1U);
  ASSERT_FALSE(little.weak.empty());
  EXPECT_NEAR(*little.weak.front().latitude, kDoseTolerance - 0.01, 1e-4);
  EXPECT_LT(*block.watched(lit_for(-0.1)).walls.weakest->latitude, 0);
}

TEST(FeatureWatch, FindsAGapThatClosesFromTooMuchLight) {
  WalledBlock block{0.3, 1};
  block.stack = telefab::test::stack_of(
      std::vector<std::vector<Contour>>(10, {rectangle(5, 5, 15, 25), rectangle(15.1, 5, 30, 25)}));
  const ThinReport report = block.watched(2s);
  EXPECT_EQ(report.gaps.fine_layers, 0U);  // of a pixel, and so is the widest wall that masks show
  ASSERT_TRUE(report.gaps.weakest);
  EXPECT_LT(*report.gaps.weakest->latitude, 0);
  EXPECT_EQ(report.gaps.weak_layers, 10U);
  EXPECT_EQ(report.walls.weak_layers, 0U);
  EXPECT_GT(*block.watched(100ms).gaps.weakest->latitude, kDoseTolerance);
}

TEST(FeatureWatch, WithoutAModelStillFindsWhatIsFine) {
  const ThinReport report = WalledBlock{0.06, 6}.watched(2s, 0, false);
  EXPECT_FALSE(report.dose_known);
  EXPECT_EQ(report.walls.fine_layers, 6U);
  EXPECT_FALSE(report.walls.weakest);
}

TEST(FeatureWatch, ReportsAsJsonWithPlaces) {
  const auto json = nlohmann::json::parse(to_json(WalledBlock{0.06, 6}.watched(100ms)));
  EXPECT_EQ(json["walls"]["fine_layers"], 6);
  EXPECT_EQ(json["weak"].size(), 6U);
  EXPECT_EQ(json["weak"][0]["kind"], "wall");
  EXPECT_NEAR(json["weak"][0]["place"][0], 20.03, 1e-9);
  EXPECT_FALSE(json["gaps"].contains("narrowest"));
}

}  // namespace
}  // namespace telefab::fab
