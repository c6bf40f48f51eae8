// SPDX-License-Identifier: GPL-3.0-or-later
#include <benchmark/benchmark.h>

#include <array>
#include <chrono>
#include <telefab/fab/mask/blend.hpp>
#include <telefab/fab/mask/column_caps.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/image/png.hpp>
#include <telefab/test/plates.hpp>
#ifdef TELEFAB_BENCH_AGG
#include <agg2/agg_pixfmt_gray.h>
#include <agg2/agg_rasterizer_scanline_aa.h>
#include <agg2/agg_renderer_scanline.h>
#include <agg2/agg_scanline_p.h>
#endif

// One layer's mask, on one core. Arguments: plate (gears, holes), frame (1857 x 1142, 3840 x 2160, 7680 x 4320).
namespace telefab::fab {
namespace {

MachineProfile machine_of(std::int64_t frame) {
  MachineProfile machine;
  machine.projection.pixel_pitch_mm = 0.05;
  constexpr std::array<std::array<double, 2>, 3> kFrames_px{{{1857.5, 1142.5}, {3840.5, 2160.5}, {7680.5, 4320.5}}};
  const auto& [width_px, height_px] = kFrames_px[static_cast<std::size_t>(frame)];
  machine.platform = {width_px * machine.projection.pixel_pitch_mm, height_px * machine.projection.pixel_pitch_mm, 100,
                      0};
  machine.projection.irradiance_mw_per_cm2 = 10;
  machine.layers.thickness_mm = 0.05;
  machine.layers.exposure_s = 2.718;  // with 10 mJ/cm2 and 0.1 mm two layers deep
  return machine;
}

struct Setup {
  explicit Setup(const benchmark::State& state)
      : machine{machine_of(state.range(1))},
        frame{mask_frame(machine)},
        rings{test::plate(static_cast<test::Plate>(state.range(0)), frame.size, frame.pixel_pitch_mm)} {}
  MachineProfile machine;
  MaskFrame frame;
  std::vector<Contour> rings;
};

void raster(benchmark::State& state) {
  const Setup setup{state};
  for (auto _ : state) benchmark::DoNotOptimize(rasterise(setup.rings, setup.frame));
}

void raster_and_png(benchmark::State& state) {
  const Setup setup{state};
  for (auto _ : state) {
    const Mask mask = rasterise(setup.rings, setup.frame);
    benchmark::DoNotOptimize(encode_png_grey(mask.size.width_px, mask.size.height_px, mask.rows));
  }
}

#ifdef TELEFAB_BENCH_AGG
void raster_by_agg(benchmark::State& state) {
  const Setup setup{state};
  const double pitch = setup.frame.pixel_pitch_mm;
  for (auto _ : state) {
    const auto width = setup.frame.size.width_px, height = setup.frame.size.height_px;
    std::vector<std::uint8_t> rows(std::size_t{width} * height);
    agg::rendering_buffer buffer{rows.data(), width, height, -static_cast<int>(width)};
    agg::pixfmt_gray8 pixels{buffer};
    agg::renderer_base<agg::pixfmt_gray8> base{pixels};
    agg::rasterizer_scanline_aa<> rasterizer;
    agg::scanline_p8 scanline;
    for (const Contour& ring : setup.rings) {
      bool first = true;
      for (const Point2 p : ring.vertices()) {
        if (first)
          rasterizer.move_to_d(p.x_mm / pitch, p.y_mm / pitch);
        else
          rasterizer.line_to_d(p.x_mm / pitch, p.y_mm / pitch);
        first = false;
      }
      rasterizer.close_polygon();
    }
    agg::render_scanlines_aa_solid(rasterizer, scanline, base, agg::gray8{255});
    benchmark::DoNotOptimize(rows.data());
  }
}
#endif

void blend_one_layer(benchmark::State& state) {
  const Setup setup{state};
  const MaskBlender blender = MaskBlender::make(setup.frame, mask_light(setup.machine).value(), {}).value();
  double length_px = 0;
  for (auto _ : state) {
    const BlendedLayer layer = blender.blend({.part = setup.rings});
    length_px = layer.figures.length_px;
    benchmark::DoNotOptimize(encode_png_grey(layer.mask.size.width_px, layer.mask.size.height_px, layer.mask.rows));
  }
  state.counters["contour_px"] = length_px;
}

/// A deadline of 0.4 s as planners keep it: solving ends at nine tenths of it, what is not solved by then keeps its
/// cover.
void blend_within_a_deadline(benchmark::State& state) {
  using Watch = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds kSolving{360};
  const Setup setup{state};
  const MaskBlender blender = MaskBlender::make(setup.frame, mask_light(setup.machine).value(), {}).value();
  double most_ms = 0, unsolved = 0;
  for (auto _ : state) {
    const auto begun = Watch::now();
    BlendTask task{.part = setup.rings};
    task.out_of_time = [until = begun + kSolving] { return Watch::now() >= until; };
    const BlendedLayer layer = blender.blend(task);
    most_ms = std::max(most_ms, std::chrono::duration<double, std::milli>(Watch::now() - begun).count());
    unsolved = static_cast<double>(layer.figures.unsolved) /
               static_cast<double>(std::max<std::uint64_t>(1, layer.figures.unsolved + layer.figures.tiles));
  }
  state.counters["most_ms"] = most_ms;
  state.counters["unsolved_share"] = unsolved;
}

/// A layer within a tall stack of equal ones.
void blend_stack_layer(benchmark::State& state) {
  const Setup setup{state};
  const MaskLight light = mask_light(setup.machine).value();
  const MaskBlender blender = MaskBlender::make(setup.frame, light, {}).value();
  const CapTable table{light, 10};
  const SolidRows solid{setup.rings, {}, setup.frame};
  BlendStack stack{blender};
  const std::vector<const SolidRows*> below(static_cast<std::size_t>(table.reach()), &solid), above(10, &solid);
  const auto layer = [&] {
    const LayerCaps caps{table, solid, below, above, false};
    BlendTask task{.part = setup.rings};
    task.caps = [&](std::uint32_t y, std::span<std::uint8_t> row) { return caps.fill(y, row); };
    return stack.descend(task, 20);
  };
  for (int i = 0; i < 12; ++i) benchmark::DoNotOptimize(layer());
  for (auto _ : state) {
    const BlendedLayer made = layer();
    benchmark::DoNotOptimize(encode_png_grey(made.mask.size.width_px, made.mask.size.height_px, made.mask.rows));
  }
}

const std::vector<std::vector<std::int64_t>> kEverything{{0, 1}, {0, 1, 2}};
BENCHMARK(raster)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
#ifdef TELEFAB_BENCH_AGG
BENCHMARK(raster_by_agg)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
#endif
BENCHMARK(raster_and_png)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
BENCHMARK(blend_one_layer)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
BENCHMARK(blend_within_a_deadline)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);
BENCHMARK(blend_stack_layer)->ArgsProduct(kEverything)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace telefab::fab
