// SPDX-License-Identifier: GPL-3.0-or-later
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

double solve_tile(TileProblem& problem, int iterations) {
  std::fill(problem.slope.begin(), problem.slope.end(), 0.0F);
  std::fill(problem.steepness.begin(), problem.steepness.end(), problem.regular);
  std::fill(problem.first.begin(), problem.first.end(), problem.side);
  std::fill(problem.last.begin(), problem.last.end(), 0);
  for (std::size_t i = 0; i < problem.dose.size(); ++i)
    problem.dose[i] = std::min(std::max(problem.reference[i], problem.least[i]), problem.most[i]);
  problem.ahead = problem.dose;
#ifdef TELEFAB_MASK_AVX2
  if (__builtin_cpu_supports("avx2")) return solve_tile_avx2(problem, iterations);
#endif
  return solve_tile_baseline(problem, iterations);
}

}  // namespace telefab::fab
