// SPDX-License-Identifier: GPL-3.0-or-later
#include "pose_graph.hpp"

#include <tbb/parallel_for.h>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <telefab/base/median.hpp>

#include "free_space.hpp"

namespace telefab::scan {
namespace {

constexpr double kCellsAcross = 60;  ///< of the diagonal of a typical series
constexpr std::uint32_t kDrawsOfSeries = 150'000, kDrawsOfViews = 50'000;
constexpr std::size_t kAlignedOfSeries = 16, kAlignedOfViews = 6;
constexpr std::size_t kAlignedOfClouds = 32;        ///< no eye sorts out those that only lie on each other
constexpr std::size_t kFreeMeans = 300;             ///< means of either side held against the other's views
constexpr double kCoarseClearance = 1.5;            ///< cells
constexpr double kFirstReach = 2.5;                 ///< cells
constexpr double kLastReach = 3;                    ///< spacings
constexpr double kSameTurnDeg = 3, kSameShift = 3;  ///< degrees, spacings: one pose
constexpr double kCycleTurnDeg = 3, kCycleShift = 5;
constexpr double kLeastOverlap = 0.12;  ///< of an edge worth keeping
constexpr double kScoreRms = 0.3;       ///< spacings at which a fit counts for half
constexpr double kScoreConflict = 5;
constexpr double kSupportedOverlap = 0.15;  ///< enough where third views say the same
constexpr std::size_t kHypothesesOfBodies = 6;
constexpr double kEqualOverlap = 0.8, kEqualRms = 1.5, kEqualConflict = 0.005;
constexpr double kCorrelated = 3;         ///< noise between two views over that between the halves of one,
constexpr double kCorrelatedPatches = 7;  ///< and of its patches
/// Scans without noise differ by how views sample a curve, and their patches, in spacings: less tells no shape from
/// another.
constexpr double kLeastRms = 0.02, kLeastPatches = 0.01;
constexpr double kSpreadOfPairs = 1.4;      ///< of the noise between single views, pair by pair,
constexpr double kSpreadOfViews = 1.15;     ///< and of each against all others
constexpr double kExactPairs = 0.25;        ///< share of the pairs found that are surely exact
constexpr std::size_t kLeastForMedian = 5;  ///< views of which one that is wrong does not set the median
constexpr double kSameScanRms = 0.25;       ///< of the noise: only the same points fit so well
constexpr double kSameScanOverlap = 0.97;
constexpr std::array kSymmetricTurnsDeg{180.0, 120.0, 90.0, 72.0, 60.0, 45.0};  ///< about the axes of inertia
constexpr double kSweepDeg = 5, kAlikeInertia = 0.85;
constexpr std::size_t kSymmetriesFitted = 24;
constexpr double kOntoItself = 0.8;  ///< share of the whole that a symmetry carries onto itself

/// Side of the box that holds all but one in a hundred of the points on each side: strays must not set the size.
double robust_diagonal(std::span<const Eigen::Vector3f> points) {
  Vec3 size = Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<float> along;
    along.reserve(points.size());
    for (const Eigen::Vector3f& p : points) along.push_back(p[axis]);
    std::sort(along.begin(), along.end());
    const std::size_t cut = along.size() / 100;
    if (!along.empty()) size[axis] = static_cast<double>(along[along.size() - 1 - cut] - along[cut]);
  }
  return size.norm();
}

/// The value that this share of them is below.
double quantile(std::vector<double> values, double share) {
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Whether what a motion does at a place differs by less from what another does there.
bool are_near(const RigidMotion& a, const RigidMotion& b, const Vec3& at, double degrees, double shift) {
  const MotionDifference d = difference(a, b, at);
  return d.degrees < degrees && d.shift < shift;
}

double conflict_of_means(const ViewSet& set, const CoarseShape& seen, const ViewGroup& by,
                         const RigidMotion& seen_to_by, double clearance) {
  FreeSpace found;
  const std::size_t step = std::max<std::size_t>(1, seen.means().points.size() / kFreeMeans);
  for (std::size_t m = 0; m < by.members().size(); ++m)
    found += judge_points(seen.means().points, {}, step, by.poses()[m].inverse() * seen_to_by,
                          set.views[by.members()[m]], clearance);
  return found.judged == 0 ? 0 : static_cast<double>(found.conflicting) / static_cast<double>(found.judged);
}

}  // namespace

PoseGraph::PoseGraph(std::span<const RangeImage> views, const std::vector<ViewSeries>& series,
                     std::vector<SeriesReport>& reports, const JoinOptions& options)
    : views_{views}, series_{series}, reports_{reports}, options_{options} {
  targets_.reserve(views.size());
  double spacing = 0;
  for (const RangeImage& v : views) {
    targets_.emplace_back(v.points, v.normals);
    spacing = std::max(spacing, static_cast<double>(v.spacing));
  }
  set_ = {views_, targets_, spacing};
  groups_.resize(series.size());
  own_noise_.resize(series.size());
  tbb::parallel_for(std::size_t{0}, series.size(), [&](std::size_t s) {
    if (reports_[s].verdict == JoinVerdict::SameScan) return;
    groups_[s] = std::make_unique<ViewGroup>(set_, series[s].views, series[s].poses);
    if (series[s].views.size() > 1) own_noise_[s] = fit_within(set_, *groups_[s]);
  });
  std::vector<double> diagonals;
  for (const auto& group : groups_)
    if (group) diagonals.push_back(robust_diagonal(group->surface().points));
  cell_ = std::max(2 * spacing, median_of(diagonals) / kCellsAcross);
}

bool PoseGraph::is_same_pose(const RigidMotion& a, const RigidMotion& b, const Vec3& at) const {
  return are_near(a, b, at, kSameTurnDeg, kSameShift * set_.spacing);
}

double PoseGraph::score_of(const PoseFigures& f) const {
  const double fit = f.fit.rms / (kScoreRms * set_.spacing);
  return f.overlap * std::max(0.0, 1 - kScoreConflict * f.conflict.value_or(0)) / (1 + fit * fit);
}

Result<void> PoseGraph::find_candidates(const ProgressSink& progress, const std::stop_token& stop) {
  telefab::report(progress, WorkStage::AligningPairs, 0);
  coarse_.resize(groups_.size());
  tbb::parallel_for(std::size_t{0}, groups_.size(), [&](std::size_t s) {
    if (groups_[s] && !stop.stop_requested()) coarse_[s] = std::make_unique<CoarseShape>(groups_[s]->surface(), cell_);
  });
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t a = 0; a < groups_.size(); ++a)
    for (std::size_t b = a + 1; b < groups_.size(); ++b)
      if (groups_[a] && groups_[b]) pairs.emplace_back(a, b);
  std::vector<std::vector<Candidate>> found(pairs.size());
  constexpr std::size_t kBatch = 8;  // between two reports
  for (std::size_t first = 0; first < pairs.size(); first += kBatch) {
    if (stop.stop_requested()) return cancelled("searching poses");
    telefab::report(progress, WorkStage::AligningPairs, static_cast<double>(first) / static_cast<double>(pairs.size()));
    tbb::parallel_for(first, std::min(first + kBatch, pairs.size()),
                      [&](std::size_t p) { found[p] = candidates_of(pairs[p].first, pairs[p].second, stop); });
  }
  if (stop.stop_requested()) return cancelled("searching poses");
  for (const auto& some : found) candidates_.insert(candidates_.end(), some.begin(), some.end());
  coarse_.clear();
  count_support();
  set_noise();
  return {};
}

