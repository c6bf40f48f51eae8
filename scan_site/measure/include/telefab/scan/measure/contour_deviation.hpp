// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/geometry/layer.hpp>
#include <unordered_map>
#include <vector>

namespace telefab::scan {

/// The edges of a layer in square cells, so that the distance of a place to them is found among few.
class ContourEdges {
 public:
  /// `cell_mm` > 0: no larger distance is told apart.
  ContourEdges(std::span<const Contour> contours, double cell_mm);
  /// To the nearest edge; `cell_mm` where none is nearer.
  [[nodiscard]] double distance_mm(Point2 place) const;

 private:
  struct Edge {
    Point2 from, to;
  };
  void add(const Edge& edge);

  double cell_mm_;
  std::unordered_map<std::uint64_t, std::vector<Edge>> cells_;
};

/// How far the contours of a stack lie from those of another, sizes without sign.
struct ContourDeviation {
  double mean_mm = 0;
  double p95_mm = 0;
  double max_mm = 0;
  std::size_t places = 0;  ///< compared
  std::uint64_t reference_rings = 0;
  std::uint64_t rings = 0;
  std::uint32_t layers = 0;        ///< of both
  std::uint32_t other_counts = 0;  ///< of them, with another number of rings
};

struct ContourMeasure {
  double step_mm = 0.05;  ///< > 0; distance of the places along contours
  double most_mm = 1;     ///< > 0; what is farther, or has no counterpart, counts as this
  [[nodiscard]] Result<void> validate() const;
};

/// Places along the contours of either stack, each against the contours of the other's layer of the same index.
/// Fails: InvalidInput (options; stacks of different numbers of layers, or none; no contours), Cancelled. Same figures
/// on any number of threads.
[[nodiscard]] Result<ContourDeviation> measure_contours(std::span<const Layer> reference, std::span<const Layer> built,
                                                        const ContourMeasure& options, std::stop_token stop);

/// Lengths in millimetres and, where `pixel_mm` is above 0, in pixels.
[[nodiscard]] std::string to_json(const ContourDeviation& deviation, double pixel_mm);

}  // namespace telefab::scan
