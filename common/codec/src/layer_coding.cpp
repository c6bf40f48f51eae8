// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_coding.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <telefab/geometry/limits.hpp>
#include <tuple>
#include <utility>

namespace telefab::codec {
namespace {

enum SmallContext : unsigned { kRingCount, kVertexCount, kVerdict, kMethod, kEuler, kPredicted, kTextLength };
enum Flag : unsigned { kHasPredicted, kHasPlace };
constexpr std::uint32_t kMaxReasonBytes = 4096;

constexpr std::int32_t kFar = 1 << 29;  ///< no lattice is wider: residuals fit 31 bits, turned or not

/// Of a turn so much is expected again: a part of it is the rounding of three vertices.
constexpr double kSteady = 0.85;

std::int64_t nearest(double v) { return static_cast<std::int64_t>(std::floor(v + 0.5)); }

/// A residual along an edge and to its left. Turned by three shears with rounding, so every lattice point comes back.
class Heading {
 public:
  Heading() = default;
  Heading(GridPoint from, GridPoint to) {
    const double dx = static_cast<double>(to.x) - from.x;
    const double dy = static_cast<double>(to.y) - from.y;
    length_ = std::sqrt(dx * dx + dy * dy);
    // By at most a quarter turn: shears of a tangent of half the angle stay below 1.
    back_ = dx < 0;
    const double cosine = std::abs(dx) / length_;
    sine_ = (back_ ? -dy : dy) / length_;
    tangent_ = sine_ / (1 + cosine);
    dx_ = dx;
    dy_ = dy;
  }
  [[nodiscard]] double length() const { return length_; }

  struct Local {
    std::int64_t along;
    std::int64_t left;
  };
  [[nodiscard]] Local local(std::int64_t x, std::int64_t y) const {
    if (back_) x = -x, y = -y;
    x += nearest(tangent_ * static_cast<double>(y));
    y -= nearest(sine_ * static_cast<double>(x));
    x += nearest(tangent_ * static_cast<double>(y));
    return {x, y};
  }
  [[nodiscard]] std::pair<std::int64_t, std::int64_t> global(Local p) const {
    auto [x, y] = p;
    x -= nearest(tangent_ * static_cast<double>(y));
    y += nearest(sine_ * static_cast<double>(x));
    x -= nearest(tangent_ * static_cast<double>(y));
    if (back_) x = -x, y = -y;
    return {x, y};
  }
  /// How far left of this edge the next vertex lies, `along` from where it would end: an arc turns as from `before` to
  /// this edge. The slicer's chords follow curvature, so their turns change slowly.
  [[nodiscard]] std::int64_t bend(const Heading& before, std::int64_t along) const {
    if (before.length_ == 0 || before.dx_ * dx_ + before.dy_ * dy_ <= 0) return 0;
    const double turn = (before.dx_ * dy_ - before.dy_ * dx_) / (before.length_ * length_);
    const double next = length_ + static_cast<double>(along);
    if (!(next > 0)) return 0;
    const double left = kSteady * turn * next * (length_ + next) / (before.length_ + length_);
    return nearest(std::clamp(left, -1.0 * kFar, 1.0 * kFar));
  }

 private:
  double dx_ = 0, dy_ = 0, length_ = 0, sine_ = 0, tangent_ = 0;
  bool back_ = false;
};

/// What is known of a ring while its vertices are told one after the other.
class RingContext {
 public:
  /// `guess`: where its first vertex is expected.
  explicit RingContext(GridPoint guess) : last_{guess} {}
  /// Where the next vertex is expected: straight on.
  [[nodiscard]] GridPoint guess() const {
    const auto go = [](std::int64_t a, std::int64_t b) {
      return static_cast<std::int32_t>(std::clamp<std::int64_t>(2 * b - a, 0, kFar));
    };
    return count_ < 2 ? last_ : GridPoint{go(before_.x, last_.x), go(before_.y, last_.y)};
  }
  void add(GridPoint p) {
    if (count_ > 0) {
      turned_ = heading_;
      heading_ = Heading{last_, p};
      if (count_ == 1) turned_ = Heading{};
      before_ = last_;
    }
    last_ = p;
    if (++count_ <= 2) along_length_ = left_length_ = 8;
  }
  [[nodiscard]] bool has_heading() const { return count_ >= 2; }
  [[nodiscard]] const Heading& heading() const { return heading_; }
  [[nodiscard]] std::int64_t bend(std::int64_t along) const { return heading_.bend(turned_, along); }

