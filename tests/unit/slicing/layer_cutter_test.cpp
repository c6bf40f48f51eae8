// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_cutter.hpp"

#include <gtest/gtest.h>

#include <telefab/test/analytic_field.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

struct Case {
  std::string name;
  test::Shape shape;
  double spacing_mm;
};

std::vector<Case> shapes() {
  std::vector<Case> cases;
  cases.push_back({"sphere", test::sphere(10, 1), 0.8});
  cases.push_back({"upright torus", test::torus(9, 4, 90, 1), 0.8});
  cases.push_back({"leaning torus", test::torus(9, 4, 35, 1), 0.8});
  cases.push_back({"genus two", test::genus_two(12, 0.4), 0.5});
  cases.push_back({"two bumps", test::two_bumps(8, 0.6), 0.5});
  cases.push_back({"thin wall", test::thin_wall(14, 12, 1.2, 0.4), 0.35});
  cases.push_back({"near touching", test::near_touching_balls(6, 0.5, 0.3), 0.3});
  cases.push_back({"flat box", test::flat_box({8, 6, 5}, 1, 0.5), 0.5});
  cases.push_back({"hollow sphere", test::hollow_sphere(10, 2, 0.8), 0.7});
  cases.push_back({"bowl", test::bowl(10, 2, 0.5), 0.45});
  return cases;
}

TEST(LayerCutter, CertifiesOnlyWhatTheFormulaConfirms) {
  for (const Case& c : shapes()) {
    const auto samples = test::sample_surface(*c.shape, {.spacing_mm = c.spacing_mm, .seed = 21});
    const auto topology = analyse_height(*c.shape, {samples.points, samples.normals}, {}, {});
    ASSERT_TRUE(topology) << c.name << topology.error().what;
    const CutSetting setting{.field = *c.shape,
                             .topology = &*topology,
                             .samples =
                                 [&](double low, double high, SurfaceSamples& found) {
                                   found = {};
                                   for (std::size_t i = 0; i < samples.points.size(); ++i)
                                     if (samples.points[i].z() >= low && samples.points[i].z() <= high) {
                                       found.points.push_back(samples.points[i]);
                                       found.normals.push_back(samples.normals[i]);
                                     }
                                 },
                             .band_mm = 0.5 * c.spacing_mm,
                             .chord_mm = 0.01,
                             .method = TraceMethod::Auto,
                             .surface = {}};
    LayerCutter cutter{setting};
    const Box3 box = c.shape->bounds();
    int certified = 0, with_rings = 0;
    for (std::uint32_t i = 0; i < 23; ++i) {
      const double z = box.min.z() + (i + 0.37) / 23 * (box.max.z() - box.min.z());
      const auto cut = cutter.cut(LayerIndex{i}, z, {});
      ASSERT_TRUE(cut) << c.name;
      const Layer& layer = cut->layer;
      if (!layer.certificate.is_certified()) continue;
      const test::SliceCount truth = test::count_slice(*c.shape, z, 0.08);
      test::SliceCount found;
      for (const Contour& ring : layer.contours) ++(ring.is_hole() ? found.holes : found.outers);
      EXPECT_EQ(found, truth) << c.name << " at " << z;
      ++certified;
      if (!layer.contours.empty()) ++with_rings;
      const auto cursor = c.shape->cursor();
      for (const Contour& ring : layer.contours)
        for (const Point2 p : ring.vertices())
          EXPECT_LT(std::abs(cursor->at({p.x_mm, p.y_mm, z}).value_mm), 0.002) << c.name;
    }
    EXPECT_GE(certified, 19) << c.name << ": too many layers are flagged";
    EXPECT_GE(with_rings, 6) << c.name;
  }
}

}  // namespace
}  // namespace telefab::scan
