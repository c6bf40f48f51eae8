#include <gmock/gmock.h>
#include <gtest/gtest.h>

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

Coded encode(const LayerStack& stack, const CodecOptions& options = {}) {
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

TEST_P(StackCodecProperty, DecodesWhatTheEncoderSaidEachChunkAloneAndInAnyOrder) {
  const LayerStack stack = random_stack(GetParam(), 75);
  const Coded coded = encode(stack);
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

TEST_P(StackCodecProperty, MovesNoVertexFartherThanHalfAGridDiagonal) {
  const LayerStack stack = random_stack(GetParam(), 8);
  const Coded coded = encode(stack);
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

TEST_P(StackCodecProperty, CodesItsOwnResultToTheSameBytes) {
  const LayerStack stack = random_stack(GetParam(), 40);
  const Coded once = encode(stack);
  const Coded twice = encode(LayerStack::from_layers(stack.header(), once.layers).value());
  EXPECT_EQ(once.chunks, twice.chunks);
}

TEST_P(StackCodecProperty, SurvivesDamageWithoutACrashAndWithinItsBounds) {
  const LayerStack stack = random_stack(GetParam(), 8);
  const Coded coded = encode(stack);
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
  layer.certificate = {LayerCertificate::Verdict::Certified, LayerCertificate::Method::Grid, 1, 1, "", std::nullopt};
  StackEncoder encoder = StackEncoder::start(header, {}).value();
  ASSERT_TRUE(encoder.add(layer));
  ASSERT_TRUE(encoder.finish().value());
  EXPECT_TRUE(encoder.coded_layers()[0].contours.empty());
  EXPECT_EQ(encoder.coded_layers()[0].certificate.verdict, LayerCertificate::Verdict::Flagged);
  EXPECT_EQ(encoder.coded_layers()[0].certificate.measured_euler, 0);
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
  EXPECT_FALSE((CodecOptions{.grid_per_pitch = 0}.validate()));
  EXPECT_FALSE((CodecOptions{.grid_per_pitch = 256}.validate()));
  EXPECT_FALSE((CodecOptions{.layers_per_chunk = 0}.validate()));
  EXPECT_FALSE((CodecOptions{.layers_per_chunk = 65}.validate()));
  EXPECT_FALSE((CodecOptions{.coding = static_cast<Coding>(7)}.validate()));
}

}  // namespace
}  // namespace telefab
