// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/mask/blend.hpp>

#include "dose_tiles.hpp"
#include "spot_weights.hpp"

namespace telefab::fab {

/// What all layers of a machine share. Doses are shares of a normal white dose.
struct MaskBlender::Model {
  MaskFrame frame;
  MaskLight light;
  BlendOptions options;
  SpotWeights weights;
  GreyEncoder encode;
  std::array<std::uint8_t, 256> grey_of_share{};
  std::array<float, 256> tone{};
  double edge_slope;  ///< of a straight white edge, per pixel
  double inwards_px;  ///< how far a straight edge grows when it is drawn by cover
  float target;
  float passed;
  float attach;
  int halo;
  int side;

  Model(const MaskFrame& frame, const MaskLight& light, const BlendOptions& options);
};

/// Draws and solves one layer. With `above`, the dose seen from it is added and it is moved one layer down.
[[nodiscard]] BlendedLayer work_on_layer(const MaskBlender::Model& model, const BlendTask& task, int iterations,
                                         DoseTiles* above);

}  // namespace telefab::fab
