// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <random>
#include <telefab/base/record_line.hpp>

namespace telefab {
namespace {

std::vector<std::string> bodies(const RecordScan& scan) {
  std::vector<std::string> out;
  for (const RecordLine& record : scan.records) out.push_back(record.body);
  return out;
}

std::string lines(std::uint64_t count) {
  std::string text;
  for (std::uint64_t n = 1; n <= count; ++n) text += to_record_line(n, "{\"step\":" + std::to_string(n * 7) + "}");
  return text;
}

TEST(RecordLine, ReadsBackWhatWasWritten) {
  const RecordScan scan = scan_record_lines(lines(3));
  EXPECT_EQ(bodies(scan), (std::vector<std::string>{"{\"step\":7}", "{\"step\":14}", "{\"step\":21}"}));
  EXPECT_EQ(scan.records.back().sequence, 3u);
  EXPECT_TRUE(scan.damage.empty());
  EXPECT_EQ(scan.torn_bytes, 0u);
  EXPECT_EQ(scan.whole_bytes, lines(3).size());
}

TEST(RecordLine, TakesEveryBrokenOffWritingForATornTailAndNeverForDamage) {
  const std::string whole = lines(4);
  const std::string before = lines(3);
  for (std::size_t cut = before.size(); cut < whole.size(); ++cut)
    for (const std::size_t zeros : {0u, 1u, 4096u}) {
      SCOPED_TRACE(std::to_string(cut) + " and " + std::to_string(zeros));
      if (cut == whole.size() - 1 && zeros > 0) continue;  // a record and a changed line end: asked about
      const RecordScan scan = scan_record_lines(whole.substr(0, cut) + std::string(zeros, '\0'));
      EXPECT_TRUE(scan.damage.empty());
      EXPECT_EQ(scan.records.size(), 3u);
      EXPECT_EQ(scan.whole_bytes, before.size());
      EXPECT_EQ(scan.torn_bytes, cut - before.size() + zeros);
    }
}

TEST(RecordLine, TakesNoChangedBitForATornTail) {
  const std::string whole = lines(6);
  for (std::size_t at = 0; at < whole.size(); ++at)
    for (int bit = 0; bit < 8; ++bit) {
      std::string changed = whole;
      changed[at] = static_cast<char>(changed[at] ^ (1 << bit));
      const RecordScan scan = scan_record_lines(changed);
      ASSERT_FALSE(scan.damage.empty()) << at << " bit " << bit;
      ASSERT_EQ(scan.torn_bytes, 0u) << at << " bit " << bit;
      ASSERT_GE(scan.records.size(), 5u) << at << " bit " << bit;
    }
}

TEST(RecordLine, CountsWhatIsMissingInTheMiddle) {
  const std::string text = lines(2) + lines(7).substr(lines(5).size());
  const RecordScan scan = scan_record_lines(text);
  ASSERT_EQ(scan.damage.size(), 1u);
  EXPECT_EQ(scan.damage[0], (RecordDamage{lines(2).size(), 0, 2, 3}));
  EXPECT_EQ(scan.records.size(), 4u);
}

TEST(RecordLine, SaysThatARecordStandsTwice) {
  const RecordScan scan = scan_record_lines(lines(3) + lines(3).substr(lines(2).size()));
  EXPECT_EQ(scan.damage.size(), 1u);
}

TEST(RecordLine, CallsADestroyedEndDamageAndGuessesHowManyRecordsItHeld) {
  std::string text = lines(6);
  for (std::size_t at = lines(4).size(); at < text.size(); ++at)
    if (text[at] != '\n') text[at] = '#';
  const RecordScan scan = scan_record_lines(text);
  ASSERT_EQ(scan.damage.size(), 1u);
  EXPECT_EQ(scan.damage[0].after, 4u);
  EXPECT_EQ(scan.damage[0].lost, 2u);
}

TEST(RecordLine, ReadsLinesOfAnOlderFormBeforeTheFirstRecord) {
  const auto old = [](std::string_view line) -> std::optional<std::string> {
    if (!line.starts_with("ok ")) return {};
    return std::string{line.substr(3)};
  };
  const RecordScan scan = scan_record_lines("ok a\nok b\n" + to_record_line(3, "c"), old);
  EXPECT_EQ(bodies(scan), (std::vector<std::string>{"a", "b", "c"}));
  EXPECT_TRUE(scan.damage.empty());
  EXPECT_EQ(scan_record_lines("ok a\nok", old).torn_bytes, 2u);
  EXPECT_EQ(scan_record_lines("ok a\nbad\nok b\n", old).damage.size(), 1u);
  EXPECT_EQ(scan_record_lines("ok a\nbad\n", old).damage.size(), 1u);
}

}  // namespace
}  // namespace telefab
