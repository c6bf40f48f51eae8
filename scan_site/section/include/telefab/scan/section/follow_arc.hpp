// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cmath>
#include <optional>
#include <telefab/scan/section/plane_cursor.hpp>

namespace telefab::scan {

[[nodiscard]] inline double cross(const Vec2& a, const Vec2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// A place on the section and the way on from there.
struct ArcPlace {
  Vec2 point;
  Vec2 tangent;  ///< unit, solid on the left
  double closeness_mm = 0;

  static ArcPlace of(const PlaneSample& s) { return {s.point(), s.tangent(), std::abs(s.closeness_mm)}; }
};

/// What following found.
struct ArcEnd {
  bool closed = false;  ///< once around; false: it could not go on, or was not let
  Vec2 here;            ///< the last place
  double step_mm = 0;   ///< of a closed one: the step that passes the start
  double gap_mm = 0;    ///< from the last place to the start
};

/// How a step was judged.
struct ArcStep {
  double retry = 0;           ///< > 0: refused, to be tried again at this share of its length
  bool forgets_bend = false;  ///< of a refused one: nothing is known of the turn any more
  double turn = 0;            ///< of an accepted one, in radians to the left
  bool too_far = false;       ///< of a refused one: its place lies farther on the same arc
};

/// A place between two of an arc, at a share of the chord: the cubic with both tangents, as long as a circle wants
/// them.
[[nodiscard]] inline Vec2 between(const ArcPlace& a, const ArcPlace& b, double share) {
  const double length = (b.point - a.point).norm() * (1 + (1 - a.tangent.dot(b.tangent)) / 8), rest = 1 - share;
  return rest * rest * (1 + 2 * share) * a.point + share * share * (1 + 2 * rest) * b.point +
         length * share * rest * (rest * a.tangent - share * b.tangent);
}

/// A refused place is gone to if it is at least this share of a step away: shorter steps are not worth their vertex.
inline constexpr double kShortestShare = 0.5;

/// Follows the section through `first`, solid on the left, once around, or until it ends. Each step goes along the arc
/// of the turn before and is projected onto the section; a refused place farther on shows the way to those before it,
/// and is the next one when it is near enough. `h`: the local kernel. `rules` says how:
///   bool goes_on()                        asked before every step
///   double kernel_at(point)               asked every `kernel_every` places
///   optional<ArcPlace> project(guess, kernel, most move)
///   ArcStep judge(here, next, chord, length, step)   `next` may be empty; length is then 0
///   double closing_width(length)          how far beside a step the start may lie to be the end
///   size_t places()                       so far, the first included
///   void keep(place)                      the next place
///   double next_step(turn, length, kernel)
/// and the figures first_step_mm, longest_step_kernels, shortest_step_kernels, kernel_every.
template <class Rules>
ArcEnd follow_arc(const ArcPlace& first, double h, Rules& rules) {
  ArcPlace here = first;
  double step = rules.first_step_mm;
  double bend = 0;                // signed, 1/mm, of the step before
  std::optional<ArcPlace> ahead;  // a refused place farther on
  while (rules.goes_on()) {
    if (rules.places() % Rules::kernel_every == 0) h = rules.kernel_at(here.point);
    step = std::min(step, rules.longest_step_kernels * h);
    const Vec2 left{-here.tangent.y(), here.tangent.x()};
    const double known = ahead ? (ahead->point - here.point).norm() : 0;
    const Vec2 guess = step < known ? between(here, *ahead, step / known)
                                    : Vec2{here.point + step * here.tangent + 0.5 * bend * step * step * left};
    const auto next = ahead && step >= known ? ahead : rules.project(guess, h, 0.5 * step);
    const Vec2 chord = next ? Vec2{next->point - here.point} : Vec2{0, 0};
    const double length = chord.norm();
    const ArcStep judged = rules.judge(here, next, chord, length, step);
    if (judged.retry > 0) {
      step *= judged.retry;
      if (judged.forgets_bend) bend = 0;
      ahead = judged.too_far ? next : std::nullopt;
      if (step < Rules::shortest_step_kernels * h) return {false, here.point};
      continue;
    }
    // Once around: the start lies beside this step and looks the same way.
    const Vec2 to_start = first.point - here.point;
    const double along = to_start.dot(chord) / length;
    if (rules.places() > 3 && along > 0 && along <= length * 1.0001 &&
        std::abs(cross(chord, to_start)) / length < rules.closing_width(length) &&
        first.tangent.dot(here.tangent) > 0.3)
      return {true, here.point, length, to_start.norm()};
    rules.keep(*next);
    bend = judged.turn / length;
    here = *next;
    step = rules.next_step(judged.turn, length, h);
    if (ahead && (ahead->point - here.point).dot(here.tangent) < kShortestShare * step) ahead.reset();
  }
  return {false, here.point};
}

}  // namespace telefab::scan
