// SPDX-License-Identifier: GPL-3.0-or-later
#include "tile_solver.hpp"

// Compiled with AVX2 where the processor family has it; called only where the processor at hand has it.
namespace telefab::fab {
namespace {
struct Avx2 {};
}  // namespace

double solve_tile_avx2(TileProblem& problem, int iterations) { return TileSolver<Avx2>::solve(problem, iterations); }

}  // namespace telefab::fab