std::vector<PoseGraph::Candidate> PoseGraph::candidates_of(std::size_t a, std::size_t b,
                                                           const std::stop_token& stop) const {
  const ViewGroup &to = *groups_[a], &from = *groups_[b];
  const auto is_view = [&](const ViewGroup& g) {
    return g.members().size() == 1 && !views_[g.members()[0]].view.point_at.empty();
  };
  const bool is_of_views = is_view(to) && is_view(from);  // a cloud may be of many views
  const std::vector<CoarsePose> coarse = search_poses(
      *coarse_[b], *coarse_[a], {.draws = is_of_views ? kDrawsOfViews : kDrawsOfSeries, .seed = options_.seed}, stop);
  std::vector<std::pair<double, std::size_t>> order(coarse.size());
  tbb::parallel_for(std::size_t{0}, coarse.size(), [&](std::size_t i) {
    const double clearance = kCoarseClearance * cell_;
    const double conflict = std::max(conflict_of_means(set_, *coarse_[b], to, coarse[i].motion, clearance),
                                     conflict_of_means(set_, *coarse_[a], from, coarse[i].motion.inverse(), clearance));
    order[i] = {-coarse[i].share * (1 - 3 * conflict), i};
  });
  std::sort(order.begin(), order.end());
  const auto has_eye = [&](const ViewGroup& g) {
    return std::ranges::any_of(g.members(), [&](std::size_t v) { return views_[v].projection.has_value(); });
  };
  const std::size_t most = is_of_views                    ? kAlignedOfViews
                           : has_eye(to) || has_eye(from) ? kAlignedOfSeries
                                                          : kAlignedOfClouds;
  order.resize(std::min(order.size(), most));

  // A short fit tells which of them meet; only different ones are worth a long one.
  const auto aligned = [&](std::span<const RigidMotion> starts, double reach, int rounds, std::size_t samples) {
    std::vector<std::optional<Alignment>> fits(starts.size());
    tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
      auto fit = align(from.surface().points, from.surface().normals, to.target(), starts[i],
                       {.first_distance = reach,
                        .last_distance = kLastReach * set_.spacing,
                        .max_rounds = rounds,
                        .samples = samples},
                       stop);
      if (fit && fit->overlap >= kLeastOverlap / 2) fits[i] = *fit;
    });
    std::vector<RigidMotion> distinct;
    for (const auto& fit : fits)
      if (fit && std::ranges::none_of(
                     distinct, [&](const RigidMotion& m) { return is_same_pose(m, fit->motion, from.middle()); }))
        distinct.push_back(fit->motion);
    return distinct;
  };
  std::vector<RigidMotion> starts;
  for (const auto& [weight, i] : order) starts.push_back(coarse[i].motion);
  const auto met = aligned(starts, kFirstReach * cell_, 14, 600);
  std::vector<Candidate> found;
  // What nearly slides needs many rounds, and of series there are few.
  const double reach = 2 * kLastReach * set_.spacing;
  for (const RigidMotion& motion : is_of_views ? aligned(met, reach, 30, 1500) : aligned(met, reach, 80, 4000)) {
    Candidate c{a, b, motion, figures_of(set_, to, from, motion)};
    c.score = score_of(c.figures);
    if (c.figures.overlap >= kLeastOverlap) found.push_back(c);
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Candidate& l, const Candidate& r) { return l.score > r.score; });
  return found;
}

