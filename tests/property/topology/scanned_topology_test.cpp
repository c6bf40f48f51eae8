// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <telefab/scan/mls/mls_field.hpp>
#include <telefab/scan/topology/height_topology.hpp>
#include <telefab/test/surface_samples.hpp>

// The topology of surfaces that are known only by samples, clean and noisy, through the moving-least-squares field.
namespace telefab::test {
namespace {

using scan::HeightTopology;
using scan::MlsField;

constexpr double kSpacing = 0.7;

struct Case {
  const char* name;
  Shape (*make)();
  double noise;            ///< in spacings
  double kernel_spacings;  ///< as notes of the method advise for that noise
};
std::ostream& operator<<(std::ostream& out, const Case& c) { return out << c.name; }

Shape leaning_ring() { return torus(20, 8, 40, 1); }
Shape double_ring() { return genus_two(20, 1, Pose::turned(25, Vec3{1, 0.5, 0})); }
Shape bumps() { return bumpy(20, 1); }

const Case kCases[] = {
    {"RingClean", leaning_ring, 0, 1.5},    {"RingNoise10", leaning_ring, 0.1, 2},
    {"RingNoise50", leaning_ring, 0.5, 3},  {"DoubleClean", double_ring, 0, 1.5},
    {"DoubleNoise10", double_ring, 0.1, 2}, {"DoubleNoise50", double_ring, 0.5, 3},
    {"BumpyClean", bumps, 0, 1.5},          {"BumpyNoise10", bumps, 0.1, 2},
    {"BumpyNoise50", bumps, 0.5, 3},
};

struct Scanned {
  std::unique_ptr<MlsField> field;
  HeightTopology topology;
};

Scanned scanned(const AnalyticField& shape, const SampleOptions& options, double kernel_mm) {
  const SurfaceSamples samples = sample_surface(shape, options);
  scan::PointCloud cloud;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    cloud.points.push_back(samples.points[i].cast<float>());
    cloud.normals.push_back(samples.normals[i].cast<float>());
  }
  auto field = MlsField::from_cloud(std::move(cloud), {.kernel_mm = kernel_mm}, {}).value();
  scan::SurfaceSamples kept;
  field->samples_between(-1e9, 1e9, kept);
  auto topology = scan::analyse_height(*field, kept, {}, {}).value();
  return {std::move(field), std::move(topology)};
}

class ScannedTopology : public testing::TestWithParam<Case> {};

TEST_P(ScannedTopology, HasTheGenusOfTheShapeAndPredictsItsSlices) {
  const Case& c = GetParam();
  const Shape shape = c.make();
  const Scanned scan = scanned(
      *shape, {.spacing_mm = kSpacing, .noise_mm = c.noise * kSpacing, .normal_noise_rad = 0.3 * c.noise, .seed = 11},
      c.kernel_spacings * kSpacing);
  const HeightTopology& topology = scan.topology;
  for (const std::string& inconsistency : topology.inconsistencies()) ADD_FAILURE() << inconsistency;
  EXPECT_EQ(topology.euler(), *shape->facts().euler);

  // The scanned surface lies within a fraction of the kernel of the shape: heights that near to a change of the
  // shape's own slices are not judged.
  const scan::Box3 box = shape->bounds();
  constexpr int kLayers = 60;
  const double aside = 0.15 * c.kernel_spacings * kSpacing;
  int judged = 0, wrong = 0;
  for (int i = 0; i < kLayers; ++i) {
    const double z = box.min.z() + (i + 0.5) * (box.max.z() - box.min.z()) / kLayers;
    const auto predicted = topology.predicted_contours(z);
    if (topology.is_near_critical(z) || !predicted) continue;
    const SliceCount truth = count_slice(*shape, z, 0.3);
    if (truth != count_slice(*shape, z - aside, 0.3) || truth != count_slice(*shape, z + aside, 0.3)) continue;
    ++judged;
    if (truth != SliceCount{predicted->outers, predicted->holes}) ++wrong;
  }
  EXPECT_GT(judged, kLayers / 2);
  EXPECT_EQ(wrong, 0);
}

INSTANTIATE_TEST_SUITE_P(Shapes, ScannedTopology, testing::ValuesIn(kCases),
                         [](const auto& named) { return std::string{named.param.name}; });

TEST(ScannedTopology, FlatTopsWithNoiseStayOutsideThePrediction) {
  const Shape box = flat_box({10, 12, 8}, 2, 1);
  const Scanned scan = scanned(*box, {.spacing_mm = kSpacing, .noise_mm = 0.1 * kSpacing, .seed = 3}, 2 * kSpacing);
  EXPECT_EQ(scan.topology.euler(), 2);
  EXPECT_GE(scan.topology.plateaus().size(), 2u);
  for (double z = -7.5; z <= 7.5; z += 0.25)
    EXPECT_EQ(scan.topology.predicted_contours(z), (ContourCount{1, 0})) << "z = " << z;
}

}  // namespace
}  // namespace telefab::test
