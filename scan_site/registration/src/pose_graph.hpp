// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <telefab/scan/registration/join_views.hpp>
#include <utility>
#include <vector>

#include "pose_judge.hpp"

namespace telefab::scan {

/// Series as nodes, poses between two of them as edges. Finds the edges, then joins along the best ones; each join is
/// judged for the whole bodies on its two sides, so that what two views alone cannot tell waits until more are there.
class PoseGraph {
 public:
  /// The spans and references must live on; what `reports` names as a copy takes no part. Writes into `reports`.
  PoseGraph(std::span<const RangeImage> views, const std::vector<ViewSeries>& series,
            std::vector<SeriesReport>& reports, const JoinOptions& options);

  /// Every pair of series: coarse poses, aligned. Then what the noise of the scan is. Fails: Cancelled.
  [[nodiscard]] Result<void> find_candidates(const ProgressSink& progress, const std::stop_token& stop);
  /// Grows bodies, best fits first, and reports what stays outside the largest. Fails: Cancelled.
  [[nodiscard]] Result<void> join_best_first(const std::stop_token& stop);
  /// Views of the largest body in rising order, view to its frame.
  [[nodiscard]] std::vector<std::pair<std::size_t, RigidMotion>> poses() const;
  /// Judges every series of the body against the rest of it at adjusted poses (in the order of `poses()`); leaves out
  /// the one that misfits most. False: all fit.
  [[nodiscard]] bool drop_what_misfits(std::span<const RigidMotion> adjusted);
  [[nodiscard]] const SurfaceFit& noise() const { return noise_; }
  /// The noise is guessed from single views: neither turns nor third views could tell it.
  [[nodiscard]] bool has_guessed_noise() const { return noise_source_ == NoiseSource::Halves; }

 private:
  /// Turns on their own; pairs of views that third ones confirm; the halves of single views.
  enum class NoiseSource { Turns, Pairs, Halves };
  struct Candidate {
    std::size_t a = 0, b = 0;
    RigidMotion b_to_a;
    PoseFigures figures;
    double score = 0;
    std::size_t support = 0;  ///< third series by way of which the same pose is found
  };
  /// Series that were joined.
  struct Body {
    std::vector<std::size_t> series;
    std::vector<RigidMotion> poses;  ///< series to body
    std::unique_ptr<ViewGroup> group;
  };
  struct Hypothesis {
    RigidMotion b_to_a;
    PoseFigures figures;
    double score = 0;
  };
  struct Attempt {
    JoinVerdict verdict = JoinVerdict::NoPose;
    Hypothesis best;
    double runner_up = 0;
    std::vector<double> equal_turns_deg;
    SurfaceFit noise;
  };

  [[nodiscard]] std::vector<Candidate> candidates_of(std::size_t a, std::size_t b, const std::stop_token& stop) const;
  void set_noise();
  void count_support();
  [[nodiscard]] double score_of(const PoseFigures& figures) const;
  [[nodiscard]] bool is_same_pose(const RigidMotion& a, const RigidMotion& b, const Vec3& at) const;
  [[nodiscard]] SurfaceFit noise_of(std::span<const std::size_t> series) const;
  [[nodiscard]] std::vector<Hypothesis> hypotheses(const Body& a, const Body& b, const std::stop_token& stop) const;
  /// Turns of `b` about the whole's axes of inertia, where they fit, put behind the hypotheses there are.
  void add_symmetries(const Body& a, const Body& b, std::vector<Hypothesis>& list, const std::stop_token& stop) const;
  [[nodiscard]] Attempt attempt(const Body& a, const Body& b, const std::stop_token& stop) const;
  [[nodiscard]] JoinVerdict judge(const PoseFigures& figures, const SurfaceFit& noise, double spread,
                                  std::size_t support) const;
  [[nodiscard]] std::size_t support_between(const Body& a, const Body& b) const;
  [[nodiscard]] bool carries_onto_itself(const ViewGroup& whole, const RigidMotion& motion,
                                         const SurfaceFit& noise) const;
  void merge(std::size_t a, std::size_t b, const RigidMotion& b_to_a);
  void report(std::size_t series, const Attempt& found);

  std::span<const RangeImage> views_;
  const std::vector<ViewSeries>& series_;
  std::vector<SeriesReport>& reports_;
  const JoinOptions& options_;
  std::vector<AlignTarget> targets_;
  ViewSet set_;
  double cell_ = 0;
  std::vector<std::unique_ptr<ViewGroup>> groups_;    ///< one a series; none for a copy
  std::vector<std::unique_ptr<CoarseShape>> coarse_;  ///< one a series, while candidates are searched
  std::vector<std::optional<SurfaceFit>> own_noise_;  ///< one a series, of those with several views
  SurfaceFit noise_;                                  ///< of the whole scan
  NoiseSource noise_source_ = NoiseSource::Halves;
  std::vector<Candidate> candidates_;
  std::vector<Body> bodies_;
};

}  // namespace telefab::scan
