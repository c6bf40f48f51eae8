// SPDX-License-Identifier: GPL-3.0-or-later
#include <benchmark/benchmark.h>
#include <libdeflate.h>
#include <png.h>
#include <zlib.h>

#include <cstring>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/image/png.hpp>
#include <telefab/test/plates.hpp>

// Masks as PNG: ours, against libpng at level 1 with run-length matching and against libdeflate at level 1, in one run.
// Shapes: a plate of gears, a few thousand holes, blank. Sizes: 1857 x 1142 and 3840 x 2160.
namespace telefab {
namespace {

using Shape = test::Plate;

fab::Mask mask_of(Shape shape, PixelSize size) { return fab::rasterise(test::plate(shape, size), {size, 1.0}); }

PixelSize size_of(std::int64_t index) { return index == 0 ? PixelSize{1857, 1142} : PixelSize{3840, 2160}; }

void ours(benchmark::State& state) {
  const fab::Mask mask = mask_of(static_cast<Shape>(state.range(0)), size_of(state.range(1)));
  std::size_t bytes = 0;
  for (auto _ : state) bytes = encode_png_grey(mask.size.width_px, mask.size.height_px, mask.rows).value().size();
  state.counters["bytes"] = static_cast<double>(bytes);
}

void libdeflate_level_1(benchmark::State& state) {
  const fab::Mask mask = mask_of(static_cast<Shape>(state.range(0)), size_of(state.range(1)));
  std::size_t bytes = 0;
  for (auto _ : state) {
    const std::size_t row = mask.size.width_px;
    std::vector<std::uint8_t> raw((row + 1) * mask.size.height_px);
    for (std::size_t y = 0; y < mask.size.height_px; ++y)
      std::memcpy(raw.data() + y * (row + 1) + 1, mask.rows.data() + y * row, row);
    libdeflate_compressor* deflater = libdeflate_alloc_compressor(1);
    std::vector<std::byte> out(libdeflate_zlib_compress_bound(deflater, raw.size()));
    bytes = libdeflate_zlib_compress(deflater, raw.data(), raw.size(), out.data(), out.size());
    libdeflate_free_compressor(deflater);
  }
  state.counters["bytes"] = static_cast<double>(bytes);
}

void libpng_level_1_rle(benchmark::State& state) {
  const fab::Mask mask = mask_of(static_cast<Shape>(state.range(0)), size_of(state.range(1)));
  std::vector<png_byte> out;
  for (auto _ : state) {
    out.clear();
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
    png_infop info = png_create_info_struct(png);
    png_set_write_fn(
        png, &out,
        [](png_structp p, png_bytep data, png_size_t size) {
          auto& to = *static_cast<std::vector<png_byte>*>(png_get_io_ptr(p));
          to.insert(to.end(), data, data + size);
        },
        nullptr);
    png_set_filter(png, 0, PNG_FILTER_NONE);
    png_set_compression_level(png, 1);
    png_set_compression_strategy(png, Z_RLE);
    png_set_IHDR(png, info, mask.size.width_px, mask.size.height_px, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png, info);
    for (std::size_t y = 0; y < mask.size.height_px; ++y) png_write_row(png, mask.rows.data() + y * mask.size.width_px);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
  }
  state.counters["bytes"] = static_cast<double>(out.size());
}

void decode(benchmark::State& state) {
  const fab::Mask mask = mask_of(static_cast<Shape>(state.range(0)), size_of(state.range(1)));
  const auto bytes = encode_png_grey(mask.size.width_px, mask.size.height_px, mask.rows).value();
  for (auto _ : state) benchmark::DoNotOptimize(decode_png(bytes, 1U << 26U));
}

const std::vector<std::vector<std::int64_t>> kEverything{{0, 1, 2}, {0, 1}};
BENCHMARK(ours)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
BENCHMARK(libpng_level_1_rle)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
BENCHMARK(libdeflate_level_1)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
BENCHMARK(decode)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace telefab
