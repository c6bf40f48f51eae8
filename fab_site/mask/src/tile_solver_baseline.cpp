// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include "tile_solver.hpp"

namespace telefab::fab {
namespace {
struct Baseline {};
}  // namespace

void TileProblem::resize(int side_px) {
  side = side_px;
  const auto pixels = static_cast<std::size_t>(side) * static_cast<std::size_t>(side);
  for (auto* field : {&least, &most, &reference, &dose, &ahead, &slope, &steepness}) field->assign(pixels, 0.0F);
  first.assign(static_cast<std::size_t>(side), 0);
  last.assign(static_cast<std::size_t>(side), 0);
}

double solve_tile_baseline(TileProblem& problem, int iterations) {
  return TileSolver<Baseline>::solve(problem, iterations);
}

void TileProblem::clear_spots() {
  spots.clear();
  std::fill(first.begin(), first.end(), side);
  std::fill(last.begin(), last.end(), 0);
}

void TileProblem::add(const Spot& spot) {
  constexpr int kStep = 8;
  spots.push_back(spot);
  const int row = spot.offset / side, from = spot.offset % side / kStep * kStep;
  const int until = (spot.offset % side + weights->taps() + kStep - 1) / kStep * kStep;
  for (int y = row; y < row + weights->taps(); ++y) {
    auto& begins = first[static_cast<std::size_t>(y)];
    auto& ends = last[static_cast<std::size_t>(y)];
    begins = std::min(begins, from);
    ends = std::max(ends, until);
  }
}

double solve_tile(TileProblem& problem, int iterations) {
  std::fill(problem.steepness.begin(), problem.steepness.end(), problem.regular);
  for (int y = 0; y < problem.side; ++y) {
    const auto row = static_cast<std::size_t>(y);
    const int from = y * problem.side + problem.first[row], until = y * problem.side + problem.last[row];
    for (auto i = static_cast<std::size_t>(from); i < static_cast<std::size_t>(std::max(from, until)); ++i) {
      const float least = problem.least[i], most = problem.most[i], wanted = problem.reference[i];
      const float raised = wanted < least ? least : wanted, dose = most < raised ? most : raised;
      problem.slope[i] = 0;
      problem.dose[i] = dose;
      problem.ahead[i] = dose;
    }
  }
#ifdef TELEFAB_MASK_AVX2
  if (__builtin_cpu_supports("avx2")) return solve_tile_avx2(problem, iterations);
#endif
  return solve_tile_baseline(problem, iterations);
}

}  // namespace telefab::fab
