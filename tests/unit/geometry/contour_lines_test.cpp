// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/geometry/contour_lines.hpp>

namespace telefab {

TEST(ContourLines, WritesTheDocumentedLine) {
  Layer layer;
  layer.z_mm = 0.075;
  layer.contours = {Contour::from_vertices({{0, 0}, {1.5, 0}, {0, 2}}).value()};
  EXPECT_EQ(to_json_line(layer), R"({"layer":0,"z_mm":0.075,"contours":[[[0,0],[1.5,0],[0,2]]]})");
}

TEST(ContourLines, ComeBackExactly) {
  Layer layer;
  layer.index = LayerIndex{7};
  layer.z_mm = 1.0 / 3;
  layer.contours = {Contour::from_vertices({{0.1, 0.2}, {1e-7, 3}, {2, 2.0 / 3}}).value()};
  const auto back = layer_from_json_line(to_json_line(layer));
  ASSERT_TRUE(back);
  EXPECT_EQ(back->index, layer.index);
  EXPECT_EQ(back->z_mm, layer.z_mm);
  EXPECT_EQ(back->contours, layer.contours);
}

TEST(ContourLines, RefuseWhatIsNoLayer) {
  for (const char* line :
       {"", "{}", "[]", R"({"layer":-1,"z_mm":0,"contours":[]})", R"({"layer":0,"z_mm":0,"contours":[[[0,0],[1,1]]]})",
        R"({"layer":0,"z_mm":0,"contours":[[[0,0],[1,"a"],[2,2]]]})",
        R"({"layer":99999999999,"z_mm":0,"contours":[]})"})
    EXPECT_FALSE(layer_from_json_line(line)) << line;
}

}  // namespace telefab
