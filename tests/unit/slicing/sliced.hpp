// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/test/analytic_field.hpp>
#include <telefab/test/surface_samples.hpp>

// What tests of slicing share: a small machine, scans as text, and a scan sliced.
namespace telefab::scan {

inline MachineProfile machine() {
  MachineProfile m;
  m.name = "bench";
  m.platform = {60, 40, 50};
  m.projection.pixel_pitch_mm = 0.1;
  m.layers.thickness_mm = 0.5;
  return m;
}

/// A text scan: x y z nx ny nz, one point a line.
inline std::string text_of(const test::SurfaceSamples& samples) {
  std::string text;
  for (std::size_t i = 0; i < samples.points.size(); ++i) {
    const Vec3& p = samples.points[i];
    const Vec3& n = samples.normals[i];
    text += fmt::format("{} {} {} {} {} {}\n", p.x(), p.y(), p.z(), n.x(), n.y(), n.z());
  }
  return text;
}

inline const std::string& torus_text() {
  static const std::string text =
      text_of(test::sample_surface(*test::torus(9, 4, 90, 1, {100, 200, -300}), {.spacing_mm = 0.7, .seed = 11}));
  return text;
}

struct Outcome {
  Result<SliceReport> report;
  std::vector<Layer> layers;
  std::string text;  ///< canonical
};

inline Outcome slice(const std::string& scan, const SliceRequest& request, std::stop_token stop = {}) {
  Outcome outcome;
  const LayerSink sink = [&](const StackHeader& header, Layer&& layer) -> Result<void> {
    EXPECT_TRUE(validate_layer(header, layer));
    outcome.text += canonical_text(layer);
    outcome.layers.push_back(std::move(layer));
    return {};
  };
  outcome.report = slice_scan(std::as_bytes(std::span{scan}), "torus.xyz", request, sink, {}, stop);
  return outcome;
}

inline SliceRequest request_for(unsigned threads = 2) {
  SliceRequest request;
  request.machine = machine();
  request.threads = threads;
  return request;
}

}  // namespace telefab::scan
