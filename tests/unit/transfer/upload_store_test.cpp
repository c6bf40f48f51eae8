// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <random>
#include <telefab/base/file.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/transfer/upload_store.hpp>

namespace telefab {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

std::vector<std::byte> bytes_of(std::size_t count, std::uint32_t seed) {
  std::mt19937 random{seed};
  std::vector<std::byte> bytes(count);
  for (std::byte& b : bytes) b = static_cast<std::byte>(random() & 0xFFU);
  return bytes;
}

class UploadStoreTest : public testing::Test {
 protected:
  static UploadLimits small() { return {.most_bytes = 1'000'000, .most_uploads = 3, .part_bytes = 4096}; }
  std::unique_ptr<UploadStore> open() { return UploadStore::open(scratch.path() / "uploads", small(), clock).value(); }
  static UploadPlan plan_of(std::span<const std::byte> bytes, std::string name = "a.ply") {
    return {std::move(name), bytes.size(), digest_of(bytes), "ann"};
  }
  /// All of it, from where it stands.
  static void send_rest(UploadStore& store, const std::string& id, std::span<const std::byte> bytes) {
    for (auto upload = store.find(id).value(); upload.state == UploadState::Receiving;) {
      const auto rest = bytes.subspan(upload.received_bytes);
      upload = store.append(id, upload.received_bytes, rest.first(std::min<std::size_t>(4096, rest.size()))).value();
    }
  }
  [[nodiscard]] std::size_t files_in_folder() const {
    std::size_t count = 0;
    for (const auto& each : std::filesystem::recursive_directory_iterator{scratch.path() / "uploads"})
      count += each.is_regular_file() ? 1 : 0;
    return count;
  }

