// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <map>
#include <telefab/fab/support/pictures.hpp>
#include <telefab/fab/support/structure_mesh.hpp>

#include "stacks.hpp"

namespace telefab::fab {
namespace {

TEST(GeoJson, ReadsPolygonsWithHolesInCollections) {
  const auto region = region_from_geojson(R"({"type":"FeatureCollection","features":[
    {"type":"Feature","geometry":{"type":"Polygon","coordinates":
      [[[0,0],[0,10],[10,10],[10,0],[0,0]],[[4,4],[6,4],[6,6],[4,6],[4,4]]]}},
    {"type":"Feature","geometry":{"type":"MultiPolygon","coordinates":[[[[20,0],[22,0],[22,2],[20,2],[20,0]]]]}}]})");
  ASSERT_TRUE(region);
  EXPECT_NEAR(region->area_mm2(), 96 + 4, 1e-9);
}

TEST(GeoJson, SaysWhatIsWrong) {
  for (const char* bad : {"", "[]", "{}", R"({"type":"Point","coordinates":[1,2]})", R"({"type":"Polygon"})",
                          R"({"type":"Polygon","coordinates":[[[0,0],[1,0]]]})",
                          R"({"type":"Polygon","coordinates":[[[0,0],[1,0],["x",1],[0,0]]]})",
                          R"({"type":"Polygon","coordinates":[[[0,0],[1e300,0],[1,1],[0,0]]]})"}) {
    const auto region = region_from_geojson(bad);
    ASSERT_FALSE(region) << bad;
    EXPECT_EQ(region.error().code, ErrorCode::InvalidInput);
    EXPECT_NE(region.error().what.find("GeoJSON"), std::string::npos);
  }
}

TEST(Pictures, ShowPartAndSupportsInTheirColours) {
  const auto s = stacks::mushroom();
  const auto plan = plan_supports(s.layers, s.header, stacks::machine(), {}, {}, {}).value();
  const Image image = draw_structure(s.layers, plan, 0.15, {});
  ASSERT_EQ(image.pixels.size(), std::size_t{image.width_px} * image.height_px * 3);
  std::size_t grey = 0, orange = 0;
  for (std::size_t i = 0; i < image.pixels.size(); i += 3) {
    const int r = image.pixels[i], b = image.pixels[i + 2];
    grey += b > r && b < 250;
    orange += r > 2 * b;
  }
  EXPECT_GT(grey, 10'000U);
  EXPECT_GT(orange, 1'000U);
}

TEST(Pictures, ShowPinsBlueThatBearLittleAndRedThatBearAllTheyMay) {
  const auto s = stacks::stack(6, [](double) { return std::vector<std::vector<Point2>>{stacks::box(30, 30, 60, 50)}; });
  SupportOptions lifted;
  lifted.stand = SupportOptions::Stand::Never;
  const auto plan = plan_supports(s.layers, s.header, stacks::machine(), lifted, {}, {}).value();
  const auto count = [&](double most_demand) {
    const Image image = draw_stress(s.layers, plan, 0.15, most_demand, {});
    std::pair<std::size_t, std::size_t> blue_red;
    const std::size_t legend = std::size_t{image.width_px} * (84 + 76) * 3;  // and the frame's foot
    for (std::size_t i = 0; i + legend < image.pixels.size(); i += 3) {
      const int r = image.pixels[i], b = image.pixels[i + 2];
      blue_red.first += 2 * b > 3 * r;
      blue_red.second += r > 2 * b;
    }
    return blue_red;
  };
  const auto [blue, no_red] = count(100 * plan.figures().bearing_demand);
  EXPECT_GT(blue, 500U);
  EXPECT_LT(no_red, 50U);
  const auto [no_blue, red] = count(plan.figures().bearing_demand);
  EXPECT_GT(red, 500U);
  EXPECT_LT(no_blue, 50U);
}

TEST(StructureMesh, GivesAPlyWithAsManyVerticesAndFacesAsItsHeaderSays) {
  const auto s = stacks::mushroom();
  const auto plan = plan_supports(s.layers, s.header, stacks::machine(), {}, {}, {}).value();
  const std::string ply = to_ply(structure_mesh(s.layers, plan, 0.15, Millimetres{0.05}));
  const auto number = [&](const char* key) { return std::stoul(ply.substr(ply.find(key) + std::string{key}.size())); };
  const std::size_t body = ply.find("end_header\n") + 11;
  EXPECT_EQ(ply.size() - body, number("element vertex ") * 15 + number("element face ") * 13);
}

/// By the divergence theorem: right only where every body is closed and faces outward.
double volume_of(const TriangleMesh& mesh) {
  double six = 0;
  for (const auto& t : mesh.triangles) {
    const auto &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
    six += a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
  }
  return six / 6;
}

TEST(StructureMesh, ClosesEveryLayerHolesIncludedAndEveryStick) {
  const auto s = stacks::stack(6, [](double) {
    auto hole = stacks::box(44, 44, 56, 56);
    std::reverse(hole.begin(), hole.end());
    return std::vector<std::vector<Point2>>{stacks::box(40, 40, 60, 60), hole, stacks::circle(50, 50, 3)};
  });
  SupportOptions never;
  never.stand = SupportOptions::Stand::Never;
  const auto plan = plan_supports(s.layers, s.header, stacks::machine(), never, {}, {}).value();
  const auto mesh = structure_mesh(s.layers, plan, 0.15, Millimetres{0.001});
  EXPECT_NEAR(volume_of(mesh.part), plan.figures().part_mm3, 0.01 * plan.figures().part_mm3);
  EXPECT_NEAR(volume_of(mesh.supports), plan.figures().support_mm3, 0.1 * plan.figures().support_mm3);
  // Closed: every edge twice, once each way.
  for (const TriangleMesh* body : {&mesh.part, &mesh.supports}) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> edges;
    for (const auto& t : body->triangles)
      for (int i = 0; i < 3; ++i) ++edges[{t[static_cast<std::size_t>(i)], t[static_cast<std::size_t>((i + 1) % 3)]}];
    for (const auto& [edge, count] : edges) {
      EXPECT_EQ(count, 1);
      EXPECT_TRUE(edges.contains({edge.second, edge.first}));
    }
  }
}

}  // namespace
}  // namespace telefab::fab