void PoseGraph::count_support() {
  std::map<std::pair<std::size_t, std::size_t>, std::vector<std::size_t>> of_pair;
  for (std::size_t c = 0; c < candidates_.size(); ++c) of_pair[{candidates_[c].a, candidates_[c].b}].push_back(c);
  // the motions from b to a, whichever way about they were found
  const auto motions = [&](std::size_t a, std::size_t b) {
    std::vector<RigidMotion> list;
    const auto found = of_pair.find({std::min(a, b), std::max(a, b)});
    if (found == of_pair.end()) return list;
    for (const std::size_t c : found->second)
      list.push_back(a < b ? candidates_[c].b_to_a : candidates_[c].b_to_a.inverse());
    return list;
  };
  for (Candidate& c : candidates_)
    for (std::size_t k = 0; k < groups_.size(); ++k) {
      if (k == c.a || k == c.b) continue;
      const auto first = motions(c.a, k), second = motions(k, c.b);
      const bool agrees = std::ranges::any_of(first, [&](const RigidMotion& k_to_a) {
        return std::ranges::any_of(second, [&](const RigidMotion& b_to_k) {
          return are_near(k_to_a * b_to_k, c.b_to_a, groups_[c.b]->middle(), kCycleTurnDeg, kCycleShift * set_.spacing);
        });
      });
      c.support += agrees ? 1 : 0;
    }
}

