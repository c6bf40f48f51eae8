// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/codec/tfc_file.hpp>
#include <telefab/fab/mask/raster.hpp>

// What both sites and every machine must agree on, to the byte. A change here changes files and streams that exist:
// raise the format's version, or find out why the bytes moved.
namespace telefab {
namespace {

/// A staircase of drifting octagons with a hole; decimals alone, no function of the mathematical library.
LayerStack octagons() {
  constexpr Point2 directions[] = {{1, 0},  {0.7, 0.7},   {0, 1},  {-0.7, 0.7},
                                   {-1, 0}, {-0.7, -0.7}, {0, -1}, {0.7, -0.7}};
  StackHeader header;
  header.machine = "machine-a";
  header.scan_name = "octagons";
  header.layer_thickness_mm = 0.15;
  header.pixel_pitch_mm = 0.14;
  header.layer_count = 40;
  header.bounds = {{0, 0}, {40, 30}};
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < header.layer_count; ++i) {
    Layer layer;
    layer.index = LayerIndex{i};
    layer.z_mm = cut_height_mm(layer.index, header.layer_thickness_mm);
    const double x = 15 + 0.0625 * i;
    std::vector<Point2> outer;
    std::vector<Point2> hole;
    for (const Point2 d : directions) outer.push_back({x + 9 * d.x_mm, 14 + 9 * d.y_mm});
    for (const Point2 d : directions) hole.insert(hole.begin(), {x + 2.5 * d.x_mm, 14 + 2.5 * d.y_mm});
    layer.contours = sorted_canonically({Contour::from_vertices(outer).value(), Contour::from_vertices(hole).value()});
    layer.certificate = {
        LayerCertificate::Verdict::Measured, LayerCertificate::Method::Grid, LayerCertificate::Ground::Graph, 0, 0, {}};
    layers.push_back(std::move(layer));
  }
  return LayerStack::from_layers(std::move(header), std::move(layers)).value();
}

std::string file_digest(Coding coding) {
  CodecOptions options;
  options.coding = coding;
  return to_hex(digest_of(write_tfc(octagons(), options).value()));
}

TEST(GoldenStack, HasTheDigestThatBothSitesCompare) {
  EXPECT_EQ(to_hex(digest_of(octagons())), "362fd92e9a471fbdc5dc5c2dd5fdf3cee8269d9ce6b0f4698348da990b70c9dd");
}

TEST(GoldenStack, IsWrittenExactlyToTheSameFile) {
  EXPECT_EQ(file_digest(Coding::Exact), "a80ff1183390221bce42fd880e44e8bd70b090c7343982ad40d9c67ffbe1e339");
}

TEST(GoldenStack, IsWrittenAsCurvesToTheSameFile) {
  EXPECT_EQ(file_digest(Coding::Curve), "445ea61ecd83d5c5661bda95d43e255cd9e1e24dfda267d1aa65ce1a8283ec36");
}

TEST(GoldenStack, BecomesTheSameMask) {
  const LayerStack stack = octagons();
  const auto mask = fab::rasterise(stack.layers()[7].contours, {{286, 214}, 0.14});
  EXPECT_EQ(to_hex(digest_of(std::as_bytes(std::span{mask.rows}))),
            "8839e3595ea00e6b88b1e4c34a1f46767dee7cb7e47fb2e216a416c769e26957");
}

}  // namespace
}  // namespace telefab
