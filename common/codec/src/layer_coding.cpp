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
enum NoteContext : unsigned {
  kGround,
  kReason,
  kNumber,
  kSize,
  kOtherSize,
  kCount,
  kRuns,
  kEdges,
  kGap,
  kError,
  kKind,
  kSpecks
};
enum Flag : unsigned { kHasPredicted, kHasPlace };
constexpr std::uint32_t kMaxReasonBytes = 4096;
/// Added to the verdict of a layer that tells how many specks were left out: one without has the bytes it always had.
constexpr std::uint32_t kWithSpecks = 4;

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

/// Lengths go as whole steps of a millimetre's part: divided exactly, so that coding again changes nothing.
constexpr double kMicrometre = 1000;
constexpr double kRunLength = 100;
std::uint32_t steps_of(double mm, double per_mm) {
  return static_cast<std::uint32_t>(std::floor(std::clamp(mm, 0.0, kMaxCoordinateMm) * per_mm + 0.5));
}
double length_of(std::uint32_t steps, double per_mm) { return steps / per_mm; }

tl::unexpected<Error> broken(std::string what) { return fail(ErrorCode::ProtocolBroken, std::move(what)); }

void encode_place(RangeEncoder& coder, Point2 place) {
  encode_double(coder, place.x_mm);
  encode_double(coder, place.y_mm);
}

Result<Point2> decode_place(RangeDecoder& coder) {
  const double x = decode_double(coder);
  const Point2 place{x, decode_double(coder)};
  if (!(std::abs(place.x_mm) <= kMaxCoordinateMm && std::abs(place.y_mm) <= kMaxCoordinateMm))
    return broken("a certificate's place is not a coordinate");
  return place;
}

}  // namespace

void encode_certificate(RangeEncoder& coder, ChunkModels& models, const LayerCertificate& c) {
  models.small.encode(coder, static_cast<std::uint32_t>(c.verdict) + (c.specks > 0 ? kWithSpecks : 0), kVerdict);
  if (c.specks > 0) models.note.encode(coder, c.specks, kSpecks);
  models.small.encode(coder, static_cast<std::uint32_t>(c.method), kMethod);
  models.note.encode(coder, static_cast<std::uint32_t>(c.ground), kGround);
  models.small.encode(coder, zigzag(c.measured_euler), kEuler);
  coder.encode(models.flags[kHasPredicted], c.predicted_euler ? 1 : 0);
  if (c.predicted_euler) models.small.encode(coder, zigzag(*c.predicted_euler - c.measured_euler), kPredicted);
  if (!c.doubt) return;  // the verdict says whether there is one
  const Doubt& d = *c.doubt;
  models.note.encode(coder, static_cast<std::uint32_t>(d.reason), kReason);
  models.note.encode(coder, d.number, kNumber);
  models.note.encode(coder, steps_of(d.size_mm, kMicrometre), kSize);
  models.note.encode(coder, steps_of(d.other_mm, kMicrometre), kOtherSize);
  for (const int count : {d.found.outers, d.found.holes, d.other.outers, d.other.holes})
    models.note.encode(coder, zigzag(count), kCount);
  coder.encode(models.flags[kHasPlace], d.place ? 1 : 0);
  if (d.place) encode_place(coder, *d.place);
}

namespace {

Result<Doubt> decode_doubt(RangeDecoder& coder, ChunkModels& models) {
  Doubt d;
  const std::uint32_t reason = models.note.decode(coder, kReason);
  if (reason < 1 || reason > static_cast<std::uint32_t>(kLastDoubtReason))
    return broken("a certificate with an unknown reason");
  d.reason = static_cast<DoubtReason>(reason);
  d.number = models.note.decode(coder, kNumber);
  d.size_mm = length_of(models.note.decode(coder, kSize), kMicrometre);
  d.other_mm = length_of(models.note.decode(coder, kOtherSize), kMicrometre);
  if (d.size_mm > kMaxCoordinateMm || d.other_mm > kMaxCoordinateMm)
    return broken("a certificate's reason has an impossible length");
  for (int* count : {&d.found.outers, &d.found.holes, &d.other.outers, &d.other.holes})
    *count = unzigzag(models.note.decode(coder, kCount));
  if (coder.decode(models.flags[kHasPlace])) {
    const auto place = decode_place(coder);
    if (!place) return tl::unexpected{place.error()};
    d.place = *place;
  }
  return d;
}

/// How the reason began that earlier releases gave a layer without some of its contours.
constexpr std::string_view kLeftOutInWords = "open contour, left out";

Result<std::optional<Doubt>> decode_words(RangeDecoder& coder, ChunkModels& models, bool flagged) {
  Doubt d{.reason = DoubtReason::EarlierRelease};
  if (coder.decode(models.flags[kHasPlace])) {
    const auto place = decode_place(coder);
    if (!place) return tl::unexpected{place.error()};
    d.place = *place;
  }
  const std::uint32_t length = models.small.decode(coder, kTextLength);
  if (length > kMaxReasonBytes) return broken("a certificate's reason is too long");
  std::string text;
  for (std::uint32_t i = 0; i < length; ++i) text += static_cast<char>(models.text.decode(coder, 0) & 0xFFU);
  if (!flagged) return std::nullopt;
  if (text.starts_with(kLeftOutInWords)) d.reason = DoubtReason::ContoursLeftOut;
  return d;
}

}  // namespace

