// SPDX-License-Identifier: GPL-3.0-or-later
#include <benchmark/benchmark.h>

#include <random>
#include <telefab/fab/screen/packing.hpp>

// A mask into the words of a frame, on one core; and the copy of the frame that a display needs after it.
namespace {

using namespace telefab;
using namespace telefab::fab;

void packs(benchmark::State& state, const PanelLayout& layout, PixelSize size) {
  Mask mask{size, std::vector<std::uint8_t>(std::size_t{size.width_px} * size.height_px)};
  std::mt19937 rng{1};
  for (auto& v : mask.rows) v = static_cast<std::uint8_t>(rng());
  const std::size_t pitch = std::size_t{layout.words.width_px} * bytes_per_word(layout.packing);
  std::vector<std::byte> frame(pitch * layout.words.height_px), display(frame.size());
  for (auto _ : state) {
    if (!pack_mask(mask.view(), layout, frame, pitch)) state.SkipWithError("refused");
    std::copy(frame.begin(), frame.end(), display.begin());
    benchmark::DoNotOptimize(display.data());
  }
  state.counters["frame_MB"] = double(frame.size()) / 1e6;
}

const bool registered = [] {
  const auto bench = [](const char* name, PanelLayout layout, PixelSize mask) {
    benchmark::RegisterBenchmark(name, [=](benchmark::State& s) {
      packs(s, layout, mask);
    })->Unit(benchmark::kMillisecond);
  };
  bench("1080p grey", {{1920, 1080}, PixelPacking::Grey, {}, {}}, {1920, 1080});
  bench("4K grey", {{3840, 2160}, PixelPacking::Grey, {}, {}}, {3840, 2160});
  bench("8K three in one", {{2560, 4320}, PixelPacking::Rgb, {}, {}}, {7680, 4320});
  bench("8K three in one, mirrored", {{2560, 4320}, PixelPacking::Rgb, OpticsTurn::MirrorX, {}}, {7680, 4320});
  bench("8K three in one, on its side", {{2560, 4320}, PixelPacking::Rgb, {}, ScreenTurn::Quarter}, {4320, 7680});
  bench("8K 5-6-5", {{2560, 4320}, PixelPacking::Bits565, {}, {}}, {7680, 4320});
  bench("8K 5-6-5, on its side", {{2560, 4320}, PixelPacking::Bits565, {}, ScreenTurn::ThreeQuarters}, {4320, 7680});
  return true;
}();

}  // namespace
