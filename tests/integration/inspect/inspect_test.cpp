// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <nlohmann/json.hpp>
#include <set>
#include <telefab/scan/inspect/inspect_scan.hpp>
#include <telefab/scan/inspect/standing_picture.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::test {
namespace {

using scan::inspect_scan;
using scan::Inspection;
using scan::InspectRequest;

/// A scan file as text: x y z nx ny nz a line.
std::string text_scan(const SurfaceSamples& samples) {
  std::string text;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    const Vec3& p = samples.points[i];
    const Vec3& n = samples.normals[i];
    text += fmt::format("{:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f}\n", p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  return text;
}

Inspection inspected(const InspectRequest& request) {
  const std::string text = text_scan(sample_surface(*torus(20, 8, 50, 1), {.spacing_mm = 0.9}));
  auto inspection = inspect_scan(std::as_bytes(std::span{text}), "ring.xyz", request, {}, {});
  EXPECT_TRUE(inspection) << inspection.error().what;
  return std::move(*inspection);
}

TEST(Inspection, OfARingSeesOneHole) {
  const Inspection inspection = inspected({});
  ASSERT_EQ(inspection.topology.components().size(), 1u);
  EXPECT_EQ(inspection.topology.components()[0].genus, 1);
  EXPECT_EQ(inspection.topology.critical_points().size(), 4u);
  EXPECT_TRUE(inspection.topology.inconsistencies().empty());
}

TEST(Inspection, StandsOnTheGroundAtTheAskedHeight) {
  const Inspection inspection = inspected({.placement = {.height_mm = 92.0}});
  EXPECT_NEAR(inspection.size_mm.z(), 92, 1e-4);
  EXPECT_NEAR(inspection.topology.critical_points().front().position_mm.z(), 0, 0.1);
  EXPECT_NEAR(inspection.topology.critical_points().back().position_mm.z(), 92, 0.1);
}

TEST(Inspection, FillsTheMachineWithTheAxisAskedForUp) {
  MachineProfile machine;
  machine.platform = {28, 28, 100};
  const Inspection as_it_lies = inspected({.machine = machine, .placement = {.fit = true}});
  const Inspection turned =
      inspected({.machine = machine, .placement = {.fit = true, .turn = scan::turn_from_up("x").value()}});
  EXPECT_LE(as_it_lies.size_mm.y(), 28);
  EXPECT_LE(turned.size_mm.y(), 28);
  EXPECT_NEAR(turned.size_mm.z() / as_it_lies.size_mm.x(), turned.size_mm.x() / as_it_lies.size_mm.z(), 0.01);
}

TEST(Inspection, JsonHoldsWhatTheTableShows) {
  const Inspection inspection = inspected({});
  const auto json = nlohmann::json::parse(to_json(inspection));
  EXPECT_EQ(json["euler"], 0);
  EXPECT_EQ(json["critical_points"].size(), 4u);
  EXPECT_EQ(json["critical_points"][1]["kind"], "bottom saddle");
  EXPECT_TRUE(json["critical_points"][0]["persistence_mm"].is_null());
  EXPECT_EQ(json["arcs"].size(), inspection.topology.arcs().size());
  EXPECT_EQ(json["components"][0]["genus"], 1);
}

TEST(Inspection, PictureShowsEveryKindOfCriticalPointAndTheCloud) {
  const Image image = draw_inspection(inspected({}));
  ASSERT_EQ(image.channels, 3u);
  ASSERT_EQ(image.pixels.size(), std::size_t{3} * image.width_px * image.height_px);
  std::set<std::array<std::uint8_t, 3>> colours;
  std::size_t grey = 0;
  // The views alone: the legend has all colours in any case.
  constexpr std::size_t kHead = 64, kViews = 1600;
  ASSERT_GT(image.height_px, kHead + kViews);
  for (std::size_t i = 3 * kHead * image.width_px; i < 3 * (kHead + kViews) * image.width_px; i += 3) {
    const std::array colour{image.pixels[i], image.pixels[i + 1], image.pixels[i + 2]};
    colours.insert(colour);
    grey += colour[0] == colour[1] && colour[1] == colour[2] && colour[0] < 250;
  }
  EXPECT_GT(grey, image.pixels.size() / 60);
  EXPECT_TRUE(colours.contains({0, 80, 170}));    // minimum
  EXPECT_TRUE(colours.contains({86, 200, 190}));  // bottom saddle
  EXPECT_TRUE(colours.contains({240, 180, 30}));  // top saddle
  EXPECT_TRUE(colours.contains({190, 30, 30}));   // maximum
}

TEST(Inspection, ViewerFilesHoldAsManyPointsAsTheySay) {
  const Inspection inspection = inspected({});
  const std::string ply = to_ply(inspection);
  const auto start = ply.find("end_header\n") + 11;
  std::size_t count = inspection.samples.size() + inspection.topology.critical_points().size();
  for (const auto& line : inspection.topology.integral_lines()) count += line.path_mm.size();
  for (const auto& arc : inspection.topology.arcs()) count += arc.path_mm.size();
  EXPECT_NE(ply.find(fmt::format("element vertex {}\n", count)), std::string::npos);
  EXPECT_EQ(ply.size() - start, count * 27);

  const std::string vtp = to_vtp(inspection);
  EXPECT_NE(vtp.find(fmt::format("NumberOfPoints=\"{}\"", count - inspection.samples.size())), std::string::npos);
  EXPECT_NE(vtp.find("NumberOfVerts=\"4\""), std::string::npos);
  EXPECT_TRUE(vtp.ends_with("</VTKFile>\n"));
}

TEST(Inspection, RefusesHeightAndScaleTogether) {
  const std::string text = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n";
  const auto result =
      inspect_scan(std::as_bytes(std::span{text}), "a.xyz", {.placement = {.height_mm = 10.0, .scale = 2.0}}, {}, {});
  ASSERT_FALSE(result);
  EXPECT_EQ(result.error().code, ErrorCode::InvalidInput);
}

/// A square plate, its one side up.
scan::PointCloud plate() {
  scan::PointCloud cloud;
  for (int x = 0; x < 100; ++x)
    for (int y = 0; y < 100; ++y) {
      cloud.points.emplace_back(0.1F * static_cast<float>(x), 0.1F * static_cast<float>(y), 0.F);
      cloud.normals.emplace_back(0.F, 0.F, 1.F);
    }
  return cloud;
}

/// Of the views alone, without the legend below them.
std::size_t orange_pixels(const Image& image) {
  constexpr std::size_t kFoot = 104;
  std::size_t orange = 0;
  for (std::size_t i = 0; i + 2 < image.pixels.size() - 3 * kFoot * image.width_px; i += 3)
    orange += image.pixels[i] > 140 && image.pixels[i] > 2 * image.pixels[i + 1];
  return orange;
}

TEST(StandingPicture, ShowsUndersidesInTheColourOfWhatIsToBeSupported) {
  const scan::PointCloud cloud = plate();
  const auto lying = [&](const char* rotate) {
    const std::array tiles{scan::StandingTile{scan::turn_from_rotate(rotate).value(), {"1: 0 mm3", "second line"}}};
    return scan::draw_standings(cloud, tiles, {});
  };
  EXPECT_EQ(orange_pixels(lying("0,0,0")), 0U);
  EXPECT_GT(orange_pixels(lying("180,0,0")), 1000U);
  EXPECT_EQ(orange_pixels(lying("90,0,0")), 0U) << "a wall hangs over nothing";
}

TEST(StandingPicture, GrowsByRowsOfTiles) {
  const std::vector<scan::StandingTile> tiles(7, {scan::Turn{}, {"way"}});
  const Image one = scan::draw_standings(plate(), std::span{tiles}.first(1), {});
  const Image six = scan::draw_standings(plate(), std::span{tiles}.first(6), {});
  const Image seven = scan::draw_standings(plate(), tiles, {});
  EXPECT_EQ(six.width_px, 3U * 396 + 16) << "three tiles";
  EXPECT_EQ(six.height_px - one.height_px, 432U) << "a row more";
  EXPECT_GT(seven.width_px, six.width_px);
  EXPECT_EQ(seven.height_px, six.height_px);
}

}  // namespace
}  // namespace telefab::test
