// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <telefab/scan/mls/mls_field.hpp>
#include <telefab/scan/topology/height_topology.hpp>

#include "layer_cutter.hpp"

namespace telefab::bench {

[[nodiscard]] std::unique_ptr<scan::MlsField> surface_of(scan::PointCloud cloud);
[[nodiscard]] scan::HeightTopology topology_of(const scan::MlsField& field);
/// As slicing sets it up. `surface` is what is cut, `field` knows the samples: both are one, or a reference's.
[[nodiscard]] scan::CutSetting setting_for(const scan::ScalarField& surface, const scan::MlsField& field,
                                           const scan::HeightTopology& topology);

/// Heights of `layers` layers through all the samples.
struct LayerRange {
  double low_mm = 0;
  double high_mm = 0;
  std::uint32_t layers = 0;
  std::uint32_t first = 0;                          ///< of those cut
  std::optional<std::uint32_t> end = std::nullopt;  ///< one after the last of them; none: all
};

struct Cut {
  std::uint64_t layers = 0;
  std::uint64_t certified = 0;
  std::uint64_t vertices = 0;
  std::uint64_t evaluations = 0;
};
/// On as many threads as the arena has.
[[nodiscard]] Cut cut_layers(const scan::CutSetting& setting, const LayerRange& range);

}  // namespace telefab::bench
