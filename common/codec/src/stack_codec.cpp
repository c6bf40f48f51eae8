// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/geometry/limits.hpp>

#include "carry_runs.hpp"
#include "curve_layer.hpp"
#include "ring_check.hpp"

namespace telefab {
namespace {

using codec::Grid;
using codec::GridLayer;

constexpr std::size_t kClosePayloadBytes = 256U << 10U;  // a chunk of dense layers is closed early
constexpr std::size_t kMaxPayloadBytes = 3U << 20U;      // what the wire takes
constexpr std::uint64_t kMaxVerticesPerChunk = 8'000'000;
constexpr std::uint32_t kMostLayersPerChunk = 64;
constexpr std::uint32_t kExactPerPitch = 16;
constexpr std::uint32_t kCurvePerPitch = 64;

bool is_curve(Coding coding) { return coding == Coding::Curve || coding == Coding::CurveInWords; }
codec::CertificateForm form_of(Coding coding) {
  return coding == Coding::ExactInWords || coding == Coding::CurveInWords ? codec::CertificateForm::InWords
                                                                          : codec::CertificateForm::Enumerated;
}

/// The first bytes of a payload: coding, lattice steps a pixel, and of curves the two steps.
struct PayloadHead {
  Coding coding = Coding::Exact;
  std::uint32_t per_pitch = 0;
  codec::CurveSteps steps;

  [[nodiscard]] std::vector<std::byte> bytes() const {
    std::vector<std::byte> made{static_cast<std::byte>(coding), static_cast<std::byte>(per_pitch)};
    if (is_curve(coding)) {
      made.push_back(static_cast<std::byte>(steps.residual));
      made.push_back(static_cast<std::byte>(steps.intra));
    }
    return made;
  }

  [[nodiscard]] static std::optional<PayloadHead> from(std::span<const std::byte> payload) {
    const auto at = [&](std::size_t i) { return i < payload.size() ? std::to_integer<std::int32_t>(payload[i]) : 0; };
    PayloadHead head{static_cast<Coding>(at(0)), static_cast<std::uint32_t>(at(1)), {at(2), at(3)}};
    if (head.per_pitch < 4 || payload.size() < head.size()) return std::nullopt;
    if (head.coding == Coding::Exact || head.coding == Coding::ExactInWords) return head;
    if (is_curve(head.coding) && head.steps.residual > 0 && head.steps.intra > 0) return head;
    return std::nullopt;
  }
  [[nodiscard]] std::size_t size() const { return is_curve(coding) ? 4 : 2; }
};

/// Residual steps of nine tenths of the tolerance (measured: 0.6 costs 7 % more, 1.2 3 %); new rings as coarse as the
/// tolerance lets their vertices move.
codec::FitRule fit_rule(const CodecOptions& options, const Grid& grid) {
  codec::FitRule rule;
  rule.tolerance = (options.total_error_pitch - options.chord_error_pitch) * kCurvePerPitch;
  rule.steps.residual = static_cast<std::int32_t>(std::clamp(std::floor(rule.tolerance * 0.9 + 0.5), 1.0, 64.0));
  rule.steps.intra = rule.tolerance >= 6 ? 4 : rule.tolerance >= 3 ? 2 : 1;
  rule.most = grid.most();
  return rule;
}

Result<std::vector<Contour>> contours_of(const std::vector<std::vector<codec::GridPoint>>& rings, const Grid& grid) {
  std::vector<Contour> contours;
  contours.reserve(rings.size());
  for (const auto& ring : rings) {
    auto contour = grid.contour(ring);
    if (!contour) return tl::unexpected{contour.error()};
    contours.push_back(std::move(*contour));
  }
  return contours;
}

void feed_number(Hasher& hasher, std::uint32_t value) {
  std::array<std::byte, 4> bytes{};
  for (unsigned i = 0; i < 4; ++i) bytes[i] = static_cast<std::byte>(value >> (8 * i));
  hasher.feed(bytes);
}

}  // namespace

Result<void> CodecOptions::validate() const {
  if (coding != Coding::Exact && coding != Coding::Curve)
    return fail(ErrorCode::InvalidInput, "unknown contour coding");
  if (layers_per_chunk < 1 || layers_per_chunk > kMostLayersPerChunk)
    return fail(ErrorCode::InvalidInput, fmt::format("layers a chunk must be 1 to {}", kMostLayersPerChunk));
  if (!(chord_error_pitch >= 0 && chord_error_pitch < 1))
    return fail(ErrorCode::InvalidInput, fmt::format("chord error {} pitch is not in [0, 1)", chord_error_pitch));
  if (!(total_error_pitch - chord_error_pitch >= 0.02 && total_error_pitch <= 1))
    return fail(ErrorCode::InvalidInput, fmt::format("total error {} pitch must be at most 1 and leave 0.02 beside the "
                                                     "slicer's chords ({}); cut shorter chords or allow more",
                                                     total_error_pitch, chord_error_pitch));
  return {};
}

namespace {

Result<GridLayer> decode_curve(codec::RangeDecoder& coder, codec::CurveState& state, const PayloadHead& head,
                               codec::GridPoint most, std::uint64_t& budget) {
  auto certificate = codec::decode_curve_layer(coder, state, form_of(head.coding), head.steps, most, budget);
  if (!certificate) return tl::unexpected{certificate.error()};
  return GridLayer{codec::canonical_rings(codec::positions_of(state.reference_layer)), std::move(*certificate)};
}

}  // namespace

bool is_of_earlier_release(const Chunk& chunk) {
  const auto head = PayloadHead::from(chunk.payload);
  return head && form_of(head->coding) == codec::CertificateForm::InWords;
}

ChunkChain::ChunkChain(const StackHeader& header) {
  Hasher hasher;
  hasher.feed("telefab chunk chain 1\n");
  hasher.feed(canonical_text(header));
  value_ = hasher.digest();
}

Digest ChunkChain::add(const Chunk& chunk) {
  Hasher hasher;
  hasher.feed(value_.bytes);
  feed_number(hasher, chunk.sequence);
  feed_number(hasher, chunk.first_layer.count());
  feed_number(hasher, chunk.layer_count);
  hasher.feed(chunk.payload);
  return value_ = hasher.digest();
}

struct StackEncoder::State {
  StackHeader header;
  CodecOptions options;
  Grid grid;
  codec::FitRule rule;
  Hasher stack_hasher;
  std::uint32_t next_layer = 0;
  std::uint32_t next_sequence = 0;

