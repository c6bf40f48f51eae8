// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/scan/contour/specks.hpp>
#include <telefab/test/random_stack.hpp>

// Once specks are out, no ring is lost between two sites, however small and ragged: as many leave as arrive.
namespace telefab {
namespace {

constexpr double kPixel_mm = 0.14;

struct Random {
  std::mt19937_64 bits;
  double operator()(double low, double high) {
    return low + (high - low) * static_cast<double>(bits() >> 11U) * 0x1p-53;
  }
};

/// A ring about the middle of a cell of three pixels: a polygon, a splinter or a star, mostly much smaller than a
/// pixel.
std::vector<Point2> hostile(Random& random, Point2 middle) {
  const double size_mm = kPixel_mm * std::pow(10, random(-2, 0.15));
  const double flat = std::pow(10, random(-2, 0)), turn = random(0, 2 * std::numbers::pi);
  const int n = 3 + static_cast<int>(random.bits() % 9);
  const double star = random.bits() % 2 == 0 ? 1 : random(0.2, 1);
  std::vector<Point2> ring;
  for (int k = 0; k < n; ++k) {
    const double angle = 2 * std::numbers::pi * k / n, r = size_mm * (k % 2 == 0 ? 1 : star);
    const double x = r * std::cos(angle), y = flat * r * std::sin(angle);
    ring.push_back(
        {middle.x_mm + x * std::cos(turn) - y * std::sin(turn), middle.y_mm + x * std::sin(turn) + y * std::cos(turn)});
  }
  return ring;
}

/// Every layer with some hundred rings more: islands beside the part, and holes in its first star.
std::vector<Layer> with_hostile_rings(const LayerStack& stack, std::uint64_t seed) {
  Random random{std::mt19937_64{seed}};
  std::vector<Layer> layers{stack.layers().begin(), stack.layers().end()};
  for (Layer& layer : layers) {
    const auto put = [&](Point2 middle, bool hole) {
      auto vertices = hostile(random, middle);
      if (hole) std::reverse(vertices.begin(), vertices.end());
      if (auto ring = Contour::from_vertices(std::move(vertices))) layer.contours.push_back(std::move(*ring));
    };
    for (int i = 0; i < 120; ++i) put({1 + 0.42 * i, 5 + random(0, 1)}, false);
    // Between the star's own hole (at most 8.8 mm wide) and its outline (22.5 mm at least).
    for (int i = 0; i < 40; ++i) {
      const double angle = 2 * std::numbers::pi * i / 40;
      put({50 + 0.05 * layer.index.count() + 15 * std::cos(angle), 80 + 15 * std::sin(angle)}, true);
    }
    layer.contours = sorted_canonically(std::move(layer.contours));
  }
  return layers;
}

struct Sent {
  std::size_t specks = 0, rings = 0, small = 0, lost = 0, flagged = 0;
};

Sent send(const LayerStack& stack, std::uint64_t seed, Coding coding, const scan::SpeckRule& rule) {
  Sent sent;
  CodecOptions options;
  options.coding = coding;
  StackEncoder encoder = StackEncoder::start(stack.header(), options).value();
  const StackDecoder decoder = StackDecoder::start(stack.header()).value();
  std::vector<Layer> given = with_hostile_rings(stack, seed);
  const auto arrive = [&](const std::optional<Chunk>& chunk) {
    if (!chunk) return;
    const auto decoded = decoder.decode(*chunk).value();
    for (const Layer& layer : decoded) {
      const Layer& was = given[layer.index.count()];
      sent.lost += layer.contours.size() != was.contours.size();
      sent.flagged += was.certificate.is_certified() && !layer.certificate.is_certified();
      EXPECT_EQ(layer.certificate.specks, was.certificate.specks);
    }
  };
  for (Layer& layer : given) {
    sent.specks += scan::leave_specks_out(layer, rule).rings;
    sent.rings += layer.contours.size();
    for (const Contour& ring : layer.contours) sent.small += std::abs(ring.signed_area_mm2()) < kPixel_mm * kPixel_mm;
    arrive(encoder.add(layer).value());
  }
  arrive(encoder.finish().value());
  return sent;
}

class SpecksProperty : public testing::TestWithParam<std::uint64_t> {};

TEST_P(SpecksProperty, OnceOutAsManyRingsArriveAsLeaveInEitherCoding) {
  const LayerStack stack = test::random_stack(GetParam(), 20);
  for (const Coding coding : {Coding::Curve, Coding::Exact})
    for (const double least_px2 : {0.5, 0.0}) {
      const Sent sent = send(stack, GetParam(), coding, {least_px2 * kPixel_mm * kPixel_mm, 0.125 * kPixel_mm});
      EXPECT_EQ(sent.lost, 0U) << static_cast<int>(coding) << ' ' << least_px2;
      EXPECT_EQ(sent.flagged, 0U) << static_cast<int>(coding) << ' ' << least_px2;
      EXPECT_GT(sent.specks, 20U * 80);
      EXPECT_GT(sent.small, 20U * 3) << "too few small rings are left to be lost";
    }
}

TEST_P(SpecksProperty, LeftInSomeAreLost) {
  const LayerStack stack = test::random_stack(GetParam(), 20);
  for (const Coding coding : {Coding::Curve, Coding::Exact}) EXPECT_GT(send(stack, GetParam(), coding, {}).lost, 0U);
}
INSTANTIATE_TEST_SUITE_P(Seeds, SpecksProperty, testing::Range<std::uint64_t>(0, 8));

}  // namespace
}  // namespace telefab