void PoseGraph::set_noise() {
  std::vector<SurfaceFit> measured;
  for (const auto& own : own_noise_)
    if (own) measured.push_back(*own);
  noise_source_ = NoiseSource::Turns;
  if (measured.empty()) {
    noise_source_ = NoiseSource::Pairs;
    for (const Candidate& c : candidates_)
      if (c.support >= 2 && c.figures.conflict.value_or(0) <= options_.max_conflict) measured.push_back(c.figures.fit);
  }
  // Of pairs of views some are right but not exact, so their better ones tell.
  const double share = noise_source_ == NoiseSource::Pairs ? kExactPairs : 0.5;
  if (measured.empty()) {
    noise_source_ = NoiseSource::Halves;
    for (const RangeImage& view : views_) {
      const SurfaceFit halves = fit_of_halves(view, set_.spacing);
      measured.push_back({kCorrelated * halves.rms, kCorrelatedPatches * halves.patch_rms});
    }
  }
  std::vector<double> rms, patch_rms;
  for (const SurfaceFit& fit : measured) {
    rms.push_back(fit.rms);
    patch_rms.push_back(fit.patch_rms);
  }
  noise_ = {quantile(std::move(rms), share), quantile(std::move(patch_rms), share)};
}

SurfaceFit PoseGraph::noise_of(std::span<const std::size_t> series) const {
  SurfaceFit most;
  for (const std::size_t s : series) {
    const SurfaceFit own = own_noise_[s].value_or(noise_);
    most = {std::max(most.rms, own.rms), std::max(most.patch_rms, own.patch_rms)};
  }
  return most;
}

std::size_t PoseGraph::support_between(const Body& a, const Body& b) const {
  std::size_t most = 0;
  for (const Candidate& c : candidates_) {
    const auto in = [&](const Body& body, std::size_t s) {
      return std::ranges::find(body.series, s) != body.series.end();
    };
    if ((in(a, c.a) && in(b, c.b)) || (in(a, c.b) && in(b, c.a))) most = std::max(most, c.support);
  }
  return most;
}

std::vector<PoseGraph::Hypothesis> PoseGraph::hypotheses(const Body& a, const Body& b,
                                                         const std::stop_token& stop) const {
  struct Start {
    RigidMotion motion;
    double score = 0;
    const Candidate* only = nullptr;
  };
  std::vector<Start> starts;
  const auto place = [](const Body& body, std::size_t s) {
    return body.poses[static_cast<std::size_t>(std::ranges::find(body.series, s) - body.series.begin())];
  };
  const auto in = [](const Body& body, std::size_t s) {
    return std::ranges::find(body.series, s) != body.series.end();
  };
  for (const Candidate& c : candidates_) {
    if (in(a, c.a) && in(b, c.b))
      starts.push_back({place(a, c.a) * c.b_to_a * place(b, c.b).inverse(), c.score, &c});
    else if (in(a, c.b) && in(b, c.a))
      starts.push_back({place(a, c.b) * c.b_to_a.inverse() * place(b, c.a).inverse(), c.score, &c});
  }
  std::stable_sort(starts.begin(), starts.end(), [](const Start& l, const Start& r) { return l.score > r.score; });
  const bool is_known = a.series.size() == 1 && b.series.size() == 1;  // aligned and judged already
  std::vector<Hypothesis> distinct;
  const auto add = [&](const RigidMotion& motion) {
    const bool is_new = std::ranges::none_of(
        distinct, [&](const Hypothesis& h) { return is_same_pose(h.b_to_a, motion, b.group->middle()); });
    if (is_new) distinct.push_back({motion, {}, 0});
    return is_new;
  };
  if (is_known) {
    for (const Start& s : starts)
      if (add(s.motion)) distinct.back().figures = s.only->figures;
  } else {
    std::vector<RigidMotion> wide;  // many pairs of views propose one and the same
    for (const Start& s : starts) {
      const bool is_new = std::ranges::none_of(wide, [&](const RigidMotion& m) {
        return are_near(m, s.motion, b.group->middle(), 2 * kSameTurnDeg, 3 * kSameShift * set_.spacing);
      });
      if (is_new) wide.push_back(s.motion);
      if (wide.size() == kHypothesesOfBodies) break;
    }
    std::vector<std::optional<RigidMotion>> fits(wide.size());
    tbb::parallel_for(std::size_t{0}, wide.size(), [&](std::size_t i) {
      const auto fit = align(b.group->surface().points, b.group->surface().normals, a.group->target(), wide[i],
                             {.first_distance = 3 * kLastReach * set_.spacing,
                              .last_distance = kLastReach * set_.spacing,
                              .max_rounds = 20,
                              .samples = 1500},
                             stop);
      if (fit) fits[i] = fit->motion;
    });
    for (const auto& fit : fits)
      if (fit) add(*fit);
    tbb::parallel_for(std::size_t{0}, distinct.size(), [&](std::size_t i) {
      distinct[i].figures = figures_of(set_, *a.group, *b.group, distinct[i].b_to_a);
    });
  }
  for (Hypothesis& h : distinct) h.score = score_of(h.figures);
  std::stable_sort(distinct.begin(), distinct.end(),
                   [](const Hypothesis& l, const Hypothesis& r) { return l.score > r.score; });
  return distinct;
}

