// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <telefab/fab/verify/hollow_watch.hpp>
#include <telefab/fab/verify/support_check.hpp>

namespace telefab::fab {
struct MaskWatch::State {
  double pitch_mm = 0;
  std::uint32_t least = 4;
  std::uint32_t layers = 0;
  std::vector<Finding> findings;
  LayerRuns solid_below;
  std::vector<char> held_below;  ///< by run of solid_below
  HollowWatch hollows{least};

  [[nodiscard]] Point2 place(std::int32_t column, std::uint32_t row) const {
    return {(column + 0.5) * pitch_mm, (row + 0.5) * pitch_mm};
  }
  [[nodiscard]] double area(std::uint64_t pixels) const { return static_cast<double>(pixels) * pitch_mm * pitch_mm; }

  /// What hangs together in a layer.
  struct Bodies {
    struct Body {
      std::uint64_t pixels = 0;  ///< of `solid`
      std::uint64_t lit = 0;     ///< of them
      std::int32_t widest = 0;   ///< of its runs, in pixels
      std::int32_t column = 0;   ///< of that run's middle
      std::uint32_t row = 0;
      bool held = false;  ///< by material below or the platform
    };
    std::vector<Body> bodies;
    std::vector<std::uint32_t> of_run;  ///< of the solid ones
    [[nodiscard]] static bool floats(const Body& body, std::uint32_t least) { return !body.held && body.lit >= least; }
  };

  [[nodiscard]] Bodies bodies_of(const LayerRuns& solid, const LayerLight* light) const {
    Bodies found;
    auto& bodies = found.bodies;  // no structured binding: older clangs cannot take one into a lambda
    auto& body_of = found.of_run;
    const RunComponents parts = components_of(light ? light->joined : solid, true);
    bodies.resize(parts.components.size());
    body_of.resize(solid.count());
    if (light)
      for_overlaps(solid, light->joined,
                   [&](std::uint32_t run, std::uint32_t whole) { body_of[run] = parts.of_run[whole]; });
    else
      body_of = parts.of_run;
    for (std::uint32_t y = 0; y < solid.size().height_px; ++y)
      for (std::uint32_t r = solid.row_start(y); r < solid.row_start(y) + solid.row(y).size(); ++r) {
        const PixelRun& run = solid.run(r);
        Bodies::Body& body = bodies[body_of[r]];
        if (run.width() > body.widest) {
          body.widest = run.width();
          body.column = run.first + (run.width() - 1) / 2;
          body.row = y;
        }
        body.pixels += static_cast<std::uint64_t>(run.width());
        if (!light) body.lit = body.pixels;
      }
    if (light)
      for_overlaps(solid, light->lit, [&](std::uint32_t here, std::uint32_t lit) {
        const PixelRun &a = solid.run(here), &b = light->lit.run(lit);
        const PixelRun both{std::max(a.first, b.first), std::min(a.behind, b.behind)};
        bodies[body_of[here]].lit += static_cast<std::uint64_t>(both.width());
      });
    if (layers > 0)
      for_overlaps(solid, solid_below, [&](std::uint32_t here, std::uint32_t below) {
        bodies[body_of[here]].held |= held_below[below] != 0;
      });
    if (layers == 0)
      for (Bodies::Body& body : bodies) body.held = true;
    return found;
  }

  void look_for_islands(const LayerRuns& solid, const LayerLight* light) {
    Bodies found = bodies_of(solid, light);
    for (Bodies::Body& body : found.bodies) {
      if (!Bodies::floats(body, least)) continue;
      findings.push_back({Finding::Kind::Island, LayerIndex{layers}, LayerIndex{layers}, place(body.column, body.row),
                          area(body.pixels)});
      body.held = true;  // what stands on it is not reported again
    }
    held_below.assign(solid.count(), 0);
    for (std::uint32_t r = 0; r < solid.count(); ++r) held_below[r] = found.bodies[found.of_run[r]].held;
  }

  void report(const Hollow& hollow) {
    Finding found{Finding::Kind::SuctionCup, LayerIndex{hollow.first}, LayerIndex{hollow.last},
                  place(hollow.column, hollow.row), area(hollow.most_pixels)};
    if (hollow.kind == Hollow::Kind::Trap) found.kind = Finding::Kind::ResinTrap;
    findings.push_back(found);
    // What the platform closes is open once the print is taken off it.
    if (hollow.kind == Hollow::Kind::Trap && hollow.holds_support && hollow.first > 0) {
      found.kind = Finding::Kind::TrappedSupport;
      findings.push_back(found);
    }
  }
};

MaskWatch::MaskWatch(double pitch_mm, std::uint32_t least_pixels)
    : state_{std::make_unique<State>(State{.pitch_mm = pitch_mm, .least = least_pixels})} {}
MaskWatch::~MaskWatch() = default;
MaskWatch::MaskWatch(MaskWatch&&) noexcept = default;
MaskWatch& MaskWatch::operator=(MaskWatch&&) noexcept = default;

Result<void> MaskWatch::add(LayerRuns layer, const LayerRuns* removable, const LayerLight* light) {
  State& s = *state_;
  if (s.layers > 0 && !(layer.size() == s.solid_below.size()))
    return fail(ErrorCode::InvalidInput, "checking masks: the masks differ in size");
  if (light && !(light->joined.size() == layer.size() && light->lit.size() == layer.size()))
    return fail(ErrorCode::InvalidInput, "checking masks: a layer and its light differ in size");
  s.look_for_islands(layer, light);
  s.hollows.add(layer, removable);
  s.solid_below = std::move(layer);
  ++s.layers;
  return {};
}

LayerRuns MaskWatch::specks(const LayerRuns& layer, const LayerLight* light, std::uint64_t most_pixels) const {
  const State& s = *state_;
  const State::Bodies found = s.bodies_of(layer, light);
  std::vector<char> is_speck(layer.count());
  for (std::uint32_t r = 0; r < layer.count(); ++r) {
    const auto& body = found.bodies[found.of_run[r]];
    is_speck[r] = State::Bodies::floats(body, s.least) && body.pixels <= most_pixels;
  }
  return LayerRuns::some_of(layer, is_speck);
}

SupportReport MaskWatch::finish() {
  State& s = *state_;
  for (const Hollow& hollow : s.hollows.finish()) s.report(hollow);
  SupportReport report;
  report.layers = s.layers;
  report.findings = std::move(s.findings);
  std::stable_sort(report.findings.begin(), report.findings.end(), [](const Finding& a, const Finding& b) {
    if (a.layer != b.layer) return a.layer < b.layer;
    return a.place.y_mm != b.place.y_mm ? a.place.y_mm < b.place.y_mm : a.place.x_mm < b.place.x_mm;
  });
  *state_ = State{.pitch_mm = s.pitch_mm, .least = s.least};
  return report;
}

}  // namespace telefab::fab