Result<LayerCertificate> decode_certificate(RangeDecoder& coder, ChunkModels& models, CertificateForm form) {
  LayerCertificate c;
  const bool words = form == CertificateForm::InWords;
  std::uint32_t verdict = models.small.decode(coder, kVerdict);
  if (!words && verdict > kWithSpecks) {
    verdict -= kWithSpecks;
    c.specks = models.note.decode(coder, kSpecks);
    if (c.specks < 1 || c.specks > kMaxRingsPerLayer)
      return broken("a certificate with an impossible number of specks");
  }
  const std::uint32_t method = models.small.decode(coder, kMethod);
  if (verdict < 1 || verdict > (words ? 3U : 4U) || method < 1 || method > 3)
    return broken("a certificate with an unknown verdict or method");
  c.verdict = static_cast<LayerCertificate::Verdict>(verdict);
  c.method = static_cast<LayerCertificate::Method>(method);
  if (!words) {
    const std::uint32_t ground = models.note.decode(coder, kGround);
    if (ground < 1 || ground > static_cast<std::uint32_t>(LayerCertificate::Ground::WindingTest))
      return broken("a certificate with an unknown ground");
    c.ground = static_cast<LayerCertificate::Ground>(ground);
  }
  c.measured_euler = unzigzag(models.small.decode(coder, kEuler));
  if (coder.decode(models.flags[kHasPredicted])) {
    const std::int64_t predicted = std::int64_t{c.measured_euler} + unzigzag(models.small.decode(coder, kPredicted));
    if (predicted != static_cast<std::int32_t>(predicted))
      return broken("a certificate's Euler number is out of range");
    c.predicted_euler = static_cast<std::int32_t>(predicted);
  }
  const bool flagged = c.verdict == LayerCertificate::Verdict::Doubtful;
  if (words) {
    auto doubt = decode_words(coder, models, flagged);
    if (!doubt) return tl::unexpected{doubt.error()};
    c.doubt = *doubt;
  } else if (flagged) {
    auto doubt = decode_doubt(coder, models);
    if (!doubt) return tl::unexpected{doubt.error()};
    c.doubt = *doubt;
  }
  return c;
}

LayerCertificate as_coded(LayerCertificate certificate) {
  if (auto& d = certificate.doubt) {
    d->size_mm = length_of(steps_of(d->size_mm, kMicrometre), kMicrometre);
    d->other_mm = length_of(steps_of(d->other_mm, kMicrometre), kMicrometre);
  }
  return certificate;
}

SurfaceRun as_coded(SurfaceRun run) {
  run.gap_mm = length_of(steps_of(run.gap_mm, kRunLength), kRunLength);
  run.error_mm = length_of(steps_of(run.error_mm, kRunLength), kRunLength);
  return run;
}

void encode_runs(RangeEncoder& coder, ChunkModels& models, std::span<const Contour> rings) {
  const bool some = std::any_of(rings.begin(), rings.end(), [](const Contour& c) { return !c.runs().empty(); });
  coder.encode(models.has_runs[models.had_runs ? 1 : 0], some ? 1 : 0);
  models.had_runs = some;
  if (!some) return;
  for (const Contour& ring : rings) {
    const auto runs = ring.runs();
    models.note.encode(coder, static_cast<std::uint32_t>(runs.size()), kRuns);
    unsigned before = 0;
    for (std::size_t i = 0; i < runs.size(); ++i) {
      const auto kind = static_cast<std::uint32_t>(runs[i].kind);
      models.note.encode(coder, kind, kKind + before);
      before = kind;
      // The last one takes what is left.
      if (i + 1 < runs.size()) models.note.encode(coder, runs[i].edges - 1, kEdges);
      if (runs[i].kind == SurfaceClass::Measured) continue;
      models.note.encode(coder, steps_of(runs[i].gap_mm, kRunLength), kGap);
      models.note.encode(coder, steps_of(runs[i].error_mm, kRunLength), kError);
    }
  }
}

namespace {

Result<Contour> decode_ring_runs(RangeDecoder& coder, ChunkModels& models, const Contour& ring) {
  const std::size_t edges = ring.vertices().size();
  const std::uint32_t count = models.note.decode(coder, kRuns);
  if (count > edges) return broken("more runs than a ring has edges");
  std::vector<SurfaceRun> runs;
  std::uint64_t used = 0;
  unsigned before = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    if (i % 256 == 0 && coder.overrun()) return broken("the chunk ends in the middle of a layer");
    const std::uint32_t kind = models.note.decode(coder, kKind + before);
    if (kind < 1 || kind > 3 || kind == before)
      return broken("a run of a ring has no class, or that of the run before");
    before = kind;
    SurfaceRun run{.kind = static_cast<SurfaceClass>(kind)};
    const std::uint64_t length = i + 1 < count ? std::uint64_t{models.note.decode(coder, kEdges)} + 1 : edges - used;
    if (length == 0 || used + length > edges) return broken("runs do not fit their ring");
    run.edges = static_cast<std::uint32_t>(length);
    used += length;
    if (run.kind != SurfaceClass::Measured) {
      run.gap_mm = length_of(models.note.decode(coder, kGap), kRunLength);
      run.error_mm = length_of(models.note.decode(coder, kError), kRunLength);
    }
    runs.push_back(run);
  }
  auto made = ring.with_runs(runs);
  if (!made) return broken(made.error().what);
  return made;
}

}  // namespace

Result<std::vector<Contour>> decode_runs(RangeDecoder& coder, ChunkModels& models, std::vector<Contour> rings) {
  const bool some = coder.decode(models.has_runs[models.had_runs ? 1 : 0]) != 0;
  models.had_runs = some;
  if (!some) return rings;
  for (Contour& ring : rings) {
    auto made = decode_ring_runs(coder, models, ring);
    if (!made) return tl::unexpected{made.error()};
    ring = std::move(*made);
  }
  return rings;
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

Result<GridLayer> decode_layer(RangeDecoder& coder, ChunkModels& models, CertificateForm form, GridPoint most,
                               std::uint64_t& budget) {
  GridLayer layer;
  auto certificate = decode_certificate(coder, models, form);
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
