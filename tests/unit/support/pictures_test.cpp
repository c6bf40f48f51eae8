#include <gtest/gtest.h>

#include <telefab/fab/support/pictures.hpp>

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
  const Image image = draw_structure(s.layers, plan, 0.15);
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

TEST(StructurePly, HoldsAsManyVerticesAndFacesAsItsHeaderSays) {
  const auto s = stacks::mushroom();
  const auto plan = plan_supports(s.layers, s.header, stacks::machine(), {}, {}, {}).value();
  const std::string ply = structure_ply(s.layers, plan, 0.15, Millimetres{0.05});
  const auto number = [&](const char* key) { return std::stoul(ply.substr(ply.find(key) + std::string{key}.size())); };
  const std::size_t body = ply.find("end_header\n") + 11;
  EXPECT_EQ(ply.size() - body, number("element vertex ") * 15 + number("element face ") * 13);
}

}  // namespace
}  // namespace telefab::fab
