// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <telefab/base/file.hpp>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/codec/tfc_file.hpp>

#include "seeds.hpp"

// Writes the seeds of fuzz_chunk and fuzz_tfc intra: `codec_seeds tests/fuzz/corpus`, once after every change of a
// coding.
namespace telefab {
namespace {

/// Eight layers with the fuzzers' header: waved rings that move, one with a hole, two that merge.
LayerStack some_stack(int kind) {
  StackHeader header;
  header.machine = "m";
  header.layer_thickness_mm = 0.15;
  header.pixel_pitch_mm = 0.14;
  header.layer_count = 8;
  header.bounds = {{0, 0}, {260, 160}};
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < header.layer_count; ++i) {
    const auto ring = [&](double x, double radius, int waves, bool hole) {
      std::vector<Point2> vertices;
      for (int k = 0; k < 48; ++k) {
        const double t = (hole ? -1 : 1) * 6.283185307 * k / 48;
        const double r = radius * (1 + 0.1 * std::sin(waves * t + 0.3 * i));
        vertices.push_back({x + r * std::cos(t), 60 + 0.4 * i + r * std::sin(t)});
      }
      return Contour::from_vertices(vertices).value();
    };
    Layer layer{LayerIndex{i}, (i + 0.5) * 0.15, {}, {}};
    if (kind == 0) layer.contours = {ring(60 + 0.2 * i, 12, 3, false)};
    if (kind == 1) layer.contours = {ring(60, 14 + 0.3 * i, 5, false), ring(60, 5, 2, true)};
    if (kind == 2 && i < 4) layer.contours = {ring(50 + i, 6, 2, false), ring(70 - i, 6, 2, false)};
    if (kind == 2 && i >= 4) layer.contours = {ring(60, 13, 2, false)};
    layer.contours = sorted_canonically(std::move(layer.contours));
    const auto euler = kind == 1 ? 0 : kind == 2 && i < 4 ? 2 : 1;
    layer.certificate = {LayerCertificate::Verdict::Measured,
                         LayerCertificate::Method::Reeb,
                         LayerCertificate::Ground::Graph,
                         euler,
                         euler,
                         {}};
    layers.push_back(std::move(layer));
  }
  return LayerStack::from_layers(std::move(header), std::move(layers)).value();
}

}  // namespace

Result<void> write_seeds(const std::filesystem::path& corpus) {
  for (const auto& [coding, name] : {std::pair{Coding::Curve, "curve"}, std::pair{Coding::Exact, "exact"}})
    for (int kind = 0; kind < 3; ++kind) {
      const LayerStack stack = some_stack(kind);
      const CodecOptions options{.coding = coding};
      const auto file = write_tfc(stack, options);
      if (!file) return tl::unexpected{file.error()};
      const std::string seed = fmt::format("{}-{}.bin", name, kind);
      if (auto ok = write_file_atomically(corpus / "tfc" / seed, *file); !ok) return ok;
      auto encoder = StackEncoder::start(stack.header(), options);
      if (!encoder) return tl::unexpected{encoder.error()};
      for (const Layer& layer : stack.layers()) {
        const auto chunk = encoder->add(layer);
        if (!chunk) return tl::unexpected{chunk.error()};
      }
      const auto last = encoder->finish();
      if (!last) return tl::unexpected{last.error()};
      if (*last)
        if (auto ok = write_file_atomically(corpus / "chunk" / seed, (*last)->payload); !ok) return ok;
    }
  return {};
}

}  // namespace telefab