void PoseGraph::add_symmetries(const Body& a, const Body& b, std::vector<Hypothesis>& list,
                               const std::stop_token& stop) const {
  const ViewGroup whole = united(set_, *a.group, *b.group, list.front().b_to_a);
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3f& p : whole.surface().points) {
    const Vec3 d = p.cast<double>() - whole.middle();
    scatter += d * d.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> inertia{scatter};
  std::vector<RigidMotion> turns;
  const auto turn = [&](const Vec3& axis, double degrees) {
    turns.emplace_back(Eigen::Translation3d{whole.middle()} *
                       Eigen::AngleAxisd{degrees * std::numbers::pi / 180, axis.normalized()} *
                       Eigen::Translation3d{-whole.middle()});
  };
  for (int k = 0; k < 3; ++k) {
    const Vec3 axis = inertia.eigenvectors().col(k), u = inertia.eigenvectors().col((k + 1) % 3),
               v = inertia.eigenvectors().col((k + 2) % 3);
    const double one = inertia.eigenvalues()[(k + 1) % 3], other = inertia.eigenvalues()[(k + 2) % 3];
    for (const double degrees : kSymmetricTurnsDeg)
      for (const double sense : {1.0, -1.0}) turn(axis, sense * degrees);
    if (std::min(one, other) < kAlikeInertia * std::max(one, other)) continue;
    // Wheels and the like: the axes across are anywhere, and the turns may be small ones.
    for (double degrees = kSweepDeg; degrees < 360; degrees += kSweepDeg) turn(axis, degrees);
    for (double degrees = 0; degrees < 180; degrees += kSweepDeg) {
      const double angle = degrees * std::numbers::pi / 180;
      turn(std::cos(angle) * u + std::sin(angle) * v, 180);
    }
  }
  // Those at which most lies near at once are worth a fit.
  std::vector<std::pair<std::size_t, std::size_t>> order(turns.size());
  tbb::parallel_for(std::size_t{0}, turns.size(), [&](std::size_t i) {
    const std::size_t step = std::max<std::size_t>(1, b.group->surface().points.size() / kFreeMeans);
    const auto near =
        find_matches(b.group->surface().points, b.group->surface().normals, {}, turns[i] * list.front().b_to_a,
                     a.group->target(), {}, RigidMotion::Identity(), 2 * cell_, step);
    order[i] = {turns.size() * kFreeMeans * 2 - near.size(), i};
  });
  std::sort(order.begin(), order.end());
  std::vector<RigidMotion> starts;
  for (const auto& [rank, i] : order)
    if (starts.size() < kSymmetriesFitted) starts.push_back(turns[i] * list.front().b_to_a);
  const auto fitted = [&](const RigidMotion& start, double reach, int rounds, std::size_t samples) {
    return align(
        b.group->surface().points, b.group->surface().normals, a.group->target(), start,
        {.first_distance = reach, .last_distance = kLastReach * set_.spacing, .max_rounds = rounds, .samples = samples},
        stop);
  };
  const auto own = fitted(list.front().b_to_a, kLastReach * set_.spacing, 1, 600);
  if (!own) return;
  std::vector<std::optional<Hypothesis>> found(starts.size());
  tbb::parallel_for(std::size_t{0}, starts.size(), [&](std::size_t i) {
    const auto first = fitted(starts[i], kFirstReach * cell_, 14, 600);
    // what is equal in the end lies near already
    if (!first || first->overlap < own->overlap / 2 || first->rms > 2 * kScoreRms * set_.spacing) return;
    const auto last = fitted(first->motion, 2 * kLastReach * set_.spacing, 80, 4000);
    if (last) found[i] = Hypothesis{last->motion, figures_of(set_, *a.group, *b.group, last->motion), 0};
  });
  for (auto& h : found) {
    if (!h || std::ranges::any_of(list, [&](const Hypothesis& known) {
          return is_same_pose(known.b_to_a, h->b_to_a, b.group->middle());
        }))
      continue;
    h->score = score_of(h->figures);
    list.push_back(*h);
  }
}

