// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <telefab/fab/mask/mask.hpp>
#include <telefab/fab/mask/pixel_runs.hpp>
#include <telefab/geometry/contour.hpp>
#include <vector>

namespace telefab::fab {

/// The solid pixels of one layer as runs, row by row from the front of the platform (smallest y) to its back.
/// Invariant: the runs of a row are sorted and do not touch; columns lie in [0, width_px).
class LayerRuns {
 public:
  LayerRuns() = default;
  /// Pixels of a mask at or above that grey level.
  [[nodiscard]] static LayerRuns from_mask(const MaskView& mask, std::uint8_t level);
  /// Pixels whose centre lies inside the rings by a positive winding number, on the raster of a machine.
  [[nodiscard]] static LayerRuns from_contours(std::span<const Contour> contours, PixelSize size, double pitch_mm);

  /// The same pixels; as many rows as the size has.
  [[nodiscard]] static LayerRuns from_rows(const PixelRuns& rows, PixelSize size);
  [[nodiscard]] PixelRuns rows() const;

  /// Some of the runs of another layer, by their index there; `keep` has an entry a run.
  [[nodiscard]] static LayerRuns some_of(const LayerRuns& layer, const std::vector<char>& keep);

  /// The other pixels.
  [[nodiscard]] LayerRuns complement() const;
  [[nodiscard]] PixelSize size() const { return size_; }
  [[nodiscard]] bool contains(std::int32_t column, std::uint32_t y) const;
  [[nodiscard]] std::span<const PixelRun> row(std::uint32_t y) const;
  [[nodiscard]] const PixelRun& run(std::uint32_t i) const { return runs_[i]; }
  /// Index of the first run of a row among all runs.
  [[nodiscard]] std::uint32_t row_start(std::uint32_t y) const { return starts_[y]; }
  [[nodiscard]] std::uint32_t count() const { return static_cast<std::uint32_t>(runs_.size()); }
  friend bool operator==(const LayerRuns&, const LayerRuns&) = default;

 private:
  PixelSize size_;
  std::vector<PixelRun> runs_;
  std::vector<std::uint32_t> starts_;
};

/// Connected components of runs.
struct RunComponents {
  struct Component {
    std::uint64_t pixels = 0;
    std::int32_t column = 0;    ///< of its first pixel
    std::uint32_t row = 0;      ///< of its first pixel
    bool touches_edge = false;  ///< of the raster
  };
  std::vector<std::uint32_t> of_run;  ///< component of every run
  std::vector<Component> components;  ///< in the order of their first runs
};

/// With `diagonal`, pixels that share only a corner are connected.
[[nodiscard]] RunComponents components_of(const LayerRuns& layer, bool diagonal);

/// Calls `meet(run of a, run of b)` for every two runs that share a pixel column in the same row.
template <class Meet>
void for_overlaps(const LayerRuns& a, const LayerRuns& b, Meet meet) {
  for (std::uint32_t y = 0; y < a.size().height_px && y < b.size().height_px; ++y) {
    const auto p = a.row(y), q = b.row(y);
    for (std::size_t i = 0, j = 0; i < p.size() && j < q.size();) {
      if (p[i].meets(q[j]))
        meet(a.row_start(y) + static_cast<std::uint32_t>(i), b.row_start(y) + static_cast<std::uint32_t>(j));
      if (p[i].behind < q[j].behind)
        ++i;
      else
        ++j;
    }
  }
}

}  // namespace telefab::fab
