// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/mls/mls_field.hpp>

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <telefab/test/analytic_field.hpp>
#include <telefab/test/surface_samples.hpp>

namespace telefab::scan {
namespace {

PointCloud cloud_of(const test::SurfaceSamples& samples, const Vec3& shift = Vec3::Zero()) {
  PointCloud cloud;
  cloud.origin = shift;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    cloud.points.push_back(samples.points[i].cast<float>());
    cloud.normals.push_back(samples.normals[i].cast<float>());
  }
  return cloud;
}

std::unique_ptr<MlsField> field_of(PointCloud cloud, const MlsOptions& options = {}) {
  auto field = MlsField::from_cloud(std::move(cloud), options, {});
  EXPECT_TRUE(field) << (field ? "" : field.error().what);
  return field ? std::move(*field) : nullptr;
}

/// Largest distance of the field's zero set to a sphere about the origin, along many rays.
double worst_radius_error(const MlsField& field, double radius_mm) {
  const auto cursor = field.cursor();
  double worst = 0;
  for (int i = 0; i < 400; ++i) {
    const double u = (i + 0.5) / 200 - 1;
    const double a = 2.399963 * i;
    const Vec3 ray{std::sqrt(1 - u * u) * std::cos(a), std::sqrt(1 - u * u) * std::sin(a), u};
    double r = radius_mm;
    for (int k = 0; k < 20; ++k) {
      const FieldSample f = cursor->at(r * ray);
      EXPECT_TRUE(f.in_reach);
      r -= f.value_mm / f.gradient.dot(ray);
    }
    worst = std::max(worst, std::abs(r - radius_mm));
  }
  return worst;
}

const test::SurfaceSamples& ball() {
  static const test::SurfaceSamples samples =
      test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .seed = 3});
  return samples;
}

TEST(MlsField, FindsTheRadiusOfASphere) { EXPECT_LT(worst_radius_error(*field_of(cloud_of(ball())), 10), 0.002); }

TEST(MlsField, ShrinksWithThePapersSurfaceAndSwellsWithImlsByTheKnownBias) {
  // h^2 / 2R = 0.05 mm for h = 1, R = 10; both within a third of it, the unbiased surface far inside.
  EXPECT_NEAR(worst_radius_error(*field_of(cloud_of(ball()), {.surface = SurfaceKind::Paper, .kernel_mm = 1}), 10),
              0.05, 0.017);
  EXPECT_NEAR(worst_radius_error(*field_of(cloud_of(ball()), {.surface = SurfaceKind::Imls, .kernel_mm = 1}), 10), 0.05,
              0.017);
  EXPECT_LT(worst_radius_error(*field_of(cloud_of(ball()), {.kernel_mm = 1}), 10), 0.003);
}

TEST(MlsField, HasTheLiteralSurfaceWhereTheNormalisedOneIs) {
  const auto paper = field_of(cloud_of(ball()), {.surface = SurfaceKind::Paper, .kernel_mm = 1});
  const auto literal = field_of(cloud_of(ball()), {.surface = SurfaceKind::PaperLiteral, .kernel_mm = 1});
  const auto a = paper->cursor();
  const auto b = literal->cursor();
  for (int i = 0; i < 100; ++i) {
    const double angle = 0.0628 * i;
    Vec3 p{10 * std::cos(angle), 10 * std::sin(angle), 0};
    for (int k = 0; k < 10; ++k) {
      const FieldSample f = a->at(p);
      p -= f.value_mm / f.gradient.squaredNorm() * f.gradient;
    }
    EXPECT_LT(std::abs(b->at(p).value_mm), 0.006) << "0.01 spacings apart at most, at " << p.transpose();
  }
}

TEST(MlsField, GivesTheSameValueWhateverWasAskedBefore) {
  const auto field = field_of(cloud_of(ball()));
  const auto warm = field->cursor();
  for (int i = 0; i < 500; ++i) (void)warm->at({10 * std::cos(0.1 * i), 10 * std::sin(0.1 * i), 0.01 * i});
  for (int i = 0; i < 100; ++i) {
    const Vec3 p{9.8, 0.02 * i, 0.03 * i};
    const FieldSample a = warm->at(p);
    const FieldSample b = field->cursor()->at(p);
    EXPECT_EQ(a.value_mm, b.value_mm);
    EXPECT_EQ(a.gradient, b.gradient);
  }
}

