// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/test/random_stack.hpp>

namespace telefab {
namespace {

using test::random_stack;
using testing::HasSubstr;

struct Coded {
  std::vector<Chunk> chunks;
  std::vector<Layer> layers;  ///< as the encoder says decoders will see them
  Digest stack;
};

constexpr CodecOptions kExact{.coding = Coding::Exact, .layers_per_chunk = 32};
constexpr CodecOptions kCurve{.coding = Coding::Curve, .layers_per_chunk = 32, .chord_error_pitch = 0.025};

Coded encode(const LayerStack& stack, const CodecOptions& options = kCurve) {
  StackEncoder encoder = StackEncoder::start(stack.header(), options).value();
  Coded coded;
  const auto keep = [&](const std::optional<Chunk>& chunk) {
    if (!chunk) return;
    coded.chunks.push_back(*chunk);
    coded.layers.insert(coded.layers.end(), encoder.coded_layers().begin(), encoder.coded_layers().end());
  };
  for (const Layer& layer : stack.layers()) keep(encoder.add(layer).value());
  keep(encoder.finish().value());
  coded.stack = encoder.stack_digest();
  return coded;
}

class StackCodecProperty : public testing::TestWithParam<std::uint64_t> {};

CodecOptions either(std::uint64_t seed) { return seed % 2 ? kExact : kCurve; }

TEST_P(StackCodecProperty, DecodesWhatTheEncoderSaidEachChunkAloneAndInAnyOrder) {
  const LayerStack stack = random_stack(GetParam(), 75);
  const Coded coded = encode(stack, either(GetParam()));
  ASSERT_EQ(coded.chunks.size(), 3U);
  const StackDecoder decoder = StackDecoder::start(stack.header()).value();
  std::vector<Layer> layers(75);
  for (const std::size_t c : {std::size_t{2}, std::size_t{0}, std::size_t{1}}) {
    auto decoded = decoder.decode(coded.chunks[c]);
    ASSERT_TRUE(decoded) << decoded.error().what;
    for (Layer& layer : *decoded) layers[layer.index.count()] = std::move(layer);
  }
  EXPECT_EQ(layers, coded.layers);
  EXPECT_EQ(digest_of(LayerStack::from_layers(stack.header(), layers).value()), coded.stack);
}

TEST_P(StackCodecProperty, KeepsWhatContoursRestOn) {
  const LayerStack stack = random_stack(GetParam(), 12);
  const Coded coded = encode(stack, either(GetParam()));
  int calls = 0;
  for (std::size_t i = 0; i < stack.layers().size(); ++i) {
    const SurfaceShares given = surface_shares(stack.layers()[i]);
    const SurfaceShares kept = surface_shares(coded.layers[i]);
    if (given.completed_mm + given.doubtful_mm == 0) {
      EXPECT_EQ(kept.completed_mm + kept.doubtful_mm, 0) << i;
      continue;
    }
    ++calls;
    // What is not measured never shrinks by more than the ends of its edges; chords that reach beyond it add to it.
    EXPECT_GE(kept.completed_mm, 0.97 * given.completed_mm) << i;
    EXPECT_GE(kept.doubtful_mm, 0.97 * given.doubtful_mm) << i;
    EXPECT_LE(kept.completed_mm + kept.doubtful_mm, given.completed_mm + given.doubtful_mm + 12) << i;
    EXPECT_NEAR(kept.largest_gap_mm, given.largest_gap_mm, 0.005) << i;
    EXPECT_NEAR(kept.largest_error_mm, given.largest_error_mm, 0.005) << i;
    EXPECT_EQ(coded.layers[i].certificate.verdict, stack.layers()[i].certificate.verdict) << i;
  }
  EXPECT_EQ(calls, 2);
}

TEST_P(StackCodecProperty, MovesNoVertexFartherThanHalfAGridDiagonal) {
  const LayerStack stack = random_stack(GetParam(), 8);
  const Coded coded = encode(stack, kExact);
  const double bound_mm = stack.header().pixel_pitch_mm / 16 * std::sqrt(0.5) + 1e-9;
  for (std::size_t i = 0; i < coded.layers.size(); ++i) {
    ASSERT_EQ(coded.layers[i].contours.size(), stack.layers()[i].contours.size());
    EXPECT_EQ(coded.layers[i].certificate, stack.layers()[i].certificate);
    for (std::size_t c = 0; c < coded.layers[i].contours.size(); ++c) {
      const auto a = stack.layers()[i].contours[c].vertices();
      const auto b = coded.layers[i].contours[c].vertices();
      ASSERT_EQ(a.size(), b.size());
      for (std::size_t k = 0; k < a.size(); ++k)
        EXPECT_LE(std::hypot(a[k].x_mm - b[k].x_mm, a[k].y_mm - b[k].y_mm), bound_mm);
    }
  }
}

/// Largest distance of a's edges (ends and three places between) to b's.
double distance_mm(const Layer& a, const Layer& b) {
  const auto to_edge = [](Point2 p, Point2 e, Point2 f) {
    const double dx = f.x_mm - e.x_mm;
    const double dy = f.y_mm - e.y_mm;
    const double along = std::clamp(((p.x_mm - e.x_mm) * dx + (p.y_mm - e.y_mm) * dy) / (dx * dx + dy * dy), 0.0, 1.0);
    return std::hypot(p.x_mm - e.x_mm - along * dx, p.y_mm - e.y_mm - along * dy);
  };
  double worst = 0;
  for (const Contour& ring : a.contours)
    for (std::size_t i = 0; i < ring.vertices().size(); ++i)
      for (int quarter = 0; quarter < 4; ++quarter) {
        const Point2 u = ring.vertices()[i];
        const Point2 v = ring.vertices()[(i + 1) % ring.vertices().size()];
        const Point2 p{u.x_mm + (v.x_mm - u.x_mm) * quarter / 4, u.y_mm + (v.y_mm - u.y_mm) * quarter / 4};
        double nearest = 1e9;
        for (const Contour& other : b.contours)
          for (std::size_t k = 0; k < other.vertices().size(); ++k)
            nearest =
                std::min(nearest, to_edge(p, other.vertices()[k], other.vertices()[(k + 1) % other.vertices().size()]));
        worst = std::max(worst, nearest);
      }
  return worst;
}

TEST_P(StackCodecProperty, KeepsEveryCurveWithinTheStatedErrorBothWays) {
  const LayerStack stack = random_stack(GetParam(), 7);
  for (const double chord : {0.025, 0.1}) {
    CodecOptions options = kCurve;
    options.chord_error_pitch = chord;
    options.total_error_pitch = chord + 0.04;
    const Coded coded = encode(stack, options);
    ASSERT_EQ(coded.layers.size(), 7U);
    const double bound_mm = (options.total_error_pitch - chord) * stack.header().pixel_pitch_mm + 1e-9;
    for (std::size_t i = 0; i < coded.layers.size(); ++i) {
      EXPECT_EQ(coded.layers[i].contours.size(), stack.layers()[i].contours.size());
      EXPECT_EQ(coded.layers[i].certificate, stack.layers()[i].certificate);
      EXPECT_LE(distance_mm(coded.layers[i], stack.layers()[i]), bound_mm) << i;
      EXPECT_LE(distance_mm(stack.layers()[i], coded.layers[i]), bound_mm) << i;
    }
  }
}

TEST_P(StackCodecProperty, WritesTheSameCurveBytesTwice) {
  const LayerStack stack = random_stack(GetParam(), 8);
  EXPECT_EQ(encode(stack).chunks, encode(stack).chunks);
}

TEST_P(StackCodecProperty, CodesItsOwnExactResultToTheSameBytes) {
  const LayerStack stack = random_stack(GetParam(), 40);
  const Coded once = encode(stack, kExact);
  const Coded twice = encode(LayerStack::from_layers(stack.header(), once.layers).value(), kExact);
  EXPECT_EQ(once.chunks, twice.chunks);
}

TEST_P(StackCodecProperty, SurvivesDamageWithoutACrashAndWithinItsBounds) {
  const LayerStack stack = random_stack(GetParam(), 8);
  const Coded coded = encode(stack, either(GetParam()));
  const StackDecoder decoder = StackDecoder::start(stack.header()).value();
  std::mt19937_64 rng{GetParam()};
  int refused = 0;
  for (int i = 0; i < 200; ++i) {
    Chunk chunk = coded.chunks[0];
    for (auto flips = 1 + rng() % 3; flips > 0; --flips)
      chunk.payload[rng() % chunk.payload.size()] ^= static_cast<std::byte>(1U << (rng() % 8));
    if (rng() % 4 == 0) chunk.payload.resize(rng() % chunk.payload.size());
    const auto layers = decoder.decode(chunk);
    if (!layers) {
      EXPECT_EQ(layers.error().code, ErrorCode::ProtocolBroken);
      ++refused;
      continue;
    }
    for (const Layer& layer : *layers) EXPECT_TRUE(validate_layer(stack.header(), layer));
  }
  EXPECT_GT(refused, 50);  // what slips through is caught by checksum and digest chain
}
INSTANTIATE_TEST_SUITE_P(Seeds, StackCodecProperty, testing::Range<std::uint64_t>(0, 12));

TEST(StackEncoder, RefusesALayerOutOfOrderAndAMissingEnd) {
  const LayerStack stack = random_stack(1, 3);
  StackEncoder encoder = StackEncoder::start(stack.header(), {}).value();
  EXPECT_FALSE(encoder.add(stack.layers()[1]));
  ASSERT_TRUE(encoder.add(stack.layers()[0]));
  EXPECT_THAT(encoder.finish().error().what, HasSubstr("1 of 3"));
}

TEST(StackEncoder, FlagsALayerWhoseRingIsSmallerThanTheGrid) {
  StackHeader header = random_stack(1, 1).header();
  Layer layer;
  layer.z_mm = cut_height_mm(layer.index, header.layer_thickness_mm);
  layer.contours = {Contour::from_vertices({{10, 10}, {10.001, 10}, {10, 10.001}}).value()};
  layer.certificate = {
      LayerCertificate::Verdict::Measured, LayerCertificate::Method::Grid, LayerCertificate::Ground::Graph, 1, 1, {}};
  StackEncoder encoder = StackEncoder::start(header, kExact).value();
  ASSERT_TRUE(encoder.add(layer));
  ASSERT_TRUE(encoder.finish().value());
  EXPECT_TRUE(encoder.coded_layers()[0].contours.empty());
  EXPECT_EQ(encoder.coded_layers()[0].certificate.verdict, LayerCertificate::Verdict::Doubtful);
  EXPECT_EQ(encoder.coded_layers()[0].certificate.measured_euler, 0);
}

Layer layer_of(std::uint32_t index, std::vector<Contour> contours) {
  Layer layer;
  layer.index = LayerIndex{index};
  layer.z_mm = cut_height_mm(layer.index, 0.15);
  layer.contours = std::move(contours);
  layer.certificate = {
      LayerCertificate::Verdict::Measured, LayerCertificate::Method::Grid, LayerCertificate::Ground::Graph, 1, 1, {}};
  return layer;
}

Contour ring_of(Point2 centre, double radius_x_mm, double radius_y_mm, int vertices) {
  std::vector<Point2> ring;
  for (int k = 0; k < vertices; ++k) {
    const double angle = 2 * std::numbers::pi * k / vertices;
    ring.push_back({centre.x_mm + radius_x_mm * std::cos(angle), centre.y_mm + radius_y_mm * std::sin(angle)});
  }
  return Contour::from_vertices(std::move(ring)).value();
}

TEST(StackEncoder, SpendsFarLessOnACurveThatMovesEvenlyThanOnANewOne) {
  StackHeader header = random_stack(1, 64).header();
  std::vector<Layer> layers;
  for (std::uint32_t i = 0; i < 64; ++i) layers.push_back(layer_of(i, {ring_of({100, 80}, 20 + 0.05 * i, 30, 400)}));
  const auto bytes_of = [&](std::uint32_t layers_per_chunk) {
    CodecOptions options = kCurve;
    options.total_error_pitch = 0.144;
    options.layers_per_chunk = layers_per_chunk;
    std::size_t bytes = 0;
    for (const Chunk& c : encode(LayerStack::from_layers(header, layers).value(), options).chunks)
      bytes += c.payload.size();
    return bytes;
  };
  EXPECT_LT(bytes_of(64), bytes_of(1) / 6);
}

TEST(StackEncoder, FollowsARingThatSplitsAndOneThatIsNew) {
  StackHeader header = random_stack(1, 3).header();
  const std::vector<Layer> layers{
      layer_of(0, {ring_of({60, 80}, 30, 10, 200)}),
      layer_of(1, {ring_of({45, 80}, 14, 9, 120), ring_of({75, 80}, 14, 9, 120)}),
      layer_of(2, {ring_of({45, 80}, 13, 8, 120), ring_of({75, 80}, 13, 8, 120), ring_of({150, 80}, 9, 9, 90)})};
  const Coded coded = encode(LayerStack::from_layers(header, layers).value());
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(coded.layers[i].contours.size(), layers[i].contours.size());
    EXPECT_LE(distance_mm(coded.layers[i], layers[i]), 0.119 * 0.14 + 1e-9);
    EXPECT_LE(distance_mm(layers[i], coded.layers[i]), 0.119 * 0.14 + 1e-9);
  }
}

TEST(StackEncoder, FlagsACertifiedLayerWhoseContoursCross) {
  StackHeader header = random_stack(1, 1).header();
  const Layer layer = layer_of(0, {ring_of({60, 80}, 20, 20, 100), ring_of({80, 80}, 20, 20, 100)});
  for (const CodecOptions& options : {kExact, kCurve}) {
    const Coded coded = encode(LayerStack::from_layers(header, {layer}).value(), options);
    EXPECT_EQ(coded.layers[0].certificate.verdict, LayerCertificate::Verdict::Doubtful);
    EXPECT_EQ(coded.layers[0].certificate.doubt->reason, DoubtReason::CrossOnLattice);
  }
}

TEST(StackEncoder, KeepsEmptyLayers) {
  StackHeader header = random_stack(1, 2).header();
  StackEncoder encoder = StackEncoder::start(header, {}).value();
  for (std::uint32_t i = 0; i < 2; ++i) {
    Layer layer;
    layer.index = LayerIndex{i};
    layer.z_mm = cut_height_mm(layer.index, header.layer_thickness_mm);
    ASSERT_TRUE(encoder.add(layer));
  }
  const auto chunk = encoder.finish().value();
  ASSERT_TRUE(chunk);
  EXPECT_EQ(StackDecoder::start(header)->decode(*chunk)->size(), 2U);
}

TEST(StackDecoder, RefusesCodingsOfEarlierReleasesByNumber) {
  const LayerStack stack = random_stack(1, 4);
  const StackDecoder decoder = StackDecoder::start(stack.header()).value();
  for (const int earlier : {1, 2, 3, 4}) {
    Chunk chunk = encode(stack).chunks[0];
    chunk.payload[0] = static_cast<std::byte>(earlier);
    const auto refused = decoder.decode(chunk);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::ProtocolBroken);
    EXPECT_THAT(refused.error().what,
                HasSubstr("coding " + std::to_string(earlier) + " is that of an earlier release"));
  }
}

