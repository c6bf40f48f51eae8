// SPDX-License-Identifier: GPL-3.0-or-later
#include "stages.hpp"

#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdlib>
#include <vector>

namespace telefab::bench {

using namespace scan;

namespace {
constexpr double kChordMm = 0.014;
constexpr std::uint32_t kBlock = 8;

template <class T>
T checked(Result<T> result) {
  if (!result) std::abort();
  return std::move(*result);
}
}  // namespace

std::unique_ptr<MlsField> surface_of(PointCloud cloud) {
  return checked(MlsField::from_cloud(std::move(cloud), MlsOptions{}, {}));
}

HeightTopology topology_of(const MlsField& field) {
  const auto from = [&](double least_nz) {
    SurfaceSamples level;
    field.level_samples(least_nz, level);
    return checked(analyse_height(field, level, {}, {}));
  };
  if (field.sample_count() > 500'000) {
    HeightTopology found = from(TopologyOptions{}.min_start_nz);
    if (found.inconsistencies().empty() && found.plateaus().empty()) return found;
  }
  return from(0.42);
}

CutSetting setting_for(const ScalarField& surface, const MlsField& field, const HeightTopology& topology) {
  return {
      .field = surface,
      .topology = &topology,
      .samples = [&field](double low, double high, SurfaceSamples& found) { field.samples_between(low, high, found); },
      .band_mm = 0.6 * field.widest_kernel_mm(),
      .chord_mm = kChordMm,
      .surface = {}};
}

Cut cut_layers(const CutSetting& setting, const LayerRange& range) {
  const std::uint32_t count = std::min(range.end.value_or(range.layers), range.layers) - range.first;
  std::vector<Cut> cuts(count);
  tbb::enumerable_thread_specific<std::unique_ptr<LayerCutter>> cutters;
  tbb::parallel_for(tbb::blocked_range<std::uint32_t>{0, (count + kBlock - 1) / kBlock, 1}, [&](const auto& blocks) {
    auto& cutter = cutters.local();
    if (!cutter) cutter = std::make_unique<LayerCutter>(setting);
    for (std::uint32_t k = blocks.begin() * kBlock; k < std::min(count, blocks.end() * kBlock); ++k) {
      const std::uint32_t layer = range.first + k;
      const double z = range.low_mm + (layer + 0.5) / range.layers * (range.high_mm - range.low_mm);
      const CutLayer cut = checked(cutter->cut(LayerIndex{layer}, z, {}));
      cuts[k].layers = 1;
      cuts[k].certified = cut.layer.certificate.is_certified() ? 1 : 0;
      for (const Contour& c : cut.layer.contours) cuts[k].vertices += c.vertices().size();
      cuts[k].evaluations = cut.evaluations;
    }
  });
  Cut sum;
  for (const Cut& c : cuts) {
    sum.layers += c.layers;
    sum.certified += c.certified;
    sum.vertices += c.vertices;
    sum.evaluations += c.evaluations;
  }
  return sum;
}

}  // namespace telefab::bench
