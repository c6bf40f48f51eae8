// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>
#include <telefab/base/file.hpp>
#include <telefab/fab/formats/sliced_file.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab::fab {
namespace {

constexpr double kWidth_mm = 120, kHeight_mm = 67.5, kPitch_mm = 120.0 / 2560;  // square pixels: 2560 x 1440

struct Box {
  double x0, x1, y0, y1;
};
/// An L without any symmetry, its corner at (25, 12.5) once PrusaSlicer has put it to (40, 20).
constexpr std::array<Box, 2> kL{{{0, 30, 0, 5}, {0, 5, 0, 15}}};
constexpr double kX_mm = 25, kY_mm = 12.5;

void write_l(const std::filesystem::path& path) {
  std::ofstream out{path};
  out << "solid l\n";
  for (const Box& b : kL) {
    const auto corner = [&](int i) {
      return fmt::format("vertex {} {} {}\n", (i & 4) != 0 ? b.x1 : b.x0, (i & 2) != 0 ? b.y1 : b.y0, i & 1);
    };
    constexpr int kFaces[6][4] = {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}};
    for (const auto& f : kFaces)
      for (const auto& t : {std::array{f[0], f[1], f[2]}, std::array{f[0], f[2], f[3]}})
        out << "facet normal 0 0 0\nouter loop\n"
            << corner(t[0]) << corner(t[1]) << corner(t[2]) << "endloop\nendfacet\n";
  }
  out << "endsolid l\n";
}

class PrusaSlicer : public testing::Test {
 protected:
  void SetUp() override {
    if (telefab::test::run({"/bin/sh", "-c", "command -v prusa-slicer"}).code != 0)
      GTEST_SKIP() << "prusa-slicer is not installed";
  }
  telefab::test::ScratchFolder folder;
};

TEST_F(PrusaSlicer, MakesArchivesThatAreReadAsTheyLieOnThePlatform) {
  write_l(folder.path() / "l.stl");
  struct Setting {
    const char* orientation;
    int mirror_x, mirror_y;
  };
  for (const Setting& s :
       {Setting{"portrait", 1, 0}, {"portrait", 0, 0}, {"portrait", 0, 1}, {"landscape", 0, 0}, {"landscape", 1, 1}}) {
    SCOPED_TRACE(fmt::format("{} {} {}", s.orientation, s.mirror_x, s.mirror_y));
    const auto ini = folder.path() / "c.ini", archive = folder.path() / "l.sl1";
    ASSERT_TRUE(write_file_atomically(
        ini, fmt::format("printer_technology = SLA\nsupports_enable = 0\npad_enable = 0\nsupport_object_elevation = 0\n"
                         "display_orientation = {}\ndisplay_mirror_x = {}\ndisplay_mirror_y = {}\ndisplay_width = {}\n"
                         "display_height = {}\ndisplay_pixels_x = 2560\ndisplay_pixels_y = 1440\n"
                         "bed_shape = 0x0,{}x0,{}x{},0x{}\nlayer_height = 0.05\ninitial_layer_height = 0.05\n"
                         "exposure_time = 2\ninitial_exposure_time = 20\nfaded_layers = 5\nprinter_model = SL1\n",
                         s.orientation, s.mirror_x, s.mirror_y, kWidth_mm, kHeight_mm, kWidth_mm, kWidth_mm, kHeight_mm,
                         kHeight_mm)));
    const auto sliced =
        telefab::test::run({"/usr/bin/env", "prusa-slicer", "--export-sla", "--load", ini.string(), "--center", "40,20",
                            "--output", archive.string(), (folder.path() / "l.stl").string()});
    ASSERT_EQ(sliced.code, 0) << sliced.errors;
    const auto bytes = read_file(archive, 64U << 20U);
    ASSERT_TRUE(bytes) << bytes.error().what;
    const auto file = read_sliced_file(*bytes);
    ASSERT_TRUE(file) << file.error().what;
    const SlicedJob& job = (*file)->job();
    EXPECT_EQ(job.format, SlicedFormat::Sl1);
    EXPECT_TRUE(job.program.starts_with("PrusaSlicer"));
    EXPECT_EQ(job.size, (PixelSize{2560, 1440}));
    EXPECT_NEAR(job.pixel_width_mm, kPitch_mm, 1e-9);
    ASSERT_EQ(job.layers.size(), 20U);
    EXPECT_EQ(job.layers[0].exposure, std::chrono::seconds{20});
    EXPECT_EQ(job.layers[4].exposure, std::chrono::seconds{2});
    EXPECT_NEAR(job.layers[19].z_mm, 1, 1e-9);
    const auto mask = (*file)->mask(LayerIndex{10});
    ASSERT_TRUE(mask) << mask.error().what;
    std::size_t lit = 0, wrong = 0;
    for (std::uint32_t row = 0; row < mask->size.height_px; ++row)
      for (std::uint32_t column = 0; column < mask->size.width_px; ++column) {
        const double x = (column + 0.5) * kPitch_mm - kX_mm, y = (mask->size.height_px - row - 0.5) * kPitch_mm - kY_mm;
        double inside = -1e9;  // mm to the nearest edge of the nearest box
        for (const Box& b : kL) inside = std::max(inside, std::min({x - b.x0, b.x1 - x, y - b.y0, b.y1 - y}));
        const bool is_lit = mask->rows[std::size_t{row} * mask->size.width_px + column] >= 128;
        lit += is_lit ? 1U : 0U;
        if (std::abs(inside) > 2 * kPitch_mm && is_lit != (inside > 0)) ++wrong;
      }
    EXPECT_EQ(wrong, 0U);
    EXPECT_NEAR(double(lit) * kPitch_mm * kPitch_mm, 200, 2);
  }
}

}  // namespace
}  // namespace telefab::fab