JoinVerdict PoseGraph::judge(const PoseFigures& f, const SurfaceFit& noise, double spread, std::size_t support) const {
  if (f.overlap < kLeastOverlap) return JoinVerdict::NoPose;
  // What slides fits less well too: the first cause is said.
  if (f.stiffness < options_.min_stiffness && f.fit.rms <= 2 * spread * options_.max_rms_ratio * noise.rms)
    return JoinVerdict::Slides;
  const double rms = std::max(noise.rms, kLeastRms * set_.spacing),
               patch_rms = std::max(noise.patch_rms, kLeastPatches * set_.spacing);
  if (f.fit.rms > spread * options_.max_rms_ratio * rms ||
      f.fit.patch_rms > spread * options_.max_rms_ratio * patch_rms)
    return JoinVerdict::Misfit;
  if (f.conflict.value_or(0) > options_.max_conflict) return JoinVerdict::SeenThrough;
  if (f.overlap < (support > 0 ? std::min(kSupportedOverlap, options_.min_overlap) : options_.min_overlap))
    return JoinVerdict::ThinOverlap;
  return JoinVerdict::Fits;
}

PoseGraph::Attempt PoseGraph::attempt(const Body& a, const Body& b, const std::stop_token& stop) const {
  Attempt found;
  const SurfaceFit of_a = noise_of(a.series), of_b = noise_of(b.series);
  const SurfaceFit noise{std::max(of_a.rms, of_b.rms), std::max(of_a.patch_rms, of_b.patch_rms)};
  found.noise = noise;
  std::vector<Hypothesis> list = hypotheses(a, b, stop);
  if (list.empty()) return found;
  found.best = list.front();
  found.runner_up = list.size() > 1 && list[0].score > 0 ? list[1].score / list[0].score : 0;
  found.verdict =
      judge(found.best.figures, noise, noise_source_ == NoiseSource::Pairs ? kSpreadOfPairs : 1, support_between(a, b));
  if (found.verdict != JoinVerdict::Fits) return found;
  const PoseFigures& best = found.best.figures;
  if (best.fit.rms < kSameScanRms * noise.rms && best.overlap > kSameScanOverlap && a.group->members().size() == 1 &&
      b.group->members().size() == 1) {
    found.verdict = JoinVerdict::SameScan;
    return found;
  }
  // The search may have missed equal poses of a symmetric body, so they are looked for.
  if (a.group->members().size() > 1 && b.group->members().size() > 1) add_symmetries(a, b, list, stop);
  bool is_symmetry = true;
  std::unique_ptr<ViewGroup> whole;
  for (std::size_t i = 1; i < list.size(); ++i) {
    const PoseFigures& other = list[i].figures;
    if (other.overlap < kEqualOverlap * best.overlap || other.fit.rms > kEqualRms * best.fit.rms ||
        other.fit.patch_rms > kEqualRms * std::max(best.fit.patch_rms, noise.patch_rms) ||
        other.conflict.value_or(0) > best.conflict.value_or(0) + kEqualConflict)
      continue;
    const RigidMotion between = list[i].b_to_a * found.best.b_to_a.inverse();
    found.equal_turns_deg.push_back(Eigen::AngleAxisd{between.rotation()}.angle() * 180 / std::numbers::pi);
    if (!options_.accept_symmetry) continue;
    if (!whole) whole = std::make_unique<ViewGroup>(united(set_, *a.group, *b.group, found.best.b_to_a));
    is_symmetry = is_symmetry && carries_onto_itself(*whole, between, noise);
  }
  if (!found.equal_turns_deg.empty() && !(options_.accept_symmetry && is_symmetry))
    found.verdict = JoinVerdict::Ambiguous;
  return found;
}

