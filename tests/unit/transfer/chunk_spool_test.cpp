// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/transfer/chunk_spool.hpp>

namespace telefab {
namespace {

class ChunkSpoolTest : public testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path path() const { return folder_ / "chunks"; }
  [[nodiscard]] ChunkSpool open() const { return ChunkSpool::open(path()).value(); }
  static std::vector<std::byte> payload(std::uint8_t fill) {
    return std::vector<std::byte>(100 + fill, std::byte{fill});
  }
  void fill(std::uint8_t chunks) const {
    ChunkSpool spool = open();
    for (std::uint8_t i = 0; i < chunks; ++i) ASSERT_TRUE(spool.append(LayerIndex{10U * i}, 10, payload(i)));
  }
  [[nodiscard]] std::string bytes() const {
    std::ifstream in{path(), std::ios::binary};
    return {std::istreambuf_iterator<char>{in}, {}};
  }
  void write(const std::string& bytes) const { std::ofstream{path(), std::ios::binary} << bytes; }

 private:
  test::ScratchFolder scratch_;
  std::filesystem::path folder_ = scratch_.path();
};

TEST_F(ChunkSpoolTest, GivesBackAfterReopeningWhatWasAppended) {
  fill(3);
  ChunkSpool spool = open();
  EXPECT_EQ(spool.chunk_count(), 3U);
  EXPECT_EQ(spool.layer_count(), 30U);
  EXPECT_FALSE(spool.finished());
  for (std::uint8_t i = 0; i < 3; ++i) EXPECT_EQ(spool.read(i).value().payload, payload(i));
  EXPECT_EQ(spool.read(2).value().chain, spool.chain());
  EXPECT_EQ(spool.read(3).error().code, ErrorCode::NotFound);
}

TEST_F(ChunkSpoolTest, IsLookedIntoWithoutReadingItAllOrChangingIt) {
  fill(3);
  {
    ChunkSpool spool = open();
    ASSERT_TRUE(spool.finish(chain_after({}, 9, LayerIndex{0}, 1, {})));
  }
  std::string changed = bytes();
  const std::string whole = changed;
  changed[changed.find(std::string(50, '\1'))] ^= 1;  // in the payload of the second chunk
  write(changed + "what does not follow");
  const auto looked = ChunkSpool::look_into(path());
  ASSERT_TRUE(looked) << looked.error().what;
  EXPECT_EQ(looked->chunk_count(), 3U);
  EXPECT_EQ(looked->layer_count(), 30U);
  EXPECT_TRUE(looked->finished());
  EXPECT_EQ(looked->read(0)->payload, payload(0));
  EXPECT_EQ(looked->read(1).error().code, ErrorCode::NotTrusted) << "what is read is checked";
  EXPECT_EQ(looked->read(2)->payload, payload(2));
  EXPECT_EQ(bytes(), changed + "what does not follow");
  write(whole.substr(0, whole.size() / 2));
  EXPECT_EQ(ChunkSpool::look_into(path())->chunk_count(), 1U);
  std::filesystem::remove(path());
  EXPECT_EQ(ChunkSpool::look_into(path()).error().code, ErrorCode::NotFound);
  EXPECT_FALSE(std::filesystem::exists(path()));
}

TEST_F(ChunkSpoolTest, FindsTheChunkThatALayerIsIn) {
  fill(3);
  const ChunkSpool spool = open();
  for (const auto& [layer, sequence] : {std::pair{0U, 0U}, {9U, 0U}, {10U, 1U}, {29U, 2U}})
    EXPECT_EQ(spool.sequence_of(LayerIndex{layer}).value(), sequence) << layer;
  EXPECT_EQ(spool.sequence_of(LayerIndex{30}).error().code, ErrorCode::NotFound);
}

TEST_F(ChunkSpoolTest, KeepsEveryWholeChunkWhereverAWriteWasTorn) {
  fill(3);
  const std::string whole = bytes();
  std::size_t last_whole = 0;
  for (std::size_t cut = 0; cut < whole.size(); ++cut) {
    write(whole.substr(0, cut));
    ChunkSpool spool = open();
    ASSERT_LE(spool.chunk_count(), 2U);
    EXPECT_GE(spool.chunk_count(), last_whole);
    last_whole = spool.chunk_count();
    // What was cut off can be appended again.
    const auto next = static_cast<std::uint8_t>(last_whole);
    ASSERT_TRUE(spool.append(LayerIndex{10U * next}, 10, payload(next))) << cut;
  }
  EXPECT_EQ(last_whole, 2U);
}

TEST_F(ChunkSpoolTest, NeverGivesOutAChangedChunk) {
  fill(2);
  const std::string whole = bytes();
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ 0x10);
    write(changed);
    const auto spool = ChunkSpool::open(path());
    if (!spool) continue;
    for (std::uint8_t i = 0; i < spool->chunk_count(); ++i) EXPECT_EQ(spool->read(i).value().payload, payload(i)) << at;
    EXPECT_LT(spool->chunk_count(), 2U);
  }
}