TEST(MlsField, DoesNotDependOnTheOrderOfThePoints) {
  PointCloud cloud = cloud_of(ball());
  const auto forward = field_of(cloud);
  std::reverse(cloud.points.begin(), cloud.points.end());
  std::reverse(cloud.normals.begin(), cloud.normals.end());
  const auto backward = field_of(cloud);
  const auto a = forward->cursor();
  const auto b = backward->cursor();
  for (int i = 0; i < 100; ++i) {
    const Vec3 p{9.9, 0.05 * i - 2, 0.03 * i - 1};
    EXPECT_EQ(a->at(p).value_mm, b->at(p).value_mm);
  }
}

TEST(MlsField, MovesWithTheScan) {
  const Vec3 shift{128, -64, 32};
  const auto here = field_of(cloud_of(ball()));
  const auto there = field_of(cloud_of(ball(), shift));
  const auto a = here->cursor();
  const auto b = there->cursor();
  for (int i = 0; i < 100; ++i) {
    const Vec3 p{9.9, 0.05 * i - 2, 0.03 * i - 1};
    EXPECT_NEAR(a->at(p).value_mm, b->at(p + shift).value_mm, 1e-9);
  }
}

TEST(MlsField, WidensTheKernelWhereSamplesAreSparse) {
  const auto uneven = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.4, .unevenness = 4, .seed = 5});
  const auto field = field_of(cloud_of(uneven));
  ASSERT_TRUE(field->kernel().adaptive);
  EXPECT_GT(field->kernel_width_mm({9.9, 0, 0}), 2 * field->kernel_width_mm({-9.9, 0, 0}));
  EXPECT_LT(worst_radius_error(*field, 10), 0.02);
}

TEST(MlsField, KeepsOneWidthWhereSamplesAreEven) { EXPECT_FALSE(field_of(cloud_of(ball()))->kernel().adaptive); }

TEST(MlsField, WidensTheKernelForNoise) {
  const auto noisy = test::sample_surface(*test::sphere(10, 1),
                                          {.spacing_mm = 0.3, .noise_mm = 0.15, .normal_noise_rad = 0.15, .seed = 6});
  const auto field = field_of(cloud_of(noisy));
  EXPECT_GT(field->kernel().kernel_mm, 1.8 * field->kernel().spacing_mm);
  EXPECT_LT(worst_radius_error(*field, 10), 0.15);
}

// Drawn at random samples leave voids that even ones of the same number do not.
TEST(MlsField, WidensTheKernelWhereSamplesLieAtRandom) {
  std::mt19937_64 random{7};
  std::normal_distribution<double> bell;
  test::SurfaceSamples drawn;
  while (drawn.points.size() < ball().points.size()) {
    const Vec3 out = Vec3{bell(random), bell(random), bell(random)}.normalized();
    drawn.points.push_back(10 * out);
    drawn.normals.push_back(out);
  }
  const auto even = field_of(cloud_of(ball()));
  const auto field = field_of(cloud_of(drawn));
  EXPECT_NEAR(even->kernel().kernel_mm / even->kernel().spacing_mm, 0.9, 1e-6);
  EXPECT_NEAR(field->kernel().kernel_mm / field->kernel().spacing_mm, 1.25, 0.01);
  EXPECT_EQ(field->kernel().noise_factor, 0.9) << "none of it is noise";
  EXPECT_LT(worst_radius_error(*field, 10), 0.02);
}

// Neighbours of their own side are far away; kernels as wide as that blur what lies between.
TEST(MlsField, AFewTurnedNormalsWidenNoKernel) {
  auto samples = test::sample_surface(*test::flat_box({10, 10, 10}, 0.5, 1), {.spacing_mm = 0.4, .seed = 8});
  const auto right = field_of(cloud_of(samples));
  for (std::size_t i = 0; i < samples.points.size(); i += 20) samples.normals[i] *= -1;
  const auto turned = field_of(cloud_of(samples));
  EXPECT_LT(turned->widest_kernel_mm(), 2 * right->widest_kernel_mm());
  EXPECT_LT(turned->kernel().noise_mm, 2 * right->kernel().noise_mm + 0.02);
  EXPECT_NEAR(turned->kernel().kernel_mm, right->kernel().kernel_mm, 0.2 * right->kernel().kernel_mm);
}

