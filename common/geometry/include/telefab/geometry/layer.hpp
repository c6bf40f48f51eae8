// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <string>
#include <telefab/base/digest.hpp>
#include <telefab/base/quantity.hpp>
#include <telefab/geometry/certificate.hpp>
#include <telefab/geometry/contour.hpp>

namespace telefab {

/// The material of one layer: rings of a plane cut at mid-height. Rings are in canonical order
/// (see sorted_canonically). A layer without rings is legal: nothing is exposed there.
struct Layer {
  LayerIndex index;
  double z_mm = 0;  ///< height of the cut above the platform, (index + 1/2) * thickness
  std::vector<Contour> contours;
  LayerCertificate certificate;
  friend bool operator==(const Layer&, const Layer&) = default;
};

/// Lengths of a layer's contours by what they rest on.
struct SurfaceShares {
  double measured_mm = 0;
  double completed_mm = 0;
  double doubtful_mm = 0;
  double largest_gap_mm = 0;    ///< of what is completed
  double largest_error_mm = 0;  ///< of what is completed
  [[nodiscard]] double length_mm() const { return measured_mm + completed_mm + doubtful_mm; }
  /// Adds the lengths and keeps the larger gap and error.
  SurfaceShares& operator+=(const SurfaceShares& more);
  friend bool operator==(const SurfaceShares&, const SurfaceShares&) = default;
};
[[nodiscard]] SurfaceShares surface_shares(const Layer& layer);

/// The box of all contours, nothing() where there are none. A header's may be wider by what the slicer looked through.
[[nodiscard]] Bounds2 bounds_of(std::span<const Layer> layers);

/// Each ring is rotated to start at its smallest vertex (by y, then x); rings are sorted by that vertex, then by
/// area. Same rings, same order, whoever found them. Runs turn with their ring.
[[nodiscard]] std::vector<Contour> sorted_canonically(std::vector<Contour> contours);

/// Column-major-free on purpose: row-major 4x4, build_point = T * scan_point, bottom row 0 0 0 1.
using Transform4 = std::array<double, 16>;
inline constexpr Transform4 kIdentity4{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

/// What holds for a whole stack, known before the first layer is cut.
struct StackHeader {
  std::string machine;  ///< name of the profile it was sliced for
  double layer_thickness_mm = 0;
  double pixel_pitch_mm = 0;
  std::uint32_t layer_count = 0;
  Bounds2 bounds;  ///< every vertex of every layer lies inside
  Transform4 scan_to_build = kIdentity4;
  std::string scan_name;  ///< file name of the scan, for people
  friend bool operator==(const StackHeader&, const StackHeader&) = default;
  /// Finite, positive, bounds ordered, counts below the limits of limits.hpp. InvalidInput otherwise.
  [[nodiscard]] Result<void> validate() const;
};

/// The height at which a layer is cut: (index + 1/2) * thickness. The one formula, so that both sites agree.
[[nodiscard]] double cut_height_mm(LayerIndex index, double layer_thickness_mm);

/// All layers of a part, bottom first. Invariant: header valid, layers.size() == layer_count, layer i has index i
/// and the cut height of i, every vertex lies inside the bounds.
class LayerStack {
 public:
  /// Fails with InvalidInput and names the layer.
  [[nodiscard]] static Result<LayerStack> from_layers(StackHeader header, std::vector<Layer> layers);
  [[nodiscard]] const StackHeader& header() const { return header_; }
  [[nodiscard]] std::span<const Layer> layers() const { return layers_; }
  friend bool operator==(const LayerStack&, const LayerStack&) = default;

 private:
  LayerStack(StackHeader header, std::vector<Layer> layers) : header_{std::move(header)}, layers_{std::move(layers)} {}
  StackHeader header_;
  std::vector<Layer> layers_;
};

/// Checks one layer against its header as LayerStack does, and that its certificate says of its contours what their
/// runs say: a Completed layer has completed and no doubtful stretches, a Measured one neither, one Unchecked no runs,
/// and a Doubtful one alone has a doubt. For streams that never hold a whole stack.
[[nodiscard]] Result<void> validate_layer(const StackHeader& header, const Layer& layer);

/// Text with hexadecimal floats: equal text if and only if equal value. For digests and golden files.
[[nodiscard]] std::string canonical_text(const StackHeader& header);
[[nodiscard]] std::string canonical_text(const Layer& layer);
/// SHA-256 over the canonical text of the header and of every layer in order.
[[nodiscard]] Digest digest_of(const LayerStack& stack);

}  // namespace telefab
