// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/image/palette.hpp>
#include <vector>

namespace telefab {
namespace {

using Triple = std::array<double, 3>;
using Matrix = std::array<Triple, 3>;

/// How linear RGB looks to somebody without one kind of cones: Machado, Oliveira and Fernandes (2009), severity 1.
struct Sight {
  const char* name;
  Matrix matrix;
};
constexpr std::array kSights{
    Sight{"all cones", {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}},
    Sight{"protanopia",
          {{{0.152286, 1.052583, -0.204868}, {0.114503, 0.786281, 0.099216}, {-0.003882, -0.048116, 1.051998}}}},
    Sight{"deuteranopia",
          {{{0.367322, 0.860646, -0.227968}, {0.280085, 0.672501, 0.047413}, {-0.011820, 0.042940, 0.968881}}}},
    Sight{"tritanopia",
          {{{1.255528, -0.076749, -0.178779}, {-0.078411, 0.930809, 0.147602}, {0.004733, 0.691367, 0.303900}}}}};

double linear(std::uint8_t value) {
  const double v = value / 255.0;
  return v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
}

/// CIE L*a*b* under D65 of a colour as it is seen.
Triple lab(Colour colour, const Sight& sight) {
  const Triple rgb{linear(colour.red), linear(colour.green), linear(colour.blue)};
  Triple seen{};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t k = 0; k < 3; ++k) seen[i] += sight.matrix[i][k] * rgb[k];
    seen[i] = std::clamp(seen[i], 0.0, 1.0);
  }
  const auto f = [](double t) { return t > 0.008856 ? std::cbrt(t) : 7.787 * t + 16.0 / 116; };
  const double x = f((0.4124 * seen[0] + 0.3576 * seen[1] + 0.1805 * seen[2]) / 0.95047);
  const double y = f(0.2126 * seen[0] + 0.7152 * seen[1] + 0.0722 * seen[2]);
  const double z = f((0.0193 * seen[0] + 0.1192 * seen[1] + 0.9505 * seen[2]) / 1.08883);
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

double distance(const Triple& a, const Triple& b) { return std::hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]); }

/// A distance of about 2.3 is just seen where two areas touch; small marks on a busy picture want ten times that.
constexpr double kDistinct = 20;

TEST(Palette, IsToldApartWithAnyKindOfColourBlindness) {
  using namespace palette;
  const std::vector<std::vector<Colour>> together{{kMeasured, kCompleted, kDoubtful, kPaper},
                                                  {kAttached, kSelfSupported, kToSupport, kAnchor},
                                                  {kPart, kSupport},
                                                  {kMinimum, kBottomSaddle, kTopSaddle, kMaximum},
                                                  {kAscending, kDescending},
                                                  {kOuterArc, kHoleArc, kLink},
                                                  {kMissing, kFits, kBeyond},
                                                  {kKept, kDuplicate, kOutlier, kSmallCluster},
                                                  {kPart, kDoubtful},
                                                  {kInk, kPaper},
                                                  {kPaleInk, kPaper}};
  for (const Sight& sight : kSights)
    for (std::size_t g = 0; g < together.size(); ++g)
      for (std::size_t i = 0; i < together[g].size(); ++i)
        for (std::size_t k = 0; k < i; ++k)
          EXPECT_GT(distance(lab(together[g][i], sight), lab(together[g][k], sight)), kDistinct)
              << sight.name << ", group " << g << ": colours " << k << " and " << i;
}

TEST(Palette, SeesThatRedAndGreenAreNotToldApartByEverybody) {
  EXPECT_LT(distance(lab({170, 110, 40}, kSights[2]), lab({110, 130, 40}, kSights[2])), kDistinct);
  EXPECT_GT(distance(lab({170, 110, 40}, kSights[0]), lab({110, 130, 40}, kSights[0])), kDistinct);
}

TEST(Palette, RunsFromMissingOverFittingToBeyond) {
  const auto is = [](Colour a, Colour b) { return a.red == b.red && a.green == b.green && a.blue == b.blue; };
  EXPECT_TRUE(is(palette::deviation_colour(-1), palette::kMissing));
  EXPECT_TRUE(is(palette::deviation_colour(0), palette::kFits));
  EXPECT_TRUE(is(palette::deviation_colour(7), palette::kBeyond));
}

}  // namespace
}  // namespace telefab
