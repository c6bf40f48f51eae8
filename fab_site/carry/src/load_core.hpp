// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>

#include "load_path.hpp"

namespace telefab::fab {

/// The weakest section of a row of pieces, as an edge between the pieces at its ends. Node 0 is the platform.
struct CoreEdge {
  std::uint32_t a = 0, b = 0;
  std::uint32_t section = 0;
  double softness = 0;  ///< length over area, summed over the row, in 1/mm
};

/// What of a print carries the pieces of one layer, that layer being the last.
struct Moment {
  struct Load {
    std::uint32_t node = 0;
    std::int64_t pulled = 0;  ///< in kPullUnits of a pixel
    Point2 at;                ///< mm
  };
  std::uint32_t layer = 0;
  std::vector<std::uint32_t> pieces{LoadPath::kPlatform};  ///< by node
  std::vector<CoreEdge> edges;
  std::vector<Load> loads;  ///< pull and weight of what is joined to the platform
  std::int64_t afloat = 0;  ///< pulled, and joined to nothing; in kPullUnits of a pixel
};

/// The pieces of a print up to some layer as a graph without what does not matter to flows through it: rows of pieces
/// are one edge of the least area, and what ends in the resin is left out. Their weight hangs on what is left, of rows
/// on the end on its side of that section.
class LoadCore {
 public:
  /// `path` is closed and outlives this.
  explicit LoadCore(const LoadPath& path);
  /// The next layer.
  [[nodiscard]] Moment add();

 private:
  [[nodiscard]] std::uint32_t node_of(std::uint32_t piece) const {
    return path_->pieces()[piece].layer == 0 ? 0 : piece + 1;
  }
  void link(const CoreEdge& edge);
  std::vector<std::uint32_t>& edges_at(std::uint32_t node);
  void shorten(std::uint32_t node, std::uint32_t top_first);
  void hang(std::uint32_t node, std::uint32_t on);
  [[nodiscard]] Moment moment(std::uint32_t layer);

  /// Weight and, times it, its place.
  struct Weight {
    double units = 0, x_mm = 0, y_mm = 0;
  };

  const LoadPath* path_;
  std::uint32_t next_ = 0;
  std::vector<CoreEdge> edges_;
  std::vector<char> is_gone_;                   ///< by edge
  std::vector<std::vector<std::uint32_t>> at_;  ///< edges by node; some may have gone
  std::vector<Weight> weight_;                  ///< by node
  std::vector<std::uint32_t> number_;           ///< of a node in the moment under way, or none
};

}  // namespace telefab::fab
