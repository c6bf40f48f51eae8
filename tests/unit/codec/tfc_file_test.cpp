// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <telefab/codec/tfc_file.hpp>
#include <telefab/test/random_stack.hpp>

#include "earlier_files.hpp"

namespace telefab {
namespace {

using test::random_stack;
using testing::HasSubstr;

TEST(TfcFile, ComesBackWithHeaderLayersAndCertificates) {
  const LayerStack stack = random_stack(5, 70);
  const auto bytes = write_tfc(stack, {});
  ASSERT_TRUE(bytes);
  const auto back = read_tfc(*bytes);
  ASSERT_TRUE(back) << back.error().what;
  EXPECT_EQ(back->header(), stack.header());
  ASSERT_EQ(back->layers().size(), 70U);
  for (std::size_t i = 0; i < 70; ++i) EXPECT_EQ(back->layers()[i].certificate, stack.layers()[i].certificate);
  const CodecOptions exact{.coding = Coding::Exact};
  const auto once = write_tfc(stack, exact).value();
  EXPECT_EQ(write_tfc(read_tfc(once).value(), exact).value(), once);
}

TEST(TfcFile, IsMadeOfChunksThatExistWithoutCodingThemOnceMore) {
  const LayerStack stack = random_stack(6, 130);
  StackEncoder encoder = StackEncoder::start(stack.header(), {}).value();
  std::vector<Chunk> chunks;
  for (const Layer& layer : stack.layers())
    if (auto chunk = encoder.add(layer).value()) chunks.push_back(std::move(*chunk));
  if (auto chunk = encoder.finish().value()) chunks.push_back(std::move(*chunk));
  const auto bytes = tfc_of(stack.header(), chunks, encoder.stack_digest());
  EXPECT_EQ(bytes, write_tfc(stack, {}).value());
  EXPECT_EQ(digest_of(read_tfc(bytes).value()), encoder.stack_digest());
}

std::vector<std::byte> bytes_of(std::string_view hex) {
  std::vector<std::byte> bytes;
  for (std::size_t i = 0; i < hex.size(); i += 2)
    bytes.push_back(static_cast<std::byte>(std::stoi(std::string{hex.substr(i, 2)}, nullptr, 16)));
  return bytes;
}

TEST(TfcFile, ReadsWhatTheReleaseBeforeWrote) {
  using Verdict = LayerCertificate::Verdict;
  for (const std::string_view hex : {test::kEarlierExactFile, test::kEarlierCurveFile}) {
    const auto stack = read_tfc(bytes_of(hex));
    ASSERT_TRUE(stack) << stack.error().what;
    ASSERT_EQ(stack->layers().size(), 6U);
    std::vector<Verdict> verdicts;
    for (const Layer& layer : stack->layers()) {
      verdicts.push_back(layer.certificate.verdict);
      ASSERT_EQ(layer.contours.size(), 2U);
      EXPECT_NEAR(layer.contours[0].signed_area_mm2(), 176, 1.5);
    }
    EXPECT_EQ(verdicts, (std::vector{Verdict::Unchecked, Verdict::Measured, Verdict::Doubtful, Verdict::Doubtful,
                                     Verdict::Measured, Verdict::Measured}));
    EXPECT_TRUE(stack->layers()[2].certificate.is_incomplete());
    EXPECT_EQ(stack->layers()[2].certificate.doubt->place, (Point2{3, 4}));
    EXPECT_FALSE(stack->layers()[3].certificate.is_incomplete());
    EXPECT_EQ(stack->layers()[3].certificate.doubt->reason, DoubtReason::EarlierRelease);
  }
}

TEST(TfcFile, RefusesAFlippedBitInWhatTheReleaseBeforeWrote) {
  for (const std::string_view hex : {test::kEarlierExactFile, test::kEarlierCurveFile}) {
    auto bytes = bytes_of(hex);
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      bytes[i] ^= std::byte{4};
      EXPECT_FALSE(read_tfc(bytes)) << i;
      bytes[i] ^= std::byte{4};
    }
  }
}

TEST(TfcFile, RefusesEveryTruncationAndSaysWhere) {
  const auto bytes = write_tfc(random_stack(6, 3), {}).value();
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    const auto read = read_tfc(std::span{bytes}.first(size));
    ASSERT_FALSE(read) << size;
    EXPECT_EQ(read.error().code, ErrorCode::InvalidInput);
    EXPECT_THAT(read.error().what, HasSubstr("byte "));
  }
}

