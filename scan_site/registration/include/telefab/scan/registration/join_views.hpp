// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/scan/registration/register_views.hpp>
#include <vector>

namespace telefab::scan {

/// Views that keep their places to each other while they are joined to others: a registered turn, or one view alone.
struct ViewSeries {
  std::string name;                ///< for the report
  std::vector<std::size_t> views;  ///< indices; no view is of two series
  std::vector<RigidMotion> poses;  ///< view to the frame of the series, one a view
};

/// What was found about one series. Sentences are made of it by `sentence_of`.
enum class JoinVerdict : std::uint8_t {
  Fits = 1,
  SameScan,     ///< it is another one given again
  NoPose,       ///< no pose was found at which anything fits
  ThinOverlap,  ///< too little is seen by both
  Misfit,       ///< the surfaces differ by more than the noise of the scan
  SeenThrough,  ///< points stand where another view saw through
  Slides,       ///< it may move along itself without a change
  Ambiguous,    ///< several poses fit equally well
};
[[nodiscard]] std::string_view name_of(JoinVerdict verdict);

/// The figures of the best pose found, against all others that were joined, and what they are held against.
struct SeriesReport {
  std::string name;
  std::size_t views = 0;
  JoinVerdict verdict = JoinVerdict::NoPose;
  std::optional<std::size_t> same_as;   ///< SameScan: index of the series it repeats
  double overlap = 0;                   ///< share of the smaller surface that lies on the other
  double rms = 0;                       ///< point to plane against the others' views, unit of the files
  double patch_rms = 0;                 ///< the same of means over patches of six spacings
  double noise = 0, patch_noise = 0;    ///< both between views whose poses are right: the scan's own
  std::optional<double> conflict;       ///< share of points that others saw through; unset: free space not tested
  double stiffness = 0;                 ///< least eigenvalue of the fit, 0 to 1/3; near 0 it may slide
  double runner_up = 0;                 ///< score of the next best pose over that of the best; 0: there is none
  std::vector<double> equal_turns_deg;  ///< turns between the poses that fit equally well
  [[nodiscard]] bool is_joined() const { return verdict == JoinVerdict::Fits; }
};

struct JoinOptions {
  double max_rms = 0;           ///< > 0; budget of the whole, unit of the files
  double min_overlap = 0.25;    ///< (0, 1]; of one series with the others
  double max_rms_ratio = 1.35;  ///< > 1; rms and patch rms over the scan's own of turns; for single views somewhat more
  double max_conflict = 0.005;  ///< [0, 1]; of one series with the others
  double min_stiffness = 0.0015;  ///< [0, 1/3]
  bool accept_symmetry = false;   ///< takes the best of equal poses if each carries the whole onto itself
  std::uint64_t seed = 1;         ///< of the search; same input, same seed, same answer
  [[nodiscard]] Result<void> validate() const;
};

struct Joined {
  std::vector<std::size_t> kept;  ///< indices of the views that were joined, rising
  Registration registration;      ///< of the kept views, in that order, frame of the first
  std::vector<SeriesReport> series;
  double noise = 0;               ///< the scan's own, see SeriesReport
  bool noise_is_guessed = false;  ///< from within the views: neither turns nor third views could tell it
};

/// Joins series and single views of one object in any poses: coarse poses by features, fine ones by ICP, best fits
/// first; then all poses at once by `register_views`. What does not fit is left out and named in the report; a series
/// of several views is never left out, nor half of the views. Turns the normals of single range images when they turn
/// out to face inward, and erases from `views` those left out. Unit of the files. Same input, same bytes on any number
/// of threads.
/// Fails: InvalidInput (options, fewer than two series), NotConverged (with what to do about it), Cancelled.
[[nodiscard]] Result<Joined> join_views(std::vector<RangeImage>& views, const std::vector<ViewSeries>& series,
                                        const JoinOptions& options, const ProgressSink& progress, std::stop_token stop);

/// What was found about a series and what to do about it, for people.
[[nodiscard]] std::string sentence_of(const SeriesReport& report, const std::vector<SeriesReport>& all);
/// One JSON array, fixed key order.
[[nodiscard]] std::string to_json(const std::vector<SeriesReport>& series);

}  // namespace telefab::scan
