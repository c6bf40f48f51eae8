// SPDX-License-Identifier: GPL-3.0-or-later
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <telefab/fab/drivers/dlpc900_image.hpp>

namespace {

using namespace telefab::fab;

constexpr std::uint32_t kWidth = 1920, kHeight = 1080;

template <class F>
Mask mask_of(F grey) {
  Mask m{{kWidth, kHeight}, std::vector<std::uint8_t>(std::size_t{kWidth} * kHeight)};
  for (std::uint32_t y = 0; y < kHeight; ++y)
    for (std::uint32_t x = 0; x < kWidth; ++x) m.rows[std::size_t{y} * kWidth + x] = grey(x, y);
  return m;
}

void encode(benchmark::State& state, const Mask& mask) {
  std::size_t bytes = 0;
  for (auto _ : state) bytes = encode_dlpc900_image(mask.view()).size();
  state.counters["coded_kB"] = double(bytes) / 1000;
  state.counters["upload_s"] = double(bytes) / 63000;
}

const bool registered = [] {
  const auto bench = [](const char* name, Mask mask) {
    benchmark::RegisterBenchmark(name, [m = std::move(mask)](benchmark::State& s) {
      encode(s, m);
    })->Unit(benchmark::kMillisecond);
  };
  bench("black", mask_of([](auto, auto) { return std::uint8_t{0}; }));
  bench("disc", mask_of([](double x, double y) {
          return static_cast<std::uint8_t>(std::clamp(400.5 - std::hypot(x - 960, y - 540), 0.0, 1.0) * 255);
        }));
  bench("grey lattice 80 px", mask_of([](double x, double y) {
          const double g = std::sin(x * 0.0785) * std::cos(y * 0.0785) + std::sin(y * 0.0785) * 0.3;
          return static_cast<std::uint8_t>(std::clamp(g * 20 + 0.5, 0.0, 1.0) * 255);
        }));
  bench("noise", mask_of([rng = std::mt19937{1}](auto, auto) mutable { return static_cast<std::uint8_t>(rng()); }));
  return true;
}();

}  // namespace
