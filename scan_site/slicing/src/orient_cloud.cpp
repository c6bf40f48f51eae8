// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/orient_cloud.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <telefab/scan/completion/winding_tree.hpp>

#include "winding_normals.hpp"

namespace telefab::scan {
namespace {

constexpr std::size_t kMostAsked = 20'000, kMostOfPiece = 500, kLeastOfPiece = 8;
/// Places asked before and behind a sample: the far ones lie beyond walls that are thinner.
constexpr std::array kProbeSpacings{1.F, 0.5F};
constexpr double kSure = 0.9;                      ///< share of a piece's samples that must agree
constexpr double kOpen = 0.1;                      ///< mean normal of a cloud that is not closed
constexpr double kLikely = 0.75, kUnlikely = 0.2;  ///< share that must, or must not, agree before such are turned
constexpr std::size_t kNear = 6;                   ///< neighbours with which a given normal is compared
constexpr float kAcross = 0.5F;       ///< cosine: they stand on the plane of the neighbours, or an edge of it
constexpr double kCoherent = 0.7;     ///< share of given normals that look the same way as their neighbours: they were
                                      ///< computed, and not by chance
constexpr double kConsistent = 0.92;  ///< estimated normals of which fewer fit are tried by winding numbers
constexpr double kClean = 0.97;       ///< of which more fit have no edges to be mended
constexpr int kMendingRounds = 2;
constexpr float kBetterParted = 0.1F;  ///< winding number behind less that before: so much more counts as better
constexpr float kSamePlane = 0.8F;     ///< cosine: the plane of the neighbours is the surface's, and gives the normal
constexpr double kWholeTurn = 0.3;     ///< normals of which fewer are on the same side as others are those turned
constexpr double kBetter = 0.02;       ///< estimated normals replace given ones if so much more of them fit

/// Some points of every piece.
struct Asked {
  std::vector<std::uint32_t> points;
  std::vector<std::uint32_t> piece;  ///< one a point asked
};

Asked choose(const SurfaceFacts& facts) {
  std::vector<std::size_t> size(facts.pieces, 0), seen(facts.pieces, 0);
  for (const std::uint32_t p : facts.piece) ++size[p];
  const std::size_t each = std::clamp(kMostAsked / std::max<std::size_t>(1, facts.pieces), kLeastOfPiece, kMostOfPiece);
  Asked asked;
  for (std::uint32_t i = 0; i < facts.piece.size(); ++i) {
    const std::uint32_t p = facts.piece[i];
    if (seen[p]++ % (size[p] / each + 1) != 0) continue;
    asked.points.push_back(i);
    asked.piece.push_back(p);
  }
  return asked;
}

/// How the samples of one piece stand.
struct Votes {
  std::size_t asked = 0, right = 0, turned = 0, coherent = 0;
  [[nodiscard]] double share(std::size_t count) const {
    return asked > 0 ? static_cast<double>(count) / static_cast<double>(asked) : 1;
  }
};

struct Judgement {
  std::vector<Votes> pieces;
  double openness = 0;
  [[nodiscard]] Votes all() const {
    Votes sum;
    for (const Votes& v : pieces) {
      sum.asked += v.asked;
      sum.right += v.right;
      sum.turned += v.turned;
    }
    return sum;
  }
};

/// Whether the inside is behind a sample, by the winding numbers behind and before it.
bool parts(float behind, float before) { return behind > 0.5F && before < 0.5F; }

bool looks_like_neighbours(std::span<const Eigen::Vector3f> normals, const SurfaceFacts& facts, std::uint32_t i) {
  const std::size_t count = std::min(kNear, facts.neighbours);
  std::size_t same = 0;
  for (std::size_t k = 0; k < count; ++k)
    same += normals[i].dot(normals[facts.neighbour[i * facts.neighbours + k]]) > 0 ? 1 : 0;
  return same + 1 >= count && std::abs(normals[i].dot(facts.plane_normal[i])) > kAcross;
}

Judgement judge(const PointCloud& cloud, std::span<const Eigen::Vector3f> normals, const SurfaceFacts& facts,
                const Asked& asked) {
  const WindingTree tree{cloud.points, normals, facts.area};
  std::vector<Eigen::Vector3f> places;
  for (const std::uint32_t i : asked.points)
    for (const float spacings : kProbeSpacings) {
      const Eigen::Vector3f step = spacings * std::sqrt(facts.area[i]) * normals[i];
      places.push_back(cloud.points[i] - step);
      places.push_back(cloud.points[i] + step);
    }
  const std::vector<float> winding = tree.windings(places);
  Judgement judgement;
  judgement.pieces.resize(facts.pieces);
  judgement.openness = tree.mean_normal().norm();
  for (std::size_t k = 0; k < asked.points.size(); ++k) {
    Votes& votes = judgement.pieces[asked.piece[k]];
    bool right = false, turned = false;
    for (std::size_t p = 0; p < kProbeSpacings.size(); ++p) {
      const std::size_t at = 2 * (kProbeSpacings.size() * k + p);
      const float behind = winding[at], before = winding[at + 1];
      right = right || parts(behind, before);
      // with all normals turned the winding numbers change sign, and so do the sides
      turned = turned || parts(-before, -behind);
    }
    ++votes.asked;
    votes.right += right ? 1 : 0;
    votes.turned += turned ? 1 : 0;
    votes.coherent += looks_like_neighbours(normals, facts, asked.points[k]) ? 1 : 0;
  }
  return judgement;
}

enum class Verdict { Keep, Turn, Disagree };

Verdict verdict_of(const Votes& v) {
  if (v.share(v.right) >= kSure) return Verdict::Keep;
  if (v.share(v.turned) >= kSure) return Verdict::Turn;
  // Of open scans, and of sharp ones with few points, winding numbers say no more than which way round is the likelier.
  if (v.share(v.coherent) >= kCoherent)
    return v.share(v.turned) >= kLikely && v.share(v.right) <= kUnlikely ? Verdict::Turn : Verdict::Keep;
  return v.asked < kLeastOfPiece ? Verdict::Keep : Verdict::Disagree;
}

/// Whether normals contradict what others say of the outside: most face what a flood from without does not reach, where
/// that was told of the `other` normals; or they are nearly those turned as a whole, which a winding number of few
/// points cannot tell from right.
bool faces_inside(std::span<const Eigen::Vector3f> normals, std::span<const Eigen::Vector3f> other,
                  std::span<const std::int8_t> outside) {
  std::ptrdiff_t balance = 0;
  std::size_t same = 0;
  for (std::size_t i = 0; i < normals.size(); ++i) {
    const bool agrees = normals[i].dot(other[i]) > 0;
    same += agrees ? 1 : 0;
    if (outside[i] != 0) balance += agrees == (outside[i] > 0) ? 1 : -1;
  }
  return balance < 0 || static_cast<double>(same) < kWholeTurn * static_cast<double>(normals.size());
}

/// Where the plane of the neighbours stands on an edge of the body, its normal has no right side. Normals that do not
/// have the inside behind them become the direction in which the winding number of all falls fastest, if they part the
/// sides better then.
void mend_edges(std::span<const Eigen::Vector3f> points, std::vector<Eigen::Vector3f>& normals,
                std::span<const float> areas) {
  constexpr std::size_t kAxes = 3;
  for (int round = 0; round < kMendingRounds; ++round) {
    const WindingTree tree{points, normals, areas};
    // Behind and before every point of a list, a spacing away.
    const auto sides = [&](std::span<const std::uint32_t> list, const auto& way) {
      std::vector<Eigen::Vector3f> places;
      for (std::size_t k = 0; k < list.size(); ++k)
        for (const float side : {-1.0F, 1.0F})
          places.push_back(points[list[k]] + side * std::sqrt(areas[list[k]]) * way(k));
      return tree.windings(places);
    };
    std::vector<std::uint32_t> list(points.size());
    std::iota(list.begin(), list.end(), 0U);
    const auto as_they_are = sides(list, [&](std::size_t k) -> const Eigen::Vector3f& { return normals[k]; });
    std::erase_if(list, [&](std::uint32_t i) { return parts(as_they_are[2 * i], as_they_are[2 * i + 1]); });
    std::array<std::vector<float>, kAxes> along;
    for (std::size_t axis = 0; axis < kAxes; ++axis)
      along[axis] = sides(list, [&](std::size_t) { return Eigen::Vector3f::Unit(static_cast<Eigen::Index>(axis)); });
    std::vector<Eigen::Vector3f> fall;
    for (std::size_t k = 0; k < list.size(); ++k) {
      const auto drop = [&](std::size_t axis) { return along[axis][2 * k] - along[axis][2 * k + 1]; };
      fall.push_back(Eigen::Vector3f{drop(0), drop(1), drop(2)}.normalized());
    }
    const auto mended = sides(list, [&](std::size_t k) -> const Eigen::Vector3f& { return fall[k]; });
    for (std::size_t k = 0; k < list.size(); ++k) {
      const float behind = mended[2 * k], before = mended[2 * k + 1];
      const float was = as_they_are[2 * list[k]] - as_they_are[2 * list[k] + 1];
      const bool better = parts(behind, before) || behind - before > was + kBetterParted;
      if (better && fall[k].squaredNorm() > 0) normals[list[k]] = fall[k];
    }
  }
}

/// Estimated normals. Neighbours alone orient well-sampled clouds; where too few of the samples of a closed one then
/// have the inside behind them, winding numbers say which way round its planes are, if more of them fit then.
Result<OrientedCloud> estimated_normals(PointCloud cloud, std::shared_ptr<SurfaceGraph> graph, std::stop_token stop) {
  auto estimated = with_normals(std::move(cloud), graph, NormalOptions{}, stop);
  if (!estimated) return tl::unexpected{estimated.error()};
  OrientedCloud made{std::move(estimated->cloud), estimated->report, {}};
  const SurfaceFacts facts = facts_of(*graph);
  const Asked asked = choose(facts);
  const Judgement judgement = judge(made.cloud, made.cloud.normals, facts, asked);
  made.report.winding_agreement = judgement.all().share(judgement.all().right);
  const auto kept = [&] {
    if (made.report.winding_agreement < kClean && judgement.openness <= kOpen)
      mend_edges(made.cloud.points, made.cloud.normals, facts.area);
    return std::move(made);
  };
  if (made.report.winding_agreement >= kConsistent) return kept();
  auto ways = winding_normals(made.cloud.points, facts.area, stop);
  if (!ways) return tl::unexpected{ways.error()};
  for (std::size_t i = 0; i < ways->size(); ++i) {
    const float along = (*ways)[i].dot(facts.plane_normal[i]);
    if (std::abs(along) > kSamePlane)
      (*ways)[i] = along > 0 ? facts.plane_normal[i] : Eigen::Vector3f{-facts.plane_normal[i]};
  }
  const Judgement second = judge(made.cloud, *ways, facts, asked);
  const Votes votes = second.all();
  // Solved for every so manieth point alone, and fitting few, they are a guess: foliage is finer than that.
  const double least = winding_normals_ask_all(made.cloud.size()) ? 0 : kLikely;
  if (second.openness > kOpen || votes.share(votes.right) < least ||
      votes.share(votes.right) <= made.report.winding_agreement + kBetter ||
      faces_inside(*ways, made.cloud.normals, estimated->outside))
    return kept();
  made.cloud.normals = std::move(*ways);
  made.report.by_winding = true;
  made.report.winding_agreement = votes.share(votes.right);
  return made;
}

/// Turns what is the wrong way round; says which pieces agree with the shape neither way.
std::vector<bool> decide_sides(PointCloud& cloud, const SurfaceFacts& facts, const Judgement& judgement,
                               NormalReport& report) {
  std::vector<Verdict> verdicts;
  for (const Votes& v : judgement.pieces) verdicts.push_back(verdict_of(v));
  std::vector<bool> disagrees(facts.pieces);
  Votes all;
  for (std::size_t p = 0; p < facts.pieces; ++p) {
    const Votes& v = judgement.pieces[p];
    disagrees[p] = verdicts[p] == Verdict::Disagree;
    all.asked += v.asked;
    all.right += verdicts[p] == Verdict::Turn ? v.turned : v.right;
    all.coherent += v.coherent;
  }
  report.neighbour_agreement = all.share(all.coherent);
  report.winding_agreement = all.share(all.right);
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (verdicts[facts.piece[i]] == Verdict::Disagree) ++report.disagreeing_points;
    if (verdicts[facts.piece[i]] != Verdict::Turn) continue;
    cloud.normals[i] = -cloud.normals[i];
    ++report.flipped_points;
  }
  return disagrees;
}

/// Estimates where given normals disagree with the shape, and takes what fits better.
Result<OrientedCloud> replaced(OrientedCloud given, std::shared_ptr<SurfaceGraph> graph, const Asked& asked,
                               const std::vector<bool>& disagrees, std::stop_token stop) {
  const std::vector<Eigen::Vector3f> before = given.cloud.normals;
  auto estimated = estimated_normals(given.cloud, graph, stop);
  if (!estimated) return tl::unexpected{estimated.error()};
  const SurfaceFacts facts = facts_of(*graph);
  std::vector<Eigen::Vector3f> mixed = before;
  for (std::size_t i = 0; i < mixed.size(); ++i)
    if (disagrees[facts.piece[i]]) mixed[i] = estimated->cloud.normals[i];
  const Votes old = judge(given.cloud, before, facts, asked).all();
  const Votes fresh = judge(given.cloud, mixed, facts, asked).all();
  const bool better = fresh.share(fresh.right) > old.share(old.right) + kBetter;
  given.warnings.push_back(fmt::format(
      "given normals disagree with the shape: {:.0f} % of those of {} points have the inside behind them; {}",
      100 * old.share(old.right), given.report.disagreeing_points,
      better ? fmt::format("estimated ones ({:.0f} %) replace them", 100 * fresh.share(fresh.right))
             : std::string{"estimated ones are no better, and the given ones stay"}));
  if (better) given.cloud.normals = std::move(mixed);
  given.report.replaced_points = better ? given.report.disagreeing_points : 0;
  given.report.winding_agreement = better ? fresh.share(fresh.right) : old.share(old.right);
  return given;
}

}  // namespace