  // The chunk under way.
  codec::RangeEncoder coder;
  std::unique_ptr<codec::CurveState> curve = std::make_unique<codec::CurveState>();
  std::vector<Layer> pending;
  std::vector<Layer> given;
  double worst_error_steps = 0;

  Chunk close() {
    Chunk chunk;
    chunk.sequence = next_sequence++;
    chunk.first_layer = pending.front().index;
    chunk.layer_count = static_cast<std::uint32_t>(pending.size());
    chunk.payload = head().bytes();
    const std::vector<std::byte> body = coder.finish();
    chunk.payload.insert(chunk.payload.end(), body.begin(), body.end());
    for (const Layer& layer : pending) stack_hasher.feed(canonical_text(layer));
    given = std::move(pending);
    pending.clear();
    coder = {};
    curve = std::make_unique<codec::CurveState>();
    return chunk;
  }

  /// Closes the chunk and decodes it: what was not written as meant never leaves.
  Result<std::optional<Chunk>> give() {
    Chunk chunk = close();
    const auto decoder = StackDecoder::start(header);
    if (!decoder) return tl::unexpected{decoder.error()};
    const auto decoded = decoder->decode(chunk);
    if (!decoded) return fail(ErrorCode::Internal, fmt::format("own {}", decoded.error().what));
    if (*decoded != given)
      return fail(
          ErrorCode::Internal,
          fmt::format("chunk {} decodes to other layers than it was made of; please report it", chunk.sequence));
    return std::optional<Chunk>{std::move(chunk)};
  }

  [[nodiscard]] PayloadHead head() const {
    return {options.coding, is_curve(options.coding) ? kCurvePerPitch : kExactPerPitch, rule.steps};
  }

  // What the coding cannot keep, the certificate admits.
  static LayerCertificate lose(LayerCertificate certificate, const Contour& contour) {
    certificate.flag({DoubtReason::RingTooSmall, contour.vertices()[0]});
    certificate.measured_euler -= contour.is_hole() ? -1 : 1;
    return certificate;
  }