  [[nodiscard]] unsigned along_context() const {
    return has_heading() ? 8 * std::min(along_length_, 15U) + std::min(left_length_ / 2, 7U) : kFirstVertices;
  }
  [[nodiscard]] unsigned left_context(unsigned along_now) const {
    return has_heading() ? kLeft + 8 * std::min(left_length_, 15U) + std::min(along_now / 2, 7U) : kFirstVertices + 1;
  }
  void remember(unsigned along_length, unsigned left_length) {
    along_length_ = along_length;
    left_length_ = left_length;
  }

 private:
  static constexpr unsigned kLeft = 128;
  static constexpr unsigned kFirstVertices = 256;
  std::size_t count_ = 0;
  GridPoint before_, last_;
  Heading turned_, heading_;
  unsigned along_length_ = 8, left_length_ = 8;
};

void encode_vertex(RangeEncoder& coder, ChunkModels& models, RingContext& near, GridPoint p) {
  const GridPoint guess = near.guess();
  std::int64_t x = std::int64_t{p.x} - guess.x;
  std::int64_t y = std::int64_t{p.y} - guess.y;
  if (near.has_heading()) {
    const auto [along, left] = near.heading().local(x, y);
    x = along;
    y = left - near.bend(along);
  }
  const std::uint32_t first = zigzag(static_cast<std::int32_t>(x));
  const std::uint32_t second = zigzag(static_cast<std::int32_t>(y));
  models.residual.encode(coder, first, near.along_context());
  models.residual.encode(coder, second, near.left_context(bit_length(first)));
  near.remember(bit_length(first), bit_length(second));
  near.add(p);
}

/// Nothing where the vertex lies outside the lattice.
std::optional<GridPoint> decode_vertex(RangeDecoder& coder, ChunkModels& models, RingContext& near, GridPoint most) {
  const GridPoint guess = near.guess();
  const std::uint32_t first = models.residual.decode(coder, near.along_context());
  const std::uint32_t second = models.residual.decode(coder, near.left_context(bit_length(first)));
  near.remember(bit_length(first), bit_length(second));
  std::int64_t x = unzigzag(first);
  std::int64_t y = unzigzag(second);
  if (near.has_heading()) {
    y += near.bend(x);
    std::tie(x, y) = near.heading().global({x, y});
  }
  x += guess.x;
  y += guess.y;
  if (x < 0 || x > most.x || y < 0 || y > most.y) return std::nullopt;
  return GridPoint{static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)};
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
  models.small.encode(coder, static_cast<std::uint32_t>(ring.size() - 3), kVertexCount);
  RingContext near{guess};
  for (const GridPoint p : ring) encode_vertex(coder, models, near, p);
}

Result<std::vector<GridPoint>> decode_ring(RangeDecoder& coder, ChunkModels& models, GridPoint guess, GridPoint most,
                                           std::uint64_t& budget) {
  const std::uint64_t size = std::uint64_t{models.small.decode(coder, kVertexCount)} + 3;
  if (size > kMaxVerticesPerLayer || size > budget) return broken("more vertices than a layer or chunk may have");
  budget -= size;
  std::vector<GridPoint> ring;
  RingContext near{guess};
  for (std::uint64_t i = 0; i < size; ++i) {
    // Checked now and then: past the end the decoder only reads zeros.
    if (i % 256 == 0 && coder.overrun()) return broken("the chunk ends in the middle of a ring");
    const auto p = decode_vertex(coder, models, near, most);
    if (!p) return broken("a vertex lies outside the stated bounds");
    if (!ring.empty() && ring.back() == *p) return broken("two neighbouring vertices are equal");
    near.add(*p);
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
