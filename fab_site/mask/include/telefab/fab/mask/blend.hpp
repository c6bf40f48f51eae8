// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <telefab/fab/mask/mask_light.hpp>
#include <telefab/fab/mask/raster.hpp>

namespace telefab::fab {

constexpr std::uint8_t kCuredPixel = 255;
constexpr std::uint8_t kJoinedPixel = 128;

struct BlendOptions {
  int iterations = 20;         ///< 1 to 1000 steps; 20 give 95 % of what 40 give
  double regular = 1e-3;       ///< (0, 1]; pull towards the reference; from 3e-4 down islands appear at corners
  double corner_weight = 0.2;  ///< (0, 1]; of what lies within a pixel of a corner; 1 costs latitude
  double support_grey = 1.0;   ///< (0, 1]; irradiance of supports as share of white
  [[nodiscard]] Result<void> validate() const;
};

/// How well the masks meet the threshold where they were solved.
struct BlendFigures {
  double length_px = 0;        ///< contour that was solved for
  double squares_px3 = 0;      ///< its squared residuals summed along it
  std::uint64_t tiles = 0;     ///< solved
  std::uint64_t unsolved = 0;  ///< tiles that kept their cover because time was out
  void add(const BlendFigures& other);
  [[nodiscard]] double residual_px() const;  ///< root mean square
};

/// One exposure to be made. Rings as rasterise() takes them; the supports' rings must not overlap the part's.
struct BlendTask {
  std::span<const Contour> part;
  std::span<const Contour> supports;
  double exposure = 1;  ///< its time over a normal layer's
  /// Writes the most irradiance of each pixel of row y (from the front) as grey share of white and says true, or says
  /// false where the row has no caps. Empty: no caps.
  std::function<bool(std::uint32_t y, std::span<std::uint8_t> row)> caps;
  /// Asked before every tile; from the first yes on, tiles keep their cover. Empty: never. The only thing that can
  /// make masks differ from run to run.
  std::function<bool()> out_of_time;
};

struct BlendedLayer {
  Mask mask;
  BlendFigures figures;
};

/// Finds masks whose light, blurred by the optics, meets the resin's threshold on the contours: irradiances near the
/// contour are solved by bounded least squares, tile by tile with a halo, those elsewhere are white or black. What the
/// projector's curve, leak and field do is undone last. One value serves any number of threads.
class MaskBlender {
 public:
  /// Fails with InvalidInput for options out of range.
  [[nodiscard]] static Result<MaskBlender> make(const MaskFrame& frame, const MaskLight& light,
                                                const BlendOptions& options);
  ~MaskBlender();
  MaskBlender(MaskBlender&&) noexcept;
  MaskBlender& operator=(MaskBlender&&) noexcept;

  /// A layer that nothing was printed on: its own light alone.
  [[nodiscard]] BlendedLayer blend(const BlendTask& task) const;

  struct Model;

 private:
  friend class BlendStack;
  explicit MaskBlender(std::unique_ptr<const Model> model);
  std::unique_ptr<const Model> model_;
};

/// Walks down through a print: the light of later layers, seen through the layers between, is part of each layer's
/// dose, and its mask is solved for what is missing. Keeps the dose so far, in tiles that are stored only where it is
/// not even. The blender must outlive it.
class BlendStack {
 public:
  explicit BlendStack(const MaskBlender& blender);
  ~BlendStack();
  BlendStack(BlendStack&&) noexcept;
  BlendStack& operator=(BlendStack&&) noexcept;

  /// The next layer down. `iterations` 0: its bounded reference alone, for layers that are only looked through.
  [[nodiscard]] BlendedLayer descend(const BlendTask& task, int iterations);
  /// Pixels that the light so far cures down to the middle of the last layer: kCuredPixel; those that it cures a good
  /// part of the way, so that neighbours hang together over them: kJoinedPixel; others 0. Overwrites the mask.
  void mark_cured(Mask& mask) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace telefab::fab