  /// A certificate promises rings that neither cross nor nest wrongly.
  [[nodiscard]] static bool keeps_promise(const LayerCertificate& c,
                                          const std::vector<std::vector<codec::GridPoint>>& r) {
    return !c.is_certified() || check_rings(r).has_value();
  }

  std::vector<std::vector<codec::GridPoint>> add_exact(const Layer& layer, LayerCertificate& certificate) {
    GridLayer coded;
    for (const Contour& contour : layer.contours) {
      auto ring = grid.snap(contour);
      if (ring.empty()) {
        certificate = lose(std::move(certificate), contour);
        continue;
      }
      for (const Point2 v : contour.vertices()) {
        const codec::Place p = grid.place(v);
        const codec::GridPoint q = grid.snap(v);
        worst_error_steps =
            std::max(worst_error_steps, std::sqrt((p.x - q.x) * (p.x - q.x) + (p.y - q.y) * (p.y - q.y)));
      }
      coded.rings.push_back(std::move(ring));
    }
    if (!keeps_promise(certificate, coded.rings)) certificate.flag({DoubtReason::CrossOnLattice});
    coded.certificate = certificate;
    codec::encode_layer(coder, curve->models.exact, coded);
    return std::move(coded.rings);
  }

  std::vector<std::vector<codec::GridPoint>> add_curve(const Layer& layer, LayerCertificate& certificate) {
    codec::LayerFit fit = codec::fit_layer(layer, grid, *curve, rule, false);
    if (!keeps_promise(certificate, fit.rings)) {
      codec::LayerFit exact = codec::fit_layer(layer, grid, *curve, rule, true);
      if (keeps_promise(certificate, exact.rings))
        fit = std::move(exact);
      else  // they cross as given; every vertex kept would not help
        certificate.flag({DoubtReason::CrossOnLattice});
    }
    for (const std::size_t lost : fit.lost) certificate = lose(std::move(certificate), layer.contours[lost]);
    codec::encode_curve_layer(coder, *curve, rule.steps, grid.most(), certificate, fit.plans);
    worst_error_steps = std::max(worst_error_steps, fit.error);
    return codec::canonical_rings(codec::positions_of(curve->reference_layer));
  }
};

StackEncoder::StackEncoder(std::unique_ptr<State> state) : state_{std::move(state)} {}
StackEncoder::StackEncoder(StackEncoder&&) noexcept = default;
StackEncoder& StackEncoder::operator=(StackEncoder&&) noexcept = default;
StackEncoder::~StackEncoder() = default;

Result<StackEncoder> StackEncoder::start(StackHeader header, const CodecOptions& options) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (auto ok = header.validate(); !ok) return tl::unexpected{ok.error()};
  auto grid = Grid::over(header, is_curve(options.coding) ? kCurvePerPitch : kExactPerPitch);
  if (!grid) return tl::unexpected{grid.error()};
  auto state = std::make_unique<State>();
  state->options = options;
  state->grid = *grid;
  state->rule = fit_rule(options, *grid);
  state->stack_hasher.feed(canonical_text(header));
  state->header = std::move(header);
  return StackEncoder{std::move(state)};
}

Result<std::optional<Chunk>> StackEncoder::add(const Layer& layer) {
  State& s = *state_;
  if (layer.index.count() != s.next_layer)
    return fail(ErrorCode::InvalidInput,
                fmt::format("layer {} came where layer {} was due", layer.index.count(), s.next_layer));
  if (auto ok = validate_layer(s.header, layer); !ok) return tl::unexpected{ok.error()};

  LayerCertificate certificate = codec::as_coded(layer.certificate);
  const auto rings = is_curve(s.options.coding) ? s.add_curve(layer, certificate) : s.add_exact(layer, certificate);
  auto contours = contours_of(rings, s.grid);
  if (contours) contours = codec::carry_runs(layer.contours, std::move(*contours));
  if (!contours) return fail(ErrorCode::Internal, contours.error().what);
  codec::encode_runs(s.coder, s.curve->models.exact, *contours);
  Layer decoded{layer.index, layer.z_mm, std::move(*contours), std::move(certificate)};
  s.pending.push_back(std::move(decoded));
  ++s.next_layer;
  if (s.coder.size() > kMaxPayloadBytes - 16)
    return fail(ErrorCode::TooLarge,
                fmt::format("layer {} does not fit a chunk of {} bytes", layer.index.count(), kMaxPayloadBytes));
  if (s.pending.size() < s.options.layers_per_chunk && s.coder.size() < kClosePayloadBytes)
    return std::optional<Chunk>{};
  return s.give();
}