TEST(TfcFile, RefusesEverySingleFlippedBit) {
  auto bytes = write_tfc(random_stack(7, 2), {}).value();
  for (std::size_t i = 0; i < bytes.size(); ++i)
    for (unsigned bit = 0; bit < 8; ++bit) {
      bytes[i] ^= static_cast<std::byte>(1U << bit);
      EXPECT_FALSE(read_tfc(bytes)) << i;
      bytes[i] ^= static_cast<std::byte>(1U << bit);
    }
  EXPECT_TRUE(read_tfc(bytes));
}

TEST(TfcFile, RefusesBytesBehindTheEnd) {
  auto bytes = write_tfc(random_stack(8, 2), {}).value();
  bytes.push_back(std::byte{0});
  EXPECT_THAT(read_tfc(bytes).error().what, HasSubstr("follow the end"));
}

TEST(TfcFile, RefusesAChunkOfAnotherStack) {
  // Same header, other layers: record lengths differ, checksums hold, only the chain and the digests can tell.
  const auto a = write_tfc(random_stack(9, 40), {}).value();
  LayerStack other = random_stack(9, 40);
  std::vector<Layer> layers(other.layers().begin(), other.layers().end());
  std::swap(layers[0].contours, layers[1].contours);
  layers[0].certificate.measured_euler = layers[1].certificate.measured_euler = 0;
  const auto b = write_tfc(LayerStack::from_layers(other.header(), layers).value(), {}).value();
  const auto chunk_at = [](const std::vector<std::byte>& file, int number) {
    std::size_t at = 8;
    for (int record = 0; record < number; ++record) {
      std::size_t length = 0;
      for (unsigned i = 0; i < 4; ++i) length |= std::to_integer<std::size_t>(file[at + 1 + i]) << (8 * i);
      at += 9 + length;
    }
    return at;
  };
  // Header and first chunk of b, second chunk and end of a.
  std::vector<std::byte> spliced(b.begin(), b.begin() + static_cast<std::ptrdiff_t>(chunk_at(b, 2)));
  spliced.insert(spliced.end(), a.begin() + static_cast<std::ptrdiff_t>(chunk_at(a, 2)), a.end());
  EXPECT_THAT(read_tfc(spliced).error().what, HasSubstr("digest chain"));
}

TEST(TfcFile, RefusesOtherFiles) {
  for (const std::string_view text : {"", "ply\nformat ascii 1.0\n", "TFC2\r\n\x1a\n", "PK\x03\x04"})
    EXPECT_THAT(read_tfc(std::as_bytes(std::span{text})).error().what, HasSubstr("not a .tfc file"));
}

TEST(TfcWriter, HandsOnTheSinksErrorWheneverItComes) {
  const LayerStack stack = random_stack(1, 1);
  int failed = 0;
  for (int most = 0;; ++most) {
    int room = most;
    const auto write = [&]() -> Result<void> {
      auto writer = TfcWriter::start(stack.header(), {}, [&](std::span<const std::byte>) -> Result<void> {
        if (room-- > 0) return {};
        return fail(ErrorCode::StorageFailed, "the disk is full");
      });
      if (!writer) return tl::unexpected{writer.error()};
      for (const Layer& layer : stack.layers())
        if (auto added = writer->add(layer); !added) return added;
      if (auto ended = writer->finish(); !ended) return tl::unexpected{ended.error()};
      return {};
    };
    const auto written = write();
    if (written) break;
    EXPECT_EQ(written.error().code, ErrorCode::StorageFailed) << most;
    ++failed;
  }
  EXPECT_EQ(failed, 3) << "head, chunk, end";
}

}  // namespace
}  // namespace telefab
