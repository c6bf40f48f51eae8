// SPDX-License-Identifier: GPL-3.0-or-later
#include "kernel.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>
#include <vector>

namespace telefab::scan {
namespace {

constexpr std::array kForms{KernelForm::Unbiased, KernelForm::Paper, KernelForm::PaperLiteral, KernelForm::Imls};

/// Samples of a gentle dome about the origin with uneven widths, padded to whole lanes.
struct Dome {
  static constexpr std::size_t kSamples = 96;
  alignas(64) std::array<std::array<float, kSamples>, 8> rows{};

  explicit Dome(std::uint64_t seed) {
    std::mt19937_64 random{seed};
    const auto uniform = [&] { return static_cast<double>(random() >> 11U) * 0x1p-52 - 1; };
    for (std::size_t i = 0; i < kSamples; ++i) {
      const double x = 2 * uniform(), y = 2 * uniform(), bend = 0.2;
      const double length = std::sqrt(1 + bend * bend * (x * x + y * y));
      const double width = 1 + 0.2 * uniform();
      const std::array<double, 7> row{
          x, y, -bend * (x * x + y * y) / 2, bend * x / length, bend * y / length, 1 / length, 1 / (width * width)};
      for (std::size_t a = 0; a < row.size(); ++a) rows[a][i] = static_cast<float>(row[a]);
    }
  }
  KernelInput input() {
    return {kSamples,       rows[0].data(), rows[1].data(), rows[2].data(), rows[3].data(),
            rows[4].data(), rows[5].data(), rows[6].data(), rows[7].data()};
  }
};

/// The formulas of README.md in double, one neighbour after another.
double value_by_formula(const KernelInput& in, KernelForm form, double x, double y, double z) {
  double w = 0, nx = 0, ny = 0, nz = 0;
  std::vector<double> theta(in.count);
  for (std::size_t i = 0; i < in.count; ++i) {
    const double dx = x - in.x[i], dy = y - in.y[i], dz = z - in.z[i];
    const double t = (dx * dx + dy * dy + dz * dz) * in.k[i];
    theta[i] = t < kCut ? std::exp(-t) : 0;
    w += theta[i];
    nx += theta[i] * in.nx[i];
    ny += theta[i] * in.ny[i];
    nz += theta[i] * in.nz[i];
  }
  const double length = std::sqrt(nx * nx + ny * ny + nz * nz);
  nx /= length, ny /= length, nz /= length;
  double own = 0, mean = 0, mean2 = 0, cubic = 0, by_k = 0;
  for (std::size_t i = 0; i < in.count; ++i) {
    const double dx = x - in.x[i], dy = y - in.y[i], dz = z - in.z[i];
    const double d = dx * nx + dy * ny + dz * nz;
    own += theta[i] * (dx * in.nx[i] + dy * in.ny[i] + dz * in.nz[i]) / w;
    mean += theta[i] * d / w;
    mean2 += theta[i] * d * d / w;
    cubic += theta[i] * in.k[i] * d * d * d / w;
    by_k += theta[i] * in.k[i] * d / w;
  }
  if (form == KernelForm::Imls) return own;
  if (form == KernelForm::Paper) return mean - cubic + mean2 * by_k;
  return mean - cubic;
}

class KernelForms : public testing::TestWithParam<KernelForm> {};

TEST_P(KernelForms, GivesTheSameBytesOnEveryInstructionSet) {
#ifdef TELEFAB_KERNEL_AVX2
  if (!__builtin_cpu_supports("avx2")) GTEST_SKIP() << "no AVX2 here";
  Dome dome{1};
  std::mt19937_64 random{2};
  for (int i = 0; i < 200; ++i) {
    const auto at = [&] { return static_cast<float>(static_cast<double>(random() % 2000) / 1000 - 1); };
    const float x = at(), y = at(), z = at();
    const KernelOutput a = baseline_kernels().evaluate(dome.input(), GetParam(), x, y, z);
    const KernelOutput b = avx2_kernels().evaluate(dome.input(), GetParam(), x, y, z);
    EXPECT_EQ(a.weight, b.weight);
    EXPECT_EQ(a.value, b.value);
    EXPECT_EQ(a.closeness, b.closeness);
    for (int k = 0; k < 3; ++k) EXPECT_EQ(a.gradient[k], b.gradient[k]);
  }
#else
  GTEST_SKIP() << "one instruction set on this machine";
#endif
}

TEST_P(KernelForms, HasTheGradientOfItsValue) {
  Dome dome{3};
  // What the small sphere term of the unbiased form adds is left out of its gradient.
  const double tolerance = GetParam() == KernelForm::Unbiased ? 0.03 : 2e-3;
  std::mt19937_64 random{4};
  for (int i = 0; i < 50; ++i) {
    const auto at = [&] { return static_cast<double>(random() % 1000) / 1000 - 0.5; };
    const std::array<double, 3> q{at(), at(), 0.6 * at()};
    const auto value = [&](double x, double y, double z) {
      return baseline_kernels().evaluate(dome.input(), GetParam(), static_cast<float>(x), static_cast<float>(y),
                                         static_cast<float>(z));
    };
    const KernelOutput here = value(q[0], q[1], q[2]);
    constexpr double kStep = 0.01;
    for (std::size_t k = 0; k < 3; ++k) {
      auto up = q, down = q;
      up[k] += kStep;
      down[k] -= kStep;
      const double slope = (value(up[0], up[1], up[2]).value - value(down[0], down[1], down[2]).value) / (2 * kStep);
      EXPECT_NEAR(here.gradient[k], slope, tolerance) << "axis " << k << " at try " << i;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(All, KernelForms, testing::ValuesIn(kForms));

TEST(Kernel, FollowsTheFormulasInDouble) {
  Dome dome{5};
  for (const KernelForm form : {KernelForm::Paper, KernelForm::PaperLiteral, KernelForm::Imls})
    for (const double z : {-0.6, -0.1, 0.0, 0.3, 0.7}) {
      const KernelOutput out = baseline_kernels().evaluate(dome.input(), form, 0.11F, -0.2F, static_cast<float>(z));
      EXPECT_NEAR(out.value, value_by_formula(dome.input(), form, 0.11F, -0.2F, static_cast<float>(z)), 2e-6);
    }
}

TEST(Kernel, IsTheDistanceOfAPlaneForTheNormalisedForms) {
  Dome dome{6};
  for (std::size_t i = 0; i < Dome::kSamples; ++i) {
    dome.rows[2][i] = 0;
    dome.rows[3][i] = dome.rows[4][i] = 0;
    dome.rows[5][i] = 1;
    dome.rows[6][i] = 1;
  }
  for (const float z : {-1.3F, -0.4F, 0.2F, 0.9F, 1.4F}) {
    for (const KernelForm form : {KernelForm::Unbiased, KernelForm::Paper, KernelForm::Imls})
      EXPECT_NEAR(baseline_kernels().evaluate(dome.input(), form, 0.1F, 0.1F, z).value, z, 1e-5);
    // The literal form turns back to zero at one kernel width: the paper's spurious branch.
    EXPECT_NEAR(baseline_kernels().evaluate(dome.input(), KernelForm::PaperLiteral, 0.1F, 0.1F, z).value, z - z * z * z,
                1e-5);
  }
}

TEST(Kernel, SaysNothingFarFromEverySample) {
  Dome dome{7};
  EXPECT_EQ(baseline_kernels().evaluate(dome.input(), KernelForm::Unbiased, 50, 0, 0).weight, 0);
}

}  // namespace
}  // namespace telefab::scan
