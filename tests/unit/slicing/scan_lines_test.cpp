// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {
namespace {

constexpr double kRowMm = 0.5;
constexpr double kRadiusMm = 1;
constexpr double kHeightMm = 8.4;

/// Six pins as a line scanner gives them: rows half a millimetre apart, samples in a row `ratio` times as dense.
std::string pins_in_rows(double ratio) {
  std::string text;
  const double step = kRowMm / ratio;
  const int rows = static_cast<int>(kHeightMm / kRowMm);
  const int around = static_cast<int>(2 * std::numbers::pi * kRadiusMm / step);
  for (int pin = 0; pin < 6; ++pin) {
    const double x = 4.0 * (pin % 3), y = 4.0 * (pin / 3);
    for (int row = 0; row <= rows; ++row)
      for (int i = 0; i < around; ++i) {
        const double angle = 2 * std::numbers::pi * i / around;
        text += fmt::format("{} {} {} {} {} 0\n", x + kRadiusMm * std::cos(angle), y + kRadiusMm * std::sin(angle),
                            kHeightMm * row / rows, std::cos(angle), std::sin(angle));
      }
    for (const int end : {-1, 1})
      for (double across = -kRadiusMm + kRowMm / 2; across < kRadiusMm; across += kRowMm) {
        const double half = std::sqrt(kRadiusMm * kRadiusMm - across * across);
        const int count = std::max(1, static_cast<int>(2 * half / step));
        for (int i = 0; i <= count; ++i)
          text += fmt::format("{} {} {} 0 0 {}\n", x - half + 2 * half * i / count, y + across, end < 0 ? 0 : kHeightMm,
                              end);
      }
  }
  return text;
}

struct Cut {
  std::size_t layers = 0, whole = 0, certified_wrong = 0;
};

Cut cut(const std::string& scan) {
  SliceRequest request;
  request.machine.name = "bench";
  request.machine.platform = {60, 40, 50};
  request.machine.projection.pixel_pitch_mm = 0.1;
  request.machine.layers.thickness_mm = 0.3;
  Cut cut;
  const LayerSink sink = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    ++cut.layers;
    const bool whole = layer.contours.size() == 6;
    cut.whole += whole;
    cut.certified_wrong += layer.certificate.is_certified() && !whole;
    return {};
  };
  const auto report = slice_scan(std::as_bytes(std::span{scan}), "pins.xyz", request, sink, {}, {});
  EXPECT_TRUE(report) << report.error().what;
  return cut;
}

TEST(ScanLines, ShowAllPinsInEveryLayerHoweverDenseTheRowsAre) {
  for (const double ratio : {1.0, 5.0, 10.0, 25.0}) {
    const Cut pins = cut(pins_in_rows(ratio));
    EXPECT_EQ(pins.layers, 28U) << ratio;
    EXPECT_EQ(pins.whole, 28U) << ratio;
    EXPECT_EQ(pins.certified_wrong, 0U) << ratio;
  }
}

TEST(ScanLines, FartherApartThanAnyKernelSpansCertifyNoEmptyLayer) {
  EXPECT_EQ(cut(pins_in_rows(60)).certified_wrong, 0U);
}

}  // namespace
}  // namespace telefab::scan