TEST(MlsField, LeavesOutliersOut) {
  auto samples = test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .outlier_share = 0.01, .seed = 7});
  const auto field = field_of(cloud_of(samples));
  const auto strays = static_cast<std::size_t>(std::count_if(
      samples.points.begin(), samples.points.end(), [](const Vec3& p) { return std::abs(p.norm() - 10) > 0.6; }));
  EXPECT_GT(strays, 20U);
  EXPECT_GE(field->kernel().dropped_samples, strays * 9 / 10);
  // Strays that lie on the ball but look elsewhere remain; they dent it by less than a fifth of a spacing.
  EXPECT_LT(worst_radius_error(*field, 10), 0.12);
}

TEST(MlsField, ListsItsSamplesByHeight) {
  const auto field = field_of(cloud_of(ball()));
  SurfaceSamples found;
  field->samples_between(-1, 2, found);
  ASSERT_GT(found.points.size(), 100U);
  EXPECT_EQ(found.points.size(), found.normals.size());
  for (std::size_t i = 0; i < found.points.size(); ++i) {
    EXPECT_GE(found.points[i].z(), -1.0001);
    EXPECT_LE(found.points[i].z(), 2.0001);
    EXPECT_LE(found.points[i > 0 ? i - 1 : 0].z(), found.points[i].z());
  }
}

TEST(MlsField, RefusesCloudsItCannotUse) {
  PointCloud cloud = cloud_of(ball());
  cloud.normals.clear();
  EXPECT_EQ(MlsField::from_cloud(cloud, {}, {}).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(MlsField::from_cloud({}, {}, {}).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(MlsField::from_cloud(cloud_of(ball()), {.kernel_mm = -1}, {}).error().code, ErrorCode::InvalidInput);
  PointCloud broken = cloud_of(ball());
  broken.points[7].x() = std::nanf("");
  EXPECT_EQ(MlsField::from_cloud(broken, {}, {}).error().code, ErrorCode::InvalidInput);
}

TEST(MlsField, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(MlsField::from_cloud(cloud_of(ball()), {}, stop.get_token()).error().code, ErrorCode::Cancelled);
}

TEST(SurfaceKind, IsKnownByItsName) {
  for (const auto kind : {SurfaceKind::Unbiased, SurfaceKind::Paper, SurfaceKind::PaperLiteral, SurfaceKind::Imls})
    EXPECT_EQ(surface_kind_from(name_of(kind)), kind);
  EXPECT_FALSE(surface_kind_from("poisson"));
}

TEST(MlsField, SamplesInAGapCloseItAndCountInNoEstimate) {
  const auto torn =
      test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 0.6, .holes = {{{10, 0, 0}, 4}}, .seed = 3});
  const auto field = field_of(cloud_of(torn));
  ASSERT_TRUE(field);
  EXPECT_FALSE(field->cursor()->at({10, 0, 0}).in_reach);
  // What belongs there, three times as coarse as the scan.
  std::vector<GapSample> others;
  for (const Vec3& p : test::sample_surface(*test::sphere(10, 1), {.spacing_mm = 1.8, .seed = 4}).points)
    if ((p - Vec3{10, 0, 0}).norm() < 4) others.push_back({p, p.normalized(), 1.8});
  const auto whole = field->completed_by(others);
  const auto in_gap = whole->cursor()->at({10, 0, 0});
  EXPECT_TRUE(in_gap.in_reach);
  EXPECT_NEAR(in_gap.value_mm, 0, 0.05);
  EXPECT_NEAR(whole->cursor()->at({-10.1, 0, 0}).value_mm, field->cursor()->at({-10.1, 0, 0}).value_mm, 1e-5);
  EXPECT_EQ(whole->kernel().noise_mm, field->kernel().noise_mm);
  EXPECT_EQ(whole->kernel().spacing_mm, field->kernel().spacing_mm);
  EXPECT_EQ(whole->kernel().unevenness, field->kernel().unevenness);
  EXPECT_GT(whole->kernel_width_mm({10, 0, 0}), 1.5 * field->kernel_width_mm({-10, 0, 0}));
  SurfaceSamples all;
  whole->samples_between(-11, 11, all);
  ASSERT_EQ(all.in_gap.size(), all.points.size());
  EXPECT_EQ(static_cast<std::size_t>(std::count(all.in_gap.begin(), all.in_gap.end(), 1)), others.size());
  for (std::size_t i = 0; i < all.points.size(); ++i)
    EXPECT_EQ(all.in_gap[i] == 1, (all.points[i] - Vec3{10, 0, 0}).norm() < 4) << all.points[i].transpose();
  field->samples_between(-11, 11, all);
  EXPECT_TRUE(all.in_gap.empty());
}

}  // namespace
}  // namespace telefab::scan
