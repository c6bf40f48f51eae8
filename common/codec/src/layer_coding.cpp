#include "layer_coding.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <telefab/geometry/limits.hpp>

namespace telefab::codec {
namespace {

enum SmallContext : unsigned { kRingCount, kVertexCount, kVerdict, kMethod, kEuler, kPredicted, kTextLength };
enum Flag : unsigned { kHasPredicted, kHasPlace };
constexpr std::uint32_t kMaxReasonBytes = 4096;

/// Straight on from the two vertices before, inside the lattice so that a residual fits 31 bits.
GridPoint extrapolate(GridPoint before, GridPoint last, GridPoint most) {
  const auto go = [](std::int64_t a, std::int64_t b, std::int32_t limit) {
    return static_cast<std::int32_t>(std::clamp<std::int64_t>(2 * b - a, 0, limit));
  };
  return {go(before.x, last.x, most.x), go(before.y, last.y, most.y)};
}

/// Sizes of the residuals so far, from which the next one's context is taken.
struct Neighbourhood {
  unsigned x_length = 8;
  unsigned y_length = 8;

  [[nodiscard]] unsigned x_context() const { return std::min((x_length + y_length + 1) / 2, 15U); }
  [[nodiscard]] unsigned y_context(unsigned x_now) const { return 16 + std::min((2 * x_now + y_length + 1) / 3, 15U); }
};

void encode_residual(RangeEncoder& coder, ChunkModels& models, Neighbourhood& near, GridPoint p, GridPoint guess) {
  const std::uint32_t x = zigzag(p.x - guess.x);
  const std::uint32_t y = zigzag(p.y - guess.y);
  models.residual.encode(coder, x, near.x_context());
  models.residual.encode(coder, y, near.y_context(bit_length(x)));
  near = {bit_length(x), bit_length(y)};
}

/// Nothing where the vertex lies outside the lattice.
std::optional<GridPoint> decode_residual(RangeDecoder& coder, ChunkModels& models, Neighbourhood& near, GridPoint guess,
                                         GridPoint most) {
  const std::uint32_t x = models.residual.decode(coder, near.x_context());
  const std::uint32_t y = models.residual.decode(coder, near.y_context(bit_length(x)));
  near = {bit_length(x), bit_length(y)};
  const std::int64_t px = std::int64_t{guess.x} + unzigzag(x);
  const std::int64_t py = std::int64_t{guess.y} + unzigzag(y);
  if (px < 0 || px > most.x || py < 0 || py > most.y) return std::nullopt;
  return GridPoint{static_cast<std::int32_t>(px), static_cast<std::int32_t>(py)};
}

GridPoint first_guess(const ChunkModels& models, std::size_t ring, const std::vector<GridPoint>& firsts) {
  if (ring < models.firsts.size()) return models.firsts[ring];
  return firsts.empty() ? GridPoint{} : firsts.back();
}

void encode_double(RangeEncoder& coder, double value) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  coder.encode_direct(static_cast<std::uint32_t>(bits >> 32U), 32);
  coder.encode_direct(static_cast<std::uint32_t>(bits), 32);
}

double decode_double(RangeDecoder& coder) {
  const std::uint64_t high = coder.decode_direct(32);
  return std::bit_cast<double>((high << 32U) | coder.decode_direct(32));
}

tl::unexpected<Error> broken(std::string what) { return fail(ErrorCode::ProtocolBroken, std::move(what)); }

}  // namespace

void encode_certificate(RangeEncoder& coder, ChunkModels& models, const LayerCertificate& c) {
  models.small.encode(coder, static_cast<std::uint32_t>(c.verdict), kVerdict);
  models.small.encode(coder, static_cast<std::uint32_t>(c.method), kMethod);
  models.small.encode(coder, zigzag(c.measured_euler), kEuler);
  coder.encode(models.flags[kHasPredicted], c.predicted_euler ? 1 : 0);
  if (c.predicted_euler) models.small.encode(coder, zigzag(*c.predicted_euler - c.measured_euler), kPredicted);
  coder.encode(models.flags[kHasPlace], c.place ? 1 : 0);
  if (c.place) {
    encode_double(coder, c.place->x_mm);
    encode_double(coder, c.place->y_mm);
  }
  const std::size_t length = std::min<std::size_t>(c.reason.size(), kMaxReasonBytes);
  models.small.encode(coder, static_cast<std::uint32_t>(length), kTextLength);
  for (std::size_t i = 0; i < length; ++i) models.text.encode(coder, static_cast<unsigned char>(c.reason[i]), 0);
}

