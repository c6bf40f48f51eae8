// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/verify/layer_runs.hpp>

namespace telefab::fab {

/// A space in a print that nothing joins to the outside, followed upwards through the layers.
struct Hollow {
  enum class Kind : std::uint8_t {
    Cup = 1,   ///< closed towards the platform while it is printed
    Trap = 2,  ///< closed all around
  };
  Kind kind = Kind::Cup;
  std::uint32_t first = 0, last = 0;  ///< layers
  std::int32_t column = 0;            ///< of its first pixel
  std::uint32_t row = 0;              ///< of its first pixel
  std::uint64_t most_pixels = 0;      ///< of a layer
  bool holds_support = false;
};

/// Watches the solid pixels of a print go by, bottom first, and follows what they leave empty: the 4-connected empty
/// pixels of a layer and of the next that overlap are one space, the outside is what reaches the raster's edge. The
/// platform closes what the first layer encloses.
class HollowWatch {
 public:
  /// Hollows of fewer pixels in every layer, and of one layer only, are not listed.
  explicit HollowWatch(std::uint32_t least_pixels) : least_{least_pixels} {}

  /// The next layer; all have the same size. `removable`, if given, are the pixels of supports that `solid` does not
  /// hold.
  void add(const LayerRuns& solid, const LayerRuns* removable = nullptr);

  /// Where the layer added last opens a hollow that is closed below.
  struct Opening {
    std::uint32_t first_run = 0;  ///< of the empty ones of the layer; what is solid to its left encloses the opening
    std::vector<std::uint32_t> runs;  ///< all of it
    std::uint32_t since = 0;          ///< the layer in which the hollow begins
  };
  [[nodiscard]] std::vector<Opening> openings() const;
  /// The empty pixels of the layer added last.
  [[nodiscard]] const LayerRuns& empty() const { return empty_; }

  /// After the last layer, what was found, in no particular order: what is still open upwards then drains and was a
  /// cup.
  [[nodiscard]] std::vector<Hollow> finish();

 private:
  struct Space {
    std::uint32_t parent = 0;
    bool open = false;  ///< to the outside, at or below the layer looked at last
    bool was_cup = false;
    Hollow hollow;
  };
  [[nodiscard]] std::uint32_t root(std::uint32_t i) const;
  void join(std::uint32_t a, std::uint32_t b);
  void list_cup(Space& space);

  std::uint32_t least_;
  std::uint32_t layers_ = 0;
  LayerRuns empty_;
  RunComponents gaps_;                       ///< of empty_
  std::vector<std::uint32_t> space_of_run_;  ///< of empty_
  std::vector<Space> spaces_;
  std::vector<Hollow> found_;
};

}  // namespace telefab::fab
