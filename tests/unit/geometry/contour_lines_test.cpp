// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
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

TEST(ContourLines, OfATextComeOneAfterTheOtherUntilOneIsRefused) {
  const std::string text = "{\"layer\":4,\"z_mm\":0,\"contours\":[]}\n{\"layer\":9,\"z_mm\":1,\"contours\":[]}";
  std::vector<std::uint32_t> layers;
  const auto take = [&](const Layer& layer) -> Result<void> {
    layers.push_back(layer.index.count());
    if (layers.size() > 3) return fail(ErrorCode::TooLarge, "no more");
    return {};
  };
  EXPECT_TRUE(read_json_lines("", take));
  EXPECT_TRUE(read_json_lines(text, take)) << "the last line may end without a newline";
  EXPECT_THAT(layers, testing::ElementsAre(4, 9));
  EXPECT_EQ(read_json_lines(text + "\n" + text, take).error().what, "line 2: no more");
  EXPECT_EQ(read_json_lines(text + "\n\n" + text, [](const Layer&) -> Result<void> { return {}; }).error().what,
            "line 3: contour line: not a JSON object");
}

}  // namespace telefab
