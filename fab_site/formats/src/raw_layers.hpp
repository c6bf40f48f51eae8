// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <map>
#include <optional>
#include <telefab/base/result.hpp>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// A closed ring as a file has it: last vertex not repeated, any direction, millimetres.
struct RawRing {
  std::uint32_t part = 1;
  std::optional<bool> hole;  ///< what the file says, where it says so
  std::vector<Point2> vertices;
};

struct RawLayer {
  double top_mm = 0;
  std::vector<RawRing> rings;
  std::uint64_t vertices = 0;
};

/// Layers by height, as readers find them. Limits of limits.hpp hold.
class RawLayers {
 public:
  /// The layer with this upper side (within 0.1 micrometres), made where there is none.
  /// Fails: InvalidInput (height not finite or beyond 10 m), TooLarge.
  [[nodiscard]] Result<RawLayer*> at(double top_mm);
  /// Fails: InvalidInput (a coordinate not finite or beyond 10 m), TooLarge.
  [[nodiscard]] static Result<void> add(RawLayer& layer, RawRing ring);

  [[nodiscard]] std::map<std::int64_t, RawLayer>& layers() { return layers_; }
  [[nodiscard]] const std::map<std::int64_t, RawLayer>& layers() const { return layers_; }

  std::optional<double> bottom_mm;  ///< lower side of the lowest layer, where the file says so
  std::uint64_t skipped_hatches = 0;
  bool heights_in_millionths = false;  ///< of the file, which are multiplied here

 private:
  std::map<std::int64_t, RawLayer> layers_;  ///< by steps of 0.1 micrometres
};

}  // namespace telefab::fab
