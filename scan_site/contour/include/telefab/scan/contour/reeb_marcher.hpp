// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <stop_token>
#include <telefab/base/result.hpp>
#include <telefab/geometry/contour.hpp>
#include <telefab/scan/mls/surface_samples.hpp>
#include <vector>

namespace telefab::scan {

struct MarchOptions {
  double chord_mm = 0.01;                ///< > 0; ds, the largest distance of a chord to the contour
  double longest_step_kernels = 1.5;     ///< (0, 4]; where the contour is straight, so that no detail is stepped over
  double pick_kernels = 0.5;             ///< > 0; a ring whose mean |closeness| is larger lies on a false sheet (3.3)
  double seed_reach_kernels = 1.0;       ///< > 0; how far a seed may lie from its contour
  std::size_t max_vertices = 4'000'000;  ///< a ring with more is reported open
  std::optional<std::uint64_t> most_evaluations = std::nullopt;  ///< of the field; then the march ends where it is
  [[nodiscard]] Result<void> validate() const;
};

/// Why a seed gave no contour.
struct MarchProblem {
  enum class Kind : std::uint8_t { SeedOffSurface = 1, Open = 2, FalseBranch = 3, NoArea = 4, TooLong = 5 };
  Kind kind = Kind::Open;
  Point2 place;
};

struct MarchedLayer {
  std::vector<Contour> contours;       ///< solid on the left: outer rings counter-clockwise, holes clockwise
  std::vector<MarchProblem> problems;  ///< empty when every seed's contour was closed
  std::size_t from_coverage = 0;       ///< contours (the last ones) that no seed led to, only a sample
  std::uint64_t evaluations = 0;       ///< of the field
};

/// Follows every contour of the slice at z once around from its seeds (paper 3.2.4): steps 2 sqrt(2 r ds - ds^2) from
/// the radius r of the turn before, Newton in the plane with the quotient gradient, and a step is halved until arc and
/// chord agree within ds. Seeds that lie on a contour already found are skipped, so any number a contour is right.
/// Then every given sample must lie beside a contour of like normal; what does not starts a contour of its own.
/// Threads: one cursor a thread. Deterministic. Fails: InvalidInput (options), Cancelled.
/// Cost: 1.3 to 2 evaluations a vertex.
[[nodiscard]] Result<MarchedLayer> march_contours(const ScalarField& field, FieldCursor& cursor, double z_mm,
                                                  std::span<const Vec3> seeds, const SampleView& near_plane,
                                                  const MarchOptions& options, std::stop_token stop);

/// Indices of the samples beside which, moved to the plane along their tangent planes, no contour of like normal runs
/// within `reach_kernels` of the local kernel. Level samples, which say nothing about a plane, are left out.
[[nodiscard]] std::vector<std::size_t> uncovered_samples(const ScalarField& field, double z_mm,
                                                         std::span<const Contour> contours,
                                                         const SampleView& near_plane, double reach_kernels);

}  // namespace telefab::scan