Result<std::optional<Chunk>> StackEncoder::finish() {
  State& s = *state_;
  if (s.next_layer != s.header.layer_count)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the stack ends after {} of {} layers", s.next_layer, s.header.layer_count));
  if (s.pending.empty()) {
    s.given.clear();
    return std::optional<Chunk>{};
  }
  return s.give();
}

std::span<const Layer> StackEncoder::coded_layers() const { return state_->given; }
double StackEncoder::worst_error_pitch() const { return state_->worst_error_steps / state_->head().per_pitch; }
Digest StackEncoder::stack_digest() const { return state_->stack_hasher.digest(); }

Result<StackDecoder> StackDecoder::start(StackHeader header) {
  if (auto ok = header.validate(); !ok) return tl::unexpected{ok.error()};
  return StackDecoder{std::move(header)};
}

Result<std::vector<Layer>> StackDecoder::decode(const Chunk& chunk) const {
  const auto broken = [&](std::string what) {
    return fail(ErrorCode::ProtocolBroken, fmt::format("chunk {}: {}", chunk.sequence, what));
  };
  const std::uint64_t end = std::uint64_t{chunk.first_layer.count()} + chunk.layer_count;
  if (chunk.layer_count == 0 || chunk.layer_count > kMostLayersPerChunk || end > header_.layer_count)
    return broken(fmt::format("layers {} to {} are not layers of this stack", chunk.first_layer.count(), end));
  if (chunk.payload.size() > kMaxPayloadBytes) return broken("the payload is too long");
  const auto head = PayloadHead::from(chunk.payload);
  if (!head) {
    const auto number = chunk.payload.empty() ? 0U : std::to_integer<std::uint32_t>(chunk.payload[0]);
    if (number >= 1 && number <= 4)
      return broken(fmt::format(
          "coding {} is that of an earlier release, this one reads {} to {}; send it again from "
          "its scan site after both are of the same release",
          number, static_cast<std::uint32_t>(Coding::ExactInWords), static_cast<std::uint32_t>(Coding::Curve)));
    return broken("an unknown coding, or steps that are impossible");
  }
  const auto grid = Grid::over(header_, head->per_pitch);
  if (!grid) return broken(grid.error().what);

  codec::RangeDecoder coder{std::span{chunk.payload}.subspan(head->size())};
  const auto state = std::make_unique<codec::CurveState>();
  std::uint64_t budget = kMaxVerticesPerChunk;
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < chunk.layer_count; ++i) {
    const LayerIndex index{chunk.first_layer.count() + i};
    const auto wrong = [&](const Error& error) {
      return broken(fmt::format("layer {}: {}", index.count(), error.what));
    };
    const codec::CertificateForm form = form_of(head->coding);
    auto coded = is_curve(head->coding) ? decode_curve(coder, *state, *head, grid->most(), budget)
                                        : codec::decode_layer(coder, state->models.exact, form, grid->most(), budget);
    if (!coded) return wrong(coded.error());
    if (coded->certificate.is_certified())
      if (auto checked = codec::check_rings(coded->rings); !checked) return wrong(checked.error());
    auto contours = contours_of(coded->rings, *grid);
    if (contours && form == codec::CertificateForm::Enumerated)
      contours = codec::decode_runs(coder, state->models.exact, std::move(*contours));
    if (!contours) return wrong(contours.error());
    Layer layer{index, cut_height_mm(index, header_.layer_thickness_mm), std::move(*contours), coded->certificate};
    if (auto valid = validate_layer(header_, layer); !valid) return broken(valid.error().what);
    layers.push_back(std::move(layer));
  }
  if (!coder.at_end()) return broken("bytes are left over behind the last layer");
  return layers;
}

}  // namespace telefab