TEST(StackDecoder, RefusesLayersThatTheStackDoesNotHave) {
  const LayerStack stack = random_stack(2, 4);
  Chunk chunk = encode(stack).chunks[0];
  const StackDecoder decoder = StackDecoder::start(stack.header()).value();
  chunk.first_layer = LayerIndex{0xFFFF'FFFF};
  EXPECT_FALSE(decoder.decode(chunk));
  chunk.first_layer = LayerIndex{1};
  EXPECT_FALSE(decoder.decode(chunk));
}

TEST(ChunkChain, DependsOnHeaderOrderNumbersAndEveryByte) {
  const LayerStack stack = random_stack(3, 70);
  const Coded coded = encode(stack);
  const auto chain_of = [&](const StackHeader& header, const std::vector<Chunk>& chunks) {
    ChunkChain chain{header};
    for (const Chunk& chunk : chunks) chain.add(chunk);
    return chain.value();
  };
  const Digest whole = chain_of(stack.header(), coded.chunks);
  EXPECT_EQ(chain_of(stack.header(), coded.chunks), whole);
  auto swapped = coded.chunks;
  std::swap(swapped[0], swapped[1]);
  EXPECT_NE(chain_of(stack.header(), swapped), whole);
  auto damaged = coded.chunks;
  damaged[1].payload.back() ^= std::byte{1};
  EXPECT_NE(chain_of(stack.header(), damaged), whole);
  auto repeated = coded.chunks;
  repeated.push_back(repeated.back());
  EXPECT_NE(chain_of(stack.header(), repeated), whole);
  StackHeader other = stack.header();
  other.machine = "machine-b";
  EXPECT_NE(chain_of(other, coded.chunks), whole);
}

TEST(CodecOptions, RefusesValuesOutOfRange) {
  EXPECT_FALSE((CodecOptions{.chord_error_pitch = -0.1}.validate()));
  EXPECT_FALSE((CodecOptions{.chord_error_pitch = 0.14}.validate()));
  EXPECT_FALSE((CodecOptions{.total_error_pitch = 1.5}.validate()));
  EXPECT_FALSE((CodecOptions{.layers_per_chunk = 0}.validate()));
  EXPECT_FALSE((CodecOptions{.layers_per_chunk = 65}.validate()));
  EXPECT_FALSE((CodecOptions{.coding = static_cast<Coding>(9)}.validate()));
  EXPECT_FALSE((CodecOptions{.coding = Coding::CurveInWords}.validate()));
}

}  // namespace
}  // namespace telefab