  test::ScratchFolder scratch;
  VirtualClock clock;
};

TEST_F(UploadStoreTest, GivesTheBytesThatWereSentInAnyPartsAndAcrossAnyRestarts) {
  for (std::uint32_t seed = 1; seed <= 25; ++seed) {
    std::mt19937 random{seed};
    const auto bytes = bytes_of(1 + random() % 40'000, seed);
    auto store = open();
    const std::string id = store->begin(plan_of(bytes))->id;
    while (true) {
      // What the store says is there is where a sender goes on, whatever was cut before.
      const Upload now = store->begin(plan_of(bytes)).value();
      if (now.state != UploadState::Receiving) break;
      const std::size_t left = bytes.size() - now.received_bytes;
      const std::size_t count = 1 + random() % std::min<std::size_t>(4096, left);
      const auto part = std::span{bytes}.subspan(now.received_bytes, count);
      switch (random() % 4) {
        case 0:  // the answer was lost: the same part comes again and is refused
          ASSERT_TRUE(store->append(id, now.received_bytes, part).has_value());
          ASSERT_EQ(store->append(id, now.received_bytes, part).error().code, ErrorCode::Conflict);
          break;
        case 1:  // a part from elsewhere
          ASSERT_FALSE(store->append(id, now.received_bytes + 1, part.first(1)).has_value());
          break;
        case 2:
          store = open();
          break;
        default:
          ASSERT_TRUE(store->append(id, now.received_bytes, part).has_value());
      }
    }
    ASSERT_EQ(store->check(id, {})->state, UploadState::Whole) << "seed " << seed;
    EXPECT_EQ(read_file(store->file(id).value(), 1U << 20U).value(), bytes) << "seed " << seed;
    ASSERT_TRUE(store->remove(id).has_value());
  }
}

TEST_F(UploadStoreTest, RefusesAnotherFilesBytesAndTakesTheRightOnesAfterwards) {
  const auto bytes = bytes_of(9000, 1);
  auto other = bytes;
  other[5000] ^= std::byte{1};
  auto store = open();
  const std::string id = store->begin(plan_of(bytes))->id;
  send_rest(*store, id, other);
  const auto checked = store->check(id, {});
  ASSERT_FALSE(checked.has_value());
  EXPECT_EQ(checked.error().code, ErrorCode::NotTrusted);
  EXPECT_EQ(store->find(id)->state, UploadState::Refused);
  EXPECT_FALSE(store->file(id).has_value());
  EXPECT_EQ(store->begin(plan_of(bytes))->received_bytes, 0U);
  send_rest(*store, id, bytes);
  EXPECT_EQ(store->check(id, {})->state, UploadState::Whole);
}

TEST_F(UploadStoreTest, ChecksAgainWhatNobodyCheckedBeforeARestart) {
  const auto bytes = bytes_of(5000, 2);
  auto store = open();
  const std::string id = store->begin(plan_of(bytes))->id;
  send_rest(*store, id, bytes);
  store = open();
  EXPECT_EQ(store->find(id)->state, UploadState::Checking);
  EXPECT_EQ(store->check(id, {})->state, UploadState::Whole);
  store = open();
  EXPECT_EQ(store->find(id)->state, UploadState::Whole);
}

TEST_F(UploadStoreTest, StopsACheckThatIsCancelledAndLosesNothing) {
  const auto bytes = bytes_of(5000, 3);
  auto store = open();
  const std::string id = store->begin(plan_of(bytes))->id;
  send_rest(*store, id, bytes);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(store->check(id, stop.get_token()).error().code, ErrorCode::Cancelled);
  EXPECT_EQ(store->check(id, {})->state, UploadState::Whole);
}

TEST_F(UploadStoreTest, TakesNoNameForAPath) {
  auto store = open();
  const auto bytes = bytes_of(10, 4);
  for (const char* name : {"", "..", "../a", "a/b", "/etc/passwd", ".hidden", "a\nb", "a\x1b[2J"})
    EXPECT_EQ(store->begin(plan_of(bytes, name)).error().code, ErrorCode::InvalidInput) << name;
  EXPECT_THAT(store->list(), IsEmpty());
  EXPECT_EQ(files_in_folder(), 0U);
  EXPECT_TRUE(store->begin(plan_of(bytes, "Größe.xyz")).has_value());
}

TEST_F(UploadStoreTest, StatesEachLimitThatItRefusesBy) {
  auto store = open();
  UploadPlan large = plan_of(bytes_of(10, 5));
  large.size_bytes = 1'000'001;
  EXPECT_THAT(store->begin(large).error().what, HasSubstr("the limit is 1000000"));
  large.size_bytes = 0;
  EXPECT_THAT(store->begin(large).error().what, HasSubstr("is empty"));
  for (std::uint32_t seed = 10; seed < 13; ++seed) ASSERT_TRUE(store->begin(plan_of(bytes_of(10, seed))).has_value());
  const auto refused = store->begin(plan_of(bytes_of(10, 14)));
  EXPECT_EQ(refused.error().code, ErrorCode::TooLarge);
  EXPECT_THAT(refused.error().what, HasSubstr("3 uploads"));
  const auto bytes = bytes_of(10, 10);
  const std::string id = store->begin(plan_of(bytes))->id;
  EXPECT_EQ(store->append(id, 0, bytes_of(4097, 1)).error().code, ErrorCode::TooLarge);
  EXPECT_EQ(store->append(id, 0, bytes_of(11, 1)).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(store->append(id, 0, {}).error().code, ErrorCode::InvalidInput);
  EXPECT_EQ(store->append("nothing", 0, bytes).error().code, ErrorCode::NotFound);
  EXPECT_EQ(store->missing_bytes(), 30U);
}

TEST_F(UploadStoreTest, RefusesAnotherSizeUnderTheSameDigest) {
  auto store = open();
  UploadPlan plan = plan_of(bytes_of(10, 6));
  ASSERT_TRUE(store->begin(plan).has_value());
  plan.size_bytes = 11;
  EXPECT_EQ(store->begin(plan).error().code, ErrorCode::Conflict);
}

TEST_F(UploadStoreTest, RemovesWhatNobodyTouchesAndKeepsWhatSomebodyUses) {
  auto store = open();
  const std::string old = store->begin(plan_of(bytes_of(10, 7)))->id;
  const std::string used = store->begin(plan_of(bytes_of(10, 8)))->id;
  clock.advance(std::chrono::hours{20});
  store->touch(used);
  EXPECT_THAT(store->remove_outlived(), IsEmpty());
  clock.advance(std::chrono::hours{5});
  EXPECT_THAT(store->remove_outlived(), testing::ElementsAre(old));
  EXPECT_EQ(store->find(old).error().code, ErrorCode::NotFound);
  EXPECT_EQ(files_in_folder(), 1U) << "what the other says of itself";
}

TEST_F(UploadStoreTest, RemovesAtItsStartWhatIsNoUpload) {
  const auto bytes = bytes_of(10, 9);
  std::string id;
  {
    auto store = open();
    id = store->begin(plan_of(bytes))->id;
  }
  const auto folder = scratch.path() / "uploads";
  std::filesystem::create_directories(folder / "strange");
  std::ofstream{folder / "strange" / "about.json"} << "{\"name\":\"../x\"}";
  std::ofstream{folder / "file"} << "x";
  auto store = open();
  EXPECT_EQ(store->list().size(), 1U);
  EXPECT_EQ(store->list()[0].id, id);
  EXPECT_FALSE(std::filesystem::exists(folder / "strange"));
  EXPECT_FALSE(std::filesystem::exists(folder / "file"));
}

TEST_F(UploadStoreTest, TakesTheNewestNameOfTheSameBytes) {
  auto store = open();
  const auto bytes = bytes_of(10, 11);
  const std::string id = store->begin(plan_of(bytes, "a.xyz"))->id;
  EXPECT_EQ(store->begin(plan_of(bytes, "b.ply"))->id, id);
  store = open();
  EXPECT_EQ(store->find(id)->plan.name, "b.ply");
}

}  // namespace
}  // namespace telefab