Result<OrientedCloud> orient_cloud(PointCloud cloud, std::shared_ptr<SurfaceGraph> graph, std::stop_token stop) {
  if (!cloud.has_normals()) return estimated_normals(std::move(cloud), std::move(graph), stop);
  OrientedCloud given{std::move(cloud), {}, {}};
  std::vector<bool> disagrees;
  Asked asked;
  double openness = 0;
  {
    const SurfaceFacts facts = facts_of(*graph);
    given.report.pieces = facts.pieces;
    asked = choose(facts);
    const Judgement judgement = judge(given.cloud, given.cloud.normals, facts, asked);
    openness = judgement.openness;
    disagrees = decide_sides(given.cloud, facts, judgement, given.report);
  }
  if (stop.stop_requested()) return cancelled("judging normals");
  if (given.report.disagreeing_points == 0 && openness <= kOpen && given.report.winding_agreement < kSure)
    given.warnings.push_back(fmt::format(
        "given normals fit the shape in part only: {:.0f} % of those asked have the inside behind them; they "
        "look like their neighbours' and are kept",
        100 * given.report.winding_agreement));
  if (given.report.flipped_points > 0)
    given.warnings.push_back(fmt::format("{} of {} given normals pointed inward and were turned",
                                         given.report.flipped_points, given.cloud.size()));
  if (given.report.disagreeing_points == 0) return given;
  return replaced(std::move(given), std::move(graph), asked, disagrees, stop);
}

Result<OrientedCloud> orient_cloud(PointCloud cloud, std::stop_token stop) {
  auto graph = surface_graph_of(cloud, stop);
  if (!graph) return tl::unexpected{graph.error()};
  return orient_cloud(std::move(cloud), std::move(*graph), stop);
}

}  // namespace telefab::scan
