// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <memory>
#include <stop_token>

#include "hermite_field.hpp"
#include "measured_side.hpp"

namespace telefab::scan {

/// How the surface goes on across wide gaps: for each gap, the smoothest function through a belt of samples about its
/// rims. Two rims that look at each other through air, as the ends of a limb that was cut through, bound one gap. Const
/// methods from any thread.
class GapFields {
 public:
  /// A gap has a function where it is wide enough to need one and where that foretells the samples it was not given.
  /// Fails: Cancelled. Cost: .02 s a gap.
  [[nodiscard]] static Result<GapFields> about(const MeasuredSide& measured, std::span<const Rim> rims,
                                               std::stop_token stop);
  [[nodiscard]] std::size_t count() const { return gaps_.size(); }
  /// Rims of gaps that have a function, and the others; in the order given.
  [[nodiscard]] std::vector<Rim> rims(bool with_function) const;

  /// The gap with a function whose rim is the nearest. There must be one.
  [[nodiscard]] std::size_t gap_at(const Eigen::Vector3f& place) const;
  [[nodiscard]] HermiteField::Value value(std::size_t gap, const Eigen::Vector3f& place) const {
    return gaps_[gap].field->at(place);
  }
  /// How far from a place of the surface functions through half of the belt see it.
  [[nodiscard]] float opinions(std::size_t gap, const Eigen::Vector3f& place) const;
  /// A surface that closes the gap lies no farther from the samples.
  [[nodiscard]] float farthest(std::size_t gap) const { return gaps_[gap].farthest; }
  /// Forgets the functions of these gaps.
  void drop(const std::vector<bool>& gaps);

 private:
  struct Gap {
    std::optional<HermiteField> field;
    std::array<std::optional<HermiteField>, 2> halves;
    float farthest = 0;
  };
  [[nodiscard]] bool has_function(std::size_t rim) const {
    return gap_of_rim_[rim] >= 0 && gaps_[static_cast<std::size_t>(gap_of_rim_[rim])].field;
  }
  void index_rims();

  std::vector<Rim> rims_;
  std::vector<Eigen::Vector3f> places_;   ///< of the rims' samples
  std::vector<std::int32_t> gap_of_rim_;  ///< -1: none
  std::vector<Gap> gaps_;
  std::vector<std::int32_t> gap_of_near_;  ///< of the rims of near_
  std::unique_ptr<KdTree> near_;           ///< rims of gaps that have a function
};

}  // namespace telefab::scan
