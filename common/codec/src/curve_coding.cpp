// SPDX-License-Identifier: GPL-3.0-or-later
#include "curve_coding.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <telefab/geometry/limits.hpp>

namespace telefab::codec {
namespace {

tl::unexpected<Error> broken(std::string what) { return fail(ErrorCode::ProtocolBroken, std::move(what)); }

enum SmallContext : unsigned { kRings, kReference, kStart };

/// The same function writes and reads: with Writing the arguments hold the values, with Reading they take them.
struct Writing {
  RangeEncoder& coder;
  template <class Model>
  void bit(Model&& model, bool& value) const {
    coder.encode(model, value ? 1 : 0);
  }
  template <unsigned N>
  void number(NumberModel<N>& model, std::uint32_t& value, unsigned context) const {
    model.encode(coder, value, context);
  }
  [[nodiscard]] static bool overrun() { return false; }
};

struct Reading {
  RangeDecoder& coder;
  template <class Model>
  void bit(Model&& model, bool& value) const {
    value = coder.decode(model) != 0;
  }
  template <unsigned N>
  void number(NumberModel<N>& model, std::uint32_t& value, unsigned context) const {
    value = model.decode(coder, context);
  }
  [[nodiscard]] bool overrun() const { return coder.overrun(); }
};

template <class Bits>
void code_signed(const Bits& bits, NumberModel<4>& model, std::int32_t& value, unsigned context) {
  std::uint32_t number = zigzag(value);
  bits.number(model, number, context);
  value = unzigzag(number);
}

template <class Bits>
void code_residual(const Bits& bits, CurveModels& models, const ResidualContext& near, std::int32_t& residual) {
  if (near.is_after_large()) {
    std::uint32_t rest = zigzag(residual - near.guess());
    bits.number(models.large, rest, near.large_size());
    const std::int64_t all = std::int64_t{near.guess()} + unzigzag(rest);
    residual = static_cast<std::int32_t>(std::clamp<std::int64_t>(all, -kMaxDistance, kMaxDistance));
    return;
  }
  bool some = residual != 0;
  bits.bit(near.zero_models(models), some);
  if (!some) {
    residual = 0;
    return;
  }
  bool negative = residual < 0;
  bits.bit(near.sign_models(models), negative);
  std::uint32_t size = static_cast<std::uint32_t>(std::abs(residual)) - 1;
  bits.number(models.size, size, near.size());
  size = std::min<std::uint32_t>(size, kMaxDistance);
  residual = static_cast<std::int32_t>(size + 1) * (negative ? -1 : 1);
}

/// The vertices over edges, one edge after the other. Appends them to a ring.
template <class Bits>
class EdgeFilling {
 public:
  EdgeFilling(const Bits& bits, FillModels& models, std::int32_t step, GridPoint most, std::uint64_t& budget,
              std::vector<FillNode>& nodes, MovingRing& made)
      : bits_{bits}, models_{models}, step_{step}, most_{most}, budget_{budget}, nodes_{nodes}, made_{made} {}

  Result<void> fill(const MovingVertex& a, const MovingVertex& b) { return fill(a, b, FillContext{}); }

 private:
  Result<void> fill(const MovingVertex& a, const MovingVertex& b, const FillContext& context) {
    if (context.depth > kDeepestFill) return {};
    if (next_ == nodes_.size()) nodes_.emplace_back();
    FillNode node = nodes_[next_];
    bits_.bit(models_.split[context.split(a.at, b.at)], node.split);
    if (!node.split) {
      nodes_[next_++] = node;
      return {};
    }
    if (budget_ == 0) return broken("more vertices than a layer or chunk may have");
    --budget_;
    std::uint32_t more = zigzag(node.offset - context.guess());
    bits_.number(models_.offset, more, context.offset());
    const std::int64_t offset = std::int64_t{context.guess()} + unzigzag(more);
    if (offset < -kMaxDistance || offset > kMaxDistance) return broken("a vertex lies outside the stated bounds");
    node.offset = static_cast<std::int32_t>(offset);
    nodes_[next_++] = node;
    MovingVertex between;
    if (!make_between(a, b, node.offset, step_, most_, between))
      return broken("a vertex lies outside the stated bounds");
    if (auto done = fill(a, between, context.child(node.offset)); !done) return done;
    made_.push_back(between);
    return fill(between, b, context.child(node.offset));
  }

  const Bits& bits_;
  FillModels& models_;
  std::int32_t step_;
  GridPoint most_;
  std::uint64_t& budget_;
  std::vector<FillNode>& nodes_;
  MovingRing& made_;
  std::size_t next_ = 0;
};

/// One ring that moves. The source is the reference from `start` on; every source vertex is passed once.
template <class Bits>
class RingMotion {
 public:
  RingMotion(const Bits& bits, CurveModels& models, CurveSteps steps, GridPoint most, std::uint64_t& budget)
      : bits_{bits}, models_{models}, steps_{steps}, most_{most}, budget_{budget} {}