Result<LayerCertificate> decode_certificate(RangeDecoder& coder, ChunkModels& models) {
  LayerCertificate c;
  const std::uint32_t verdict = models.small.decode(coder, kVerdict);
  const std::uint32_t method = models.small.decode(coder, kMethod);
  if (verdict < 1 || verdict > 3 || method < 1 || method > 3)
    return broken("a certificate with an unknown verdict or method");
  c.verdict = static_cast<LayerCertificate::Verdict>(verdict);
  c.method = static_cast<LayerCertificate::Method>(method);
  c.measured_euler = unzigzag(models.small.decode(coder, kEuler));
  if (coder.decode(models.flags[kHasPredicted])) {
    const std::int64_t predicted = std::int64_t{c.measured_euler} + unzigzag(models.small.decode(coder, kPredicted));
    if (predicted != static_cast<std::int32_t>(predicted))
      return broken("a certificate's Euler number is out of range");
    c.predicted_euler = static_cast<std::int32_t>(predicted);
  }
  if (coder.decode(models.flags[kHasPlace])) {
    const double x = decode_double(coder);
    c.place = Point2{x, decode_double(coder)};
    if (!(std::abs(c.place->x_mm) <= kMaxCoordinateMm && std::abs(c.place->y_mm) <= kMaxCoordinateMm))
      return broken("a certificate's place is not a coordinate");
  }
  const std::uint32_t length = models.small.decode(coder, kTextLength);
  if (length > kMaxReasonBytes) return broken("a certificate's reason is too long");
  for (std::uint32_t i = 0; i < length; ++i) c.reason += static_cast<char>(models.text.decode(coder, 0) & 0xFFU);
  return c;
}

void encode_ring(RangeEncoder& coder, ChunkModels& models, const std::vector<GridPoint>& ring, GridPoint guess) {
  constexpr std::int32_t far = 1 << 29;  // the clamp's limits are not needed to encode: vertices lie inside
  models.small.encode(coder, static_cast<std::uint32_t>(ring.size() - 3), kVertexCount);
  Neighbourhood near;
  encode_residual(coder, models, near, ring[0], guess);
  near = {};
  encode_residual(coder, models, near, ring[1], ring[0]);
  for (std::size_t i = 2; i < ring.size(); ++i)
    encode_residual(coder, models, near, ring[i], extrapolate(ring[i - 2], ring[i - 1], {far, far}));
}

Result<std::vector<GridPoint>> decode_ring(RangeDecoder& coder, ChunkModels& models, GridPoint guess, GridPoint most,
                                           std::uint64_t& budget) {
  constexpr std::int32_t far = 1 << 29;
  const std::uint64_t size = std::uint64_t{models.small.decode(coder, kVertexCount)} + 3;
  if (size > kMaxVerticesPerLayer || size > budget) return broken("more vertices than a layer or chunk may have");
  budget -= size;
  std::vector<GridPoint> ring;
  Neighbourhood near;
  for (std::uint64_t i = 0; i < size; ++i) {
    // Checked now and then: past the end the decoder only reads zeros.
    if (i % 256 == 0 && coder.overrun()) return broken("the chunk ends in the middle of a ring");
    const auto p = decode_residual(coder, models, near, guess, most);
    if (!p) return broken("a vertex lies outside the stated bounds");
    if (!ring.empty() && ring.back() == *p) return broken("two neighbouring vertices are equal");
    if (i == 0) near = {};
    guess = i == 0 ? *p : extrapolate(ring.back(), *p, {far, far});
    ring.push_back(*p);
  }
  return ring;
}

void encode_layer(RangeEncoder& coder, ChunkModels& models, const GridLayer& layer) {
  encode_certificate(coder, models, layer.certificate);
  models.small.encode(coder, static_cast<std::uint32_t>(layer.rings.size()), kRingCount);
  std::vector<GridPoint> firsts;
  for (const auto& ring : layer.rings) {
    encode_ring(coder, models, ring, first_guess(models, firsts.size(), firsts));
    firsts.push_back(ring[0]);
  }
  models.firsts = std::move(firsts);
}

Result<GridLayer> decode_layer(RangeDecoder& coder, ChunkModels& models, GridPoint most, std::uint64_t& budget) {
  GridLayer layer;
  auto certificate = decode_certificate(coder, models);
  if (!certificate) return tl::unexpected{certificate.error()};
  layer.certificate = std::move(*certificate);
  const std::uint32_t rings = models.small.decode(coder, kRingCount);
  if (rings > kMaxRingsPerLayer)
    return broken(fmt::format("{} rings, at most {} are allowed", rings, kMaxRingsPerLayer));
  std::vector<GridPoint> firsts;
  std::uint64_t vertices = 0;
  for (std::uint32_t r = 0; r < rings; ++r) {
    auto ring = decode_ring(coder, models, first_guess(models, firsts.size(), firsts), most, budget);
    if (!ring) return tl::unexpected{ring.error()};
    vertices += ring->size();
    if (vertices > kMaxVerticesPerLayer) return broken("more vertices than a layer or chunk may have");
    firsts.push_back(ring->front());
    layer.rings.push_back(std::move(*ring));
  }
  if (coder.overrun()) return broken("the chunk ends in the middle of a layer");
  models.firsts = std::move(firsts);
  return layer;
}

}  // namespace telefab::codec