bool PoseGraph::carries_onto_itself(const ViewGroup& whole, const RigidMotion& motion, const SurfaceFit& noise) const {
  const PoseFigures figures = figures_of(set_, whole, whole, motion);
  return figures.overlap >= kOntoItself && figures.fit.rms <= options_.max_rms_ratio * noise.rms &&
         figures.conflict.value_or(0) <= options_.max_conflict;
}

void PoseGraph::merge(std::size_t a, std::size_t b, const RigidMotion& b_to_a) {
  Body &into = bodies_[a], &from = bodies_[b];
  into.group = std::make_unique<ViewGroup>(united(set_, *into.group, *from.group, b_to_a));
  for (std::size_t i = 0; i < from.series.size(); ++i) {
    into.series.push_back(from.series[i]);
    into.poses.push_back(b_to_a * from.poses[i]);
  }
  bodies_.erase(bodies_.begin() + static_cast<std::ptrdiff_t>(b));
}

void PoseGraph::report(std::size_t series, const Attempt& found) {
  SeriesReport& r = reports_[series];
  r.verdict = found.verdict;
  r.overlap = found.best.figures.overlap;
  r.rms = found.best.figures.fit.rms;
  r.patch_rms = found.best.figures.fit.patch_rms;
  r.noise = found.noise.rms;
  r.patch_noise = found.noise.patch_rms;
  r.conflict = found.best.figures.conflict;
  r.stiffness = found.best.figures.stiffness;
  r.runner_up = found.runner_up;
  r.equal_turns_deg = found.equal_turns_deg;
}

Result<void> PoseGraph::join_best_first(const std::stop_token& stop) {
  for (std::size_t s = 0; s < groups_.size(); ++s)
    if (groups_[s])
      bodies_.push_back({{s},
                         {RigidMotion::Identity()},
                         std::make_unique<ViewGroup>(set_, groups_[s]->members(), groups_[s]->poses())});
  // What was tried stays tried until one of the two has grown; a body is known by its series.
  std::map<std::pair<std::vector<std::size_t>, std::vector<std::size_t>>, Attempt> tried;
  const auto body_of = [&](std::size_t s) {
    return static_cast<std::size_t>(
        std::ranges::find_if(bodies_, [&](const Body& b) { return std::ranges::find(b.series, s) != b.series.end(); }) -
        bodies_.begin());
  };
  std::vector<std::size_t> order(candidates_.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](std::size_t l, std::size_t r) {
    const auto rank = [&](std::size_t i) {
      return candidates_[i].score * static_cast<double>(1 + candidates_[i].support);
    };
    return rank(l) > rank(r);
  });
  for (bool has_grown = true; has_grown;) {
    has_grown = false;
    for (const std::size_t c : order) {
      if (stop.stop_requested()) return cancelled("joining views");
      const std::size_t first = body_of(candidates_[c].a), second = body_of(candidates_[c].b);
      const std::size_t a = std::min(first, second), b = std::max(first, second);
      if (a == b || b == bodies_.size()) continue;  // joined already, or a copy
      const auto key = std::make_pair(bodies_[a].series, bodies_[b].series);
      if (tried.contains(key)) continue;
      const Attempt& found = tried[key] = attempt(bodies_[a], bodies_[b], stop);
      if (found.verdict == JoinVerdict::SameScan && bodies_[b].series.size() == 1) {
        const std::size_t copy = bodies_[b].series[0];
        report(copy, found);
        reports_[copy].same_as = bodies_[a].series[0];
        bodies_.erase(bodies_.begin() + static_cast<std::ptrdiff_t>(b));
        has_grown = true;
        break;
      }
      if (found.verdict != JoinVerdict::Fits) continue;
      for (const std::size_t s : bodies_[a].series)
        if (bodies_[a].series.size() == 1) report(s, found);
      for (const std::size_t s : bodies_[b].series) report(s, found);
      merge(a, b, found.best.b_to_a);
      has_grown = true;
      break;
    }
  }
  std::stable_sort(bodies_.begin(), bodies_.end(),
                   [](const Body& l, const Body& r) { return l.group->members().size() > r.group->members().size(); });
  for (std::size_t b = 1; b < bodies_.size();) {
    const Attempt found = attempt(bodies_[0], bodies_[b], stop);
    for (const std::size_t s : bodies_[b].series) report(s, found);
    // seen from the larger one what just did not fit may just fit
    if (found.verdict == JoinVerdict::Fits)
      merge(0, b, found.best.b_to_a);
    else
      ++b;
  }
  reports_[bodies_[0].series[0]].verdict = JoinVerdict::Fits;  // what the others are held against
  bodies_.resize(1);
  return {};
}