TEST_F(ChunkSpoolTest, KeepsADamagedFileAsideAndGoesOnBehindItsSoundChunks) {
  fill(3);
  std::string changed = bytes();
  changed[changed.size() / 2] ^= 1;  // in the middle of the second chunk
  write(changed);
  ChunkSpool spool = open();
  EXPECT_EQ(spool.chunk_count(), 1U);
  ASSERT_TRUE(spool.damaged());
  std::ifstream aside{*spool.damaged(), std::ios::binary};
  EXPECT_EQ((std::string{std::istreambuf_iterator<char>{aside}, {}}), changed) << "nothing of it is lost";
  ASSERT_TRUE(spool.append(LayerIndex{10}, 10, payload(1)));
  EXPECT_FALSE(open().damaged());
  EXPECT_EQ(open().chunk_count(), 2U);
}

TEST_F(ChunkSpoolTest, KeepsNothingAsideOfATornTail) {
  fill(2);
  const std::string whole = bytes();
  for (const std::size_t cut : {std::size_t{1}, whole.size() / 2 + 3, whole.size() - 1})
    for (const std::size_t zeros : {0U, 4096U}) {
      if (zeros > 0 && cut > 1) continue;  // zeros in the place of a payload: below
      write(whole.substr(0, cut == 1 ? 0 : cut) + std::string(zeros, '\0'));
      EXPECT_FALSE(open().damaged()) << cut;
    }
  write(whole.substr(0, whole.size() - 20) + std::string(20, '\0'));
  EXPECT_FALSE(open().damaged()) << "the size was on disk, the bytes were not";
}

TEST_F(ChunkSpoolTest, RefusesAGapAndARepetition) {
  fill(2);
  ChunkSpool spool = open();
  EXPECT_EQ(spool.append(LayerIndex{10}, 10, payload(1)).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(spool.append(LayerIndex{30}, 10, payload(1)).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(spool.append(LayerIndex{20}, 0, payload(1)).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(spool.chunk_count(), 2U);
}

TEST_F(ChunkSpoolTest, IsFinishedOnceAndStaysSo) {
  fill(1);
  const Digest stack = digest_of(payload(9));
  ASSERT_TRUE(open().finish(stack));
  ChunkSpool spool = open();
  EXPECT_EQ(spool.finished(), stack);
  EXPECT_TRUE(spool.finish(stack));
  EXPECT_EQ(spool.finish(Digest{}).error().code, ErrorCode::Conflict);
  EXPECT_EQ(spool.append(LayerIndex{10}, 1, payload(1)).error().code, ErrorCode::Conflict);
}

TEST_F(ChunkSpoolTest, ChainTellsOrderAndJobApart) {
  const Digest zero;
  const Digest a = chain_after(zero, 0, LayerIndex{0}, 10, payload(1));
  EXPECT_NE(a, chain_after(zero, 1, LayerIndex{0}, 10, payload(1)));
  EXPECT_NE(a, chain_after(zero, 0, LayerIndex{10}, 10, payload(1)));
  EXPECT_NE(a, chain_after(zero, 0, LayerIndex{0}, 11, payload(1)));
  EXPECT_NE(a, chain_after(a, 0, LayerIndex{0}, 10, payload(1)));
  EXPECT_NE(a, chain_after(zero, 0, LayerIndex{0}, 10, payload(2)));
}

}  // namespace
}  // namespace telefab