  Result<MovingRing> code(const MovingRing& source, RingPlan& plan) {
    const std::vector<Corner> corners = corners_of(source);
    const MoveRule rule{steps_.residual};
    plan.steps.resize(source.size());
    EdgeFilling<Bits> edges{bits_, models_.fill[0], steps_.residual, most_, budget_, plan.fills, made_};
    std::int32_t move_before = 0;
    ResidualsBefore before;
    bool deleted_before = false;
    for (std::size_t k = 0; k < source.size(); ++k) {
      const std::size_t i = (k + plan.start) % source.size();
      VertexStep& step = plan.steps[k];
      if (k % 64 == 0 && bits_.overrun()) return broken("the chunk ends in the middle of a ring");
      if (k > 0) bits_.bit(models_.deleted[deleted_before ? 1 : 0][corners[i].bend], step.deleted);
      deleted_before = step.deleted;
      if (step.deleted) continue;
      code_residual(bits_, models_, ResidualContext::of(source[i], source[i + 1 == source.size() ? 0 : i + 1], before),
                    step.residual);
      MovingVertex v = source[i];
      const std::int32_t expected = rule.expected(v, move_before);
      if (!rule.apply(v, corners[i].normal, expected, step.residual, most_))
        return broken("a vertex lies outside the stated bounds");
      before = {step.residual, before.first};
      move_before = expected + step.residual * steps_.residual * kDistanceUnit;
      if (!made_.empty())
        if (auto done = edges.fill(MovingVertex{made_.back()}, v); !done) return tl::unexpected{done.error()};
      if (!made_.empty() && made_.back().at == v.at) return broken("two neighbouring vertices are equal");
      made_.push_back(v);
    }
    const MovingVertex last = made_.back();
    const MovingVertex first = made_.front();
    if (auto done = edges.fill(last, first); !done) return tl::unexpected{done.error()};
    if (made_.size() < 3 || made_.back().at == made_.front().at) return broken("a ring without area");
    smooth_motion(made_);
    return std::move(made_);
  }

 private:
  const Bits& bits_;
  CurveModels& models_;
  CurveSteps steps_;
  GridPoint most_;
  std::uint64_t& budget_;
  MovingRing made_;
};

GridPoint coarser(GridPoint most, std::int32_t step) { return {most.x / step, most.y / step}; }

/// What lies over the edges of an intra ring; the ring itself is coded already.
template <class Bits>
Result<MovingRing> code_intra(const Bits& bits, CurveModels& models, CurveSteps steps, GridPoint most, RingPlan& plan,
                              std::uint64_t& budget) {
  MovingRing corners;
  corners.reserve(plan.intra.size());
  for (const GridPoint p : plan.intra) corners.push_back({{p.x * steps.intra, p.y * steps.intra}});
  bits.bit(models.filled, plan.filled);
  if (!plan.filled) return corners;
  MovingRing made;
  EdgeFilling<Bits> edges{bits, models.fill[1], steps.residual, most, budget, plan.fills, made};
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (i % 64 == 0 && bits.overrun()) return broken("the chunk ends in the middle of a ring");
    made.push_back(corners[i]);
    if (auto done = edges.fill(corners[i], corners[i + 1 == corners.size() ? 0 : i + 1]); !done)
      return tl::unexpected{done.error()};
  }
  return made;
}

template <class Bits>
Result<MovingRing> code_motion(const Bits& bits, CurveState& state, CurveSteps steps, GridPoint most, RingPlan& plan,
                               std::vector<bool>& used, std::uint32_t& expected, std::uint64_t& budget) {
  std::int32_t ahead = static_cast<std::int32_t>(plan.reference) - static_cast<std::int32_t>(expected);
  code_signed(bits, state.models.small, ahead, kReference);
  const std::int64_t reference = std::int64_t{expected} + ahead;
  if (reference < 0 || reference >= static_cast<std::int64_t>(state.reference_layer.size()) ||
      used[static_cast<std::size_t>(reference)])
    return broken("a ring refers to a ring below that is not there or used already");
  plan.reference = static_cast<std::uint32_t>(reference);
  used[plan.reference] = true;
  expected = plan.reference + 1;
  const MovingRing& source = state.reference_layer[plan.reference];
  if (source.size() > budget) return broken("more vertices than a layer or chunk may have");
  budget -= source.size();
  bits.number(state.models.small, plan.start, kStart);
  if (plan.start >= source.size()) return broken("a ring starts at a vertex that is not there");
  return RingMotion<Bits>{bits, state.models, steps, most, budget}.code(source, plan);
}

}  // namespace