std::vector<std::pair<std::size_t, RigidMotion>> PoseGraph::poses() const {
  std::vector<std::pair<std::size_t, RigidMotion>> list;
  const ViewGroup& group = *bodies_[0].group;
  for (std::size_t m = 0; m < group.members().size(); ++m) list.emplace_back(group.members()[m], group.poses()[m]);
  std::sort(list.begin(), list.end(), [](const auto& l, const auto& r) { return l.first < r.first; });
  return list;
}

bool PoseGraph::drop_what_misfits(std::span<const RigidMotion> adjusted) {
  Body& body = bodies_[0];
  std::map<std::size_t, RigidMotion> pose_of;
  const auto before = poses();
  for (std::size_t i = 0; i < before.size(); ++i) pose_of[before[i].first] = adjusted[i];
  const auto group_of = [&](const std::vector<std::size_t>& members) {
    std::vector<RigidMotion> there;
    for (const std::size_t v : members) there.push_back(pose_of.at(v));
    return ViewGroup{set_, members, std::move(there)};
  };
  const auto without = [&](std::size_t series) {
    std::vector<std::size_t> rest;
    for (const std::size_t s : body.series)
      if (s != series) rest.insert(rest.end(), series_[s].views.begin(), series_[s].views.end());
    return rest;
  };
  std::optional<std::size_t> worst;
  double least = 0;
  std::vector<JoinVerdict> verdicts(body.series.size());
  std::vector<PoseFigures> figures(body.series.size());
  tbb::parallel_for(std::size_t{0}, body.series.size(), [&](std::size_t i) {
    const std::size_t s = body.series[i];
    figures[i] = figures_of(set_, group_of(without(s)), group_of(series_[s].views), RigidMotion::Identity());
  });
  SurfaceFit noise = noise_of(body.series);
  double spread = noise_source_ == NoiseSource::Pairs ? kSpreadOfPairs : 1;
  if (noise_source_ == NoiseSource::Pairs && body.series.size() >= kLeastForMedian) {
    // Against all others together right views differ less from each other than pair by pair.
    std::vector<double> rms, patch_rms;
    for (const PoseFigures& f : figures) {
      rms.push_back(f.fit.rms);
      patch_rms.push_back(f.fit.patch_rms);
    }
    noise = {std::min(median_of(rms), kSpreadOfPairs * noise_.rms),
             std::min(median_of(patch_rms), kSpreadOfPairs * noise_.patch_rms)};
    spread = kSpreadOfViews;
  }
  for (std::size_t i = 0; i < body.series.size(); ++i)
    verdicts[i] = judge(figures[i], noise, spread, body.series.size() > 2 ? 1 : 0);
  for (std::size_t i = 0; i < body.series.size(); ++i) {
    SeriesReport& r = reports_[body.series[i]];
    r.overlap = figures[i].overlap;
    r.rms = figures[i].fit.rms;
    r.patch_rms = figures[i].fit.patch_rms;
    r.noise = noise.rms;
    r.patch_noise = noise.patch_rms;
    r.conflict = figures[i].conflict;
    r.stiffness = figures[i].stiffness;
    if (verdicts[i] == JoinVerdict::Fits) continue;
    const double score = score_of(figures[i]);
    if (worst && score >= least) continue;
    worst = i;
    least = score;
  }
  if (!worst) return false;
  const std::size_t dropped = body.series[*worst];
  reports_[dropped].verdict = verdicts[*worst];
  const std::vector<std::size_t> rest = without(dropped);
  body.series.erase(body.series.begin() + static_cast<std::ptrdiff_t>(*worst));
  body.group = std::make_unique<ViewGroup>(group_of(rest));
  return true;
}

}  // namespace telefab::scan
