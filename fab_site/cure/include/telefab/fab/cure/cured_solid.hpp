// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <telefab/base/progress.hpp>
#include <telefab/base/quantity.hpp>
#include <telefab/fab/cure/depth_map.hpp>

namespace telefab::fab {

/// What was shown for one layer of a print; the masks are owned here. Nothing: the layer was passed without light.
struct LitLayer {
  std::vector<Mask> masks;
  std::vector<std::chrono::nanoseconds> lit;  ///< as many
};
/// Fetches the light of a layer. Called from several threads at once, once a layer.
using LightSource = std::function<Result<LitLayer>(LayerIndex)>;

/// One layer while the solid is made. References live as long as the call.
struct CuredLayer {
  LayerIndex index;
  const CureModel& model;
  const DoseField& dose;   ///< B of this layer
  const DoseField& above;  ///< B of the layer above it; empty for the topmost
  const DepthMap& depths;
};

/// What a solid is known by. Equal digests: the same solid, sub-pixel for sub-pixel, 1/65535 of a layer deep.
struct CuredSolid {
  struct Layer {
    Digest digest;
    double volume_mm3 = 0;
  };
  std::vector<Layer> layers;  ///< of the print, from the platform up
  double volume_mm3 = 0;
  Digest digest;  ///< of the layers' digests
  /// The first layer in which two solids differ; nothing if they are the same.
  [[nodiscard]] std::optional<LayerIndex> first_difference(const CuredSolid& other) const;
};

struct CureOptions {
  int sub_pixels = 4;  ///< 1 to 16 a pixel and axis
  int threads = 0;     ///< 0 (all cores) to 1024; the solid is the same for any number
  /// For every layer, top down, from one thread, before `each` sees it: its index and B. May be empty.
  std::function<Result<void>(LayerIndex, const DoseField&)> in_order;
  /// For every layer, from several threads at once. May be empty.
  std::function<Result<void>(const CuredLayer&)> each;
  /// For every layer, top down, from one thread, after `each` has seen it. May be empty.
  std::function<void(LayerIndex)> done;
  [[nodiscard]] Result<void> validate() const;
};

/// Cures a whole print from its top layer down. Holds a few layers at a time.
/// Fails: InvalidInput (options, mask size, more than kMaxLayers), Cancelled, and whatever source and visitors fail
/// with.
[[nodiscard]] Result<CuredSolid> cure_solid(const CureModel& model, std::uint32_t layers, const LightSource& source,
                                            const CureOptions& options, const ProgressSink& progress,
                                            std::stop_token stop);

/// One time the light was on, as a machine's recorder wrote it down (MachineLog::light()).
struct LitRecord {
  Digest mask;
  double z_mm = 0;  ///< gap between platform and vat
  std::chrono::nanoseconds lit{};
};

/// The solid that a recorded print left behind: which layer a record belongs to follows from its gap, times of one
/// mask in one layer add up. So a print that was interrupted and resumed compares equal, bit for bit, with one that
/// went through if and only if every layer got the same light. `mask_of` finds a mask by its digest.
/// Fails as cure_solid does, and with InvalidInput for a gap that is no layer's.
[[nodiscard]] Result<CuredSolid> cure_recorded(const CureModel& model, std::span<const LitRecord> records,
                                               const std::function<Result<Mask>(const Digest&)>& mask_of,
                                               const CureOptions& options);

}  // namespace telefab::fab