FillModels::FillModels() {
  // Halves that are not split, of eight, by the offset of the whole.
  constexpr std::array<unsigned, 16> whole_of_eight{2, 8, 7, 6, 5, 3, 2, 2, 1, 1, 1, 1, 1, 1, 1, 0};
  for (unsigned parent = 0; parent < whole_of_eight.size(); ++parent)
    for (unsigned i = 0; i < 8; ++i)
      for (const unsigned deeper : {0U, 16U}) split[32 + deeper + parent].learn(i < whole_of_eight[parent] ? 0 : 1);
  for (unsigned context = 1; context < 12; ++context) {
    const std::uint32_t widest = context < 4 ? 3 : 1U << (context - 1);
    for (std::uint32_t value = 0; value < widest; value += 1 + value / 4)
      for (std::uint32_t times = 0; times < 1 + (value < 3 ? 4U : 0U); ++times) offset.learn(value, context);
  }
}

ResidualContext ResidualContext::of(const MovingVertex& v, const MovingVertex& next, ResidualsBefore before) {
  ResidualContext near;
  near.no_history = v.no_history;
  near.own = ResidualKind::of(v.last);
  near.next = ResidualKind::of(next.last);
  if (next.no_history) near.next.size = 1;
  near.before = ResidualKind::of(before.first);
  near.before2 = ResidualKind::of(before.second);
  near.speed = std::min(bit_length(static_cast<std::uint32_t>(std::abs(v.velocity)) >> 6U), 11U);
  near.residual_before = before.first;
  return near;
}

void encode_curve_layer(RangeEncoder& coder, CurveState& state, CurveSteps steps, GridPoint most,
                        const LayerCertificate& certificate, const std::vector<RingPlan>& plans) {
  const Writing bits{coder};
  encode_certificate(coder, state.models.exact, certificate);
  std::int32_t more = static_cast<std::int32_t>(plans.size()) - static_cast<std::int32_t>(state.reference_layer.size());
  code_signed(bits, state.models.small, more, kRings);
  std::vector<bool> used(state.reference_layer.size());
  std::uint32_t expected = 0;
  std::uint64_t no_limit = ~std::uint64_t{0};
  std::vector<MovingRing> made;
  GridPoint first{};
  for (RingPlan plan : plans) {
    bits.bit(state.models.moves, plan.moves);
    if (plan.moves) {
      made.push_back(code_motion(bits, state, steps, most, plan, used, expected, no_limit).value());
    } else {
      encode_ring(coder, state.models.exact, plan.intra, first);
      first = plan.intra[0];
      made.push_back(code_intra(bits, state.models, steps, most, plan, no_limit).value());
    }
  }
  state.reference_layer = std::move(made);
}

Result<LayerCertificate> decode_curve_layer(RangeDecoder& coder, CurveState& state, CertificateForm form,
                                            CurveSteps steps, GridPoint most, std::uint64_t& budget) {
  const Reading bits{coder};
  auto certificate = decode_certificate(coder, state.models.exact, form);
  if (!certificate) return certificate;
  std::int32_t more = 0;
  code_signed(bits, state.models.small, more, kRings);
  const std::int64_t rings = static_cast<std::int64_t>(state.reference_layer.size()) + more;
  if (rings < 0 || rings > kMaxRingsPerLayer)
    return broken(fmt::format("{} rings, at most {} are allowed", rings, kMaxRingsPerLayer));
  std::vector<bool> used(state.reference_layer.size());
  std::uint32_t expected = 0;
  std::vector<MovingRing> made;
  GridPoint first{};
  std::size_t vertices = 0;
  for (std::int64_t r = 0; r < rings; ++r) {
    RingPlan plan;
    bits.bit(state.models.moves, plan.moves);
    if (plan.moves) {
      auto ring = code_motion(bits, state, steps, most, plan, used, expected, budget);
      if (!ring) return tl::unexpected{ring.error()};
      made.push_back(std::move(*ring));
    } else {
      auto corners = decode_ring(coder, state.models.exact, first, coarser(most, steps.intra), budget);
      if (!corners) return tl::unexpected{corners.error()};
      first = corners->front();
      plan.intra = std::move(*corners);
      auto ring = code_intra(bits, state.models, steps, most, plan, budget);
      if (!ring) return tl::unexpected{ring.error()};
      made.push_back(std::move(*ring));
    }
    vertices += made.back().size();
    if (vertices > kMaxVerticesPerLayer) return broken("more vertices than a layer or chunk may have");
  }
  if (coder.overrun()) return broken("the chunk ends in the middle of a layer");
  state.reference_layer = std::move(made);
  return certificate;
}

}  // namespace telefab::codec
