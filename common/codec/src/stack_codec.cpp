#include <fmt/format.h>

#include <telefab/codec/stack_codec.hpp>
#include <telefab/geometry/limits.hpp>

#include "layer_coding.hpp"

namespace telefab {
namespace {

using codec::ChunkModels;
using codec::Grid;
using codec::GridLayer;

constexpr std::size_t kClosePayloadBytes = 256U << 10U;  // a chunk of dense layers is closed early
constexpr std::size_t kMaxPayloadBytes = 3U << 20U;      // what the wire takes
constexpr std::uint64_t kMaxVerticesPerChunk = 8'000'000;
constexpr std::uint32_t kMostLayersPerChunk = 64;
constexpr std::size_t kPayloadHead = 2;  // coding, grid steps a pixel

void feed_number(Hasher& hasher, std::uint32_t value) {
  std::array<std::byte, 4> bytes{};
  for (unsigned i = 0; i < 4; ++i) bytes[i] = static_cast<std::byte>(value >> (8 * i));
  hasher.feed(bytes);
}

}  // namespace

Result<void> CodecOptions::validate() const {
  if (coding != Coding::Exact) return fail(ErrorCode::InvalidInput, "unknown contour coding");
  if (grid_per_pitch < 4 || grid_per_pitch > 255)
    return fail(ErrorCode::InvalidInput, "grid steps a pixel must be 4 to 255");
  if (layers_per_chunk < 1 || layers_per_chunk > kMostLayersPerChunk)
    return fail(ErrorCode::InvalidInput, fmt::format("layers a chunk must be 1 to {}", kMostLayersPerChunk));
  return {};
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
  Hasher stack_hasher;
  std::uint32_t next_layer = 0;
  std::uint32_t next_sequence = 0;

  // The chunk under way.
  codec::RangeEncoder coder;
  std::unique_ptr<ChunkModels> models = std::make_unique<ChunkModels>();
  std::vector<Layer> pending;
  std::vector<Layer> given;

  Chunk close() {
    Chunk chunk;
    chunk.sequence = next_sequence++;
    chunk.first_layer = pending.front().index;
    chunk.layer_count = static_cast<std::uint32_t>(pending.size());
    chunk.payload = {static_cast<std::byte>(options.coding), static_cast<std::byte>(options.grid_per_pitch)};
    const std::vector<std::byte> body = coder.finish();
    chunk.payload.insert(chunk.payload.end(), body.begin(), body.end());
    for (const Layer& layer : pending) stack_hasher.feed(canonical_text(layer));
    given = std::move(pending);
    pending.clear();
    coder = {};
    models = std::make_unique<ChunkModels>();
    return chunk;
  }
};

StackEncoder::StackEncoder(std::unique_ptr<State> state) : state_{std::move(state)} {}
StackEncoder::StackEncoder(StackEncoder&&) noexcept = default;
StackEncoder& StackEncoder::operator=(StackEncoder&&) noexcept = default;
StackEncoder::~StackEncoder() = default;

Result<StackEncoder> StackEncoder::start(StackHeader header, const CodecOptions& options) {
  if (auto ok = options.validate(); !ok) return tl::unexpected{ok.error()};
  if (auto ok = header.validate(); !ok) return tl::unexpected{ok.error()};
  auto grid = Grid::over(header, options.grid_per_pitch);
  if (!grid) return tl::unexpected{grid.error()};
  auto state = std::make_unique<State>();
  state->options = options;
  state->grid = *grid;
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

  GridLayer coded;
  coded.certificate = layer.certificate;
  Layer decoded{layer.index, layer.z_mm, {}, {}};
  for (const Contour& contour : layer.contours) {
    auto ring = s.grid.snap(contour);
    if (ring.empty()) {
      coded.certificate.verdict = LayerCertificate::Verdict::Flagged;
      coded.certificate.measured_euler -= contour.is_hole() ? -1 : 1;
      coded.certificate.reason = "a ring smaller than the coding grid was left out";
      coded.certificate.place = contour.vertices()[0];
      continue;
    }
    decoded.contours.push_back(*s.grid.contour(ring));
    coded.rings.push_back(std::move(ring));
  }
  coded.certificate.reason.resize(std::min<std::size_t>(coded.certificate.reason.size(), 4096));
  decoded.certificate = coded.certificate;
  codec::encode_layer(s.coder, *s.models, coded);
  s.pending.push_back(std::move(decoded));
  ++s.next_layer;
  if (s.coder.size() > kMaxPayloadBytes - 16)
    return fail(ErrorCode::TooLarge,
                fmt::format("layer {} does not fit a chunk of {} bytes", layer.index.count(), kMaxPayloadBytes));
  if (s.pending.size() < s.options.layers_per_chunk && s.coder.size() < kClosePayloadBytes)
    return std::optional<Chunk>{};
  return std::optional<Chunk>{s.close()};
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
  return std::optional<Chunk>{s.close()};
}

std::span<const Layer> StackEncoder::coded_layers() const { return state_->given; }
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
  if (chunk.payload.size() < kPayloadHead || chunk.payload.size() > kMaxPayloadBytes)
    return broken("the payload's size is impossible");
  CodecOptions options;
  options.coding = static_cast<Coding>(std::to_integer<std::uint32_t>(chunk.payload[0]));
  options.grid_per_pitch = std::to_integer<std::uint32_t>(chunk.payload[1]);
  if (auto ok = options.validate(); !ok) return broken(ok.error().what);
  const auto grid = Grid::over(header_, options.grid_per_pitch);
  if (!grid) return broken(grid.error().what);

  codec::RangeDecoder coder{std::span{chunk.payload}.subspan(kPayloadHead)};
  const auto models = std::make_unique<ChunkModels>();
  std::uint64_t budget = kMaxVerticesPerChunk;
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < chunk.layer_count; ++i) {
    const LayerIndex index{chunk.first_layer.count() + i};
    auto coded = codec::decode_layer(coder, *models, grid->most(), budget);
    if (!coded) return broken(fmt::format("layer {}: {}", index.count(), coded.error().what));
    Layer layer{index, cut_height_mm(index, header_.layer_thickness_mm), {}, std::move(coded->certificate)};
    for (const auto& ring : coded->rings) {
      auto contour = grid->contour(ring);
      if (!contour) return broken(fmt::format("layer {}: {}", index.count(), contour.error().what));
      layer.contours.push_back(std::move(*contour));
    }
    layers.push_back(std::move(layer));
  }
  if (!coder.at_end()) return broken("bytes are left over behind the last layer");
  return layers;
}

}  // namespace telefab
