// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <cstdlib>

#include "layer_coding.hpp"
#include "moving_ring.hpp"

// The syntax of the coding `curve`: a ring is given as a ring of the layer below that moves, or intra.
namespace telefab::codec {

/// Set once a chunk, in its first bytes.
struct CurveSteps {
  std::int32_t residual = 4;  ///< lattice steps of one residual
  std::int32_t intra = 4;     ///< lattice steps of the coarser lattice of intra rings
};

inline constexpr unsigned kDeepestFill = 8;

/// Of the vertices over edges. They begin as if they had seen some edges of smooth curves: a half is split again where
/// its whole was bent more than a few steps, and then a quarter as much.
struct FillModels {
  FillModels();
  BitModel split[64];      ///< FillContext::split
  NumberModel<12> offset;  ///< FillContext::offset; less FillContext::guess
};

/// What is known before the two halves of an edge are coded: on an arc their middles lie a quarter as far aside as that
/// of the whole.
struct FillContext {
  unsigned depth = 0;
  std::int32_t parent = 0;  ///< offset of the whole
  [[nodiscard]] std::int32_t guess() const { return divided(parent, 4); }
  [[nodiscard]] unsigned split(GridPoint a, GridPoint b) const {
    if (depth == 0) return length_class(a, b);
    return 32 + (depth > 2 ? 16 : 0) + static_cast<unsigned>(std::min(std::abs(parent), 15));
  }
  [[nodiscard]] unsigned offset() const {
    return depth == 0 ? 0 : 1 + std::min(bit_length(static_cast<std::uint32_t>(std::abs(parent))), 10U);
  }
  [[nodiscard]] FillContext child(std::int32_t offset) const { return {depth + 1, offset}; }
};

/// The adaptive state of one chunk.
struct CurveModels {
  ChunkModels exact;  ///< certificates, counts and intra rings
  BitModel moves;
  BitModel deleted[2][12];        ///< by the fate of the vertex before, by bend
  BitModel zero[4][3][3][3];      ///< residual 0: by ResidualContext own, before, next, before2
  BitModel zero_speed[3][3][12];  ///< the same: by before, own, speed
  BitModel sign[3][3];            ///< by the signs of own and before
  BitModel sign_along[3][3][3];   ///< the same: of next, before2, before
  NumberModel<6> size;            ///< residual less 1, by history and the residual before
  NumberModel<12> large;          ///< residual less most of a large one before it, by the size of that
  FillModels fill[2];             ///< of rings that move, and of intra rings
  BitModel filled;
  NumberModel<4> small;
};

/// The fate of one vertex of the ring below.
struct VertexStep {
  bool deleted = false;
  std::int32_t residual = 0;
};

/// A node of the tree that fills the edge between two kept vertices, parents first.
struct FillNode {
  bool split = false;
  std::int32_t offset = 0;
};

struct RingPlan {
  bool moves = false;
  std::uint32_t reference = 0;    ///< of a moving ring: which ring of the layer below
  std::uint32_t start = 0;        ///< its vertex that comes first and is kept
  std::vector<VertexStep> steps;  ///< one a vertex of the reference, from `start`
  std::vector<FillNode> fills;    ///< edge after edge, the closing one last
  std::vector<GridPoint> intra;   ///< otherwise: vertices on the coarser lattice,
  bool filled = false;            ///< and whether `fills` has what lies over their edges
};

/// What layers of one chunk share: the rings below and the models. Encoder's and decoder's move alike.
struct CurveState {
  CurveModels models;
  std::vector<MovingRing> reference_layer;
};

/// Writes a layer and makes its rings the new `reference_layer`. The plan must be one that fits (made by fit_ring).
void encode_curve_layer(RangeEncoder& coder, CurveState& state, CurveSteps steps, GridPoint most,
                        const LayerCertificate& certificate, const std::vector<RingPlan>& plans);

/// Reads a layer: its rings are the new `reference_layer`. Fails with ProtocolBroken. `budget` is drawn from for every
/// vertex read or passed over, before memory is taken.
[[nodiscard]] Result<LayerCertificate> decode_curve_layer(RangeDecoder& coder, CurveState& state, CertificateForm form,
                                                          CurveSteps steps, GridPoint most, std::uint64_t& budget);

/// The residuals of the two vertices before in this layer, the nearer first.
struct ResidualsBefore {
  std::int32_t first = 0;
  std::int32_t second = 0;
};

/// A residual's size, at most 2, and sign.
struct ResidualKind {
  unsigned size = 0;
  unsigned sign = 1;  ///< 0 negative, 1 none, 2 positive
  [[nodiscard]] static ResidualKind of(std::int32_t residual) {
    return {static_cast<unsigned>(std::min(std::abs(residual), 2)), residual < 0 ? 0U : residual == 0 ? 1U : 2U};
  }
};

/// Contexts of the models, shared with the encoder's estimate of costs.
struct ResidualContext {
  bool no_history = false;
  ResidualKind own;      ///< of the layer below
  ResidualKind next;     ///< of the next vertex in the layer below
  ResidualKind before;   ///< of the vertex before in this layer
  ResidualKind before2;  ///< of the one before that
  unsigned speed = 0;    ///< bit length of the expected move in steps of four; at most 11
  std::int32_t residual_before = 0;
  [[nodiscard]] unsigned size() const { return (no_history ? 3 : 0) + before.size; }
  /// Where a whole stretch moves otherwise than expected, the next vertex most likely does so too.
  [[nodiscard]] bool is_after_large() const { return std::abs(residual_before) > 2; }
  [[nodiscard]] std::int32_t guess() const { return divided(residual_before * 3, 4); }
  [[nodiscard]] unsigned large_size() const {
    return std::min(bit_length(static_cast<std::uint32_t>(std::abs(residual_before))), 11U);
  }
  [[nodiscard]] static ResidualContext of(const MovingVertex& v, const MovingVertex& next, ResidualsBefore before);
  template <class Models>  // CurveModels, const or not
  [[nodiscard]] auto zero_models(Models& m) const {
    return BitPair{m.zero[no_history ? 3 : own.size][before.size][next.size][before2.size],
                   m.zero_speed[before.size][own.size][speed]};
  }
  template <class Models>  // CurveModels, const or not
  [[nodiscard]] auto sign_models(Models& m) const {
    return BitPair{m.sign[own.sign][before.sign], m.sign_along[next.sign][before2.sign][before.sign]};
  }
};

}  // namespace telefab::codec
