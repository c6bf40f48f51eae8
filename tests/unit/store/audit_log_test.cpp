// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>

#include <fstream>
#include <telefab/store/audit_log.hpp>
#include <telefab/test/scratch_folder.hpp>

namespace telefab {
namespace {

using testing::HasSubstr;

class AuditLogTest : public testing::Test {
 protected:
  [[nodiscard]] std::filesystem::path path() const { return folder_ / "audit.log"; }
  [[nodiscard]] std::string text() const {
    std::ifstream in{path(), std::ios::binary};
    return {std::istreambuf_iterator<char>{in}, {}};
  }
  void write(const std::string& text) const { std::ofstream{path(), std::ios::binary} << text; }
  void fill() const {
    const auto log = AuditLog::open(path(), clock).value();
    for (const char* what : {"submit j1", "pause j1", "cancel j1"}) ASSERT_TRUE(log->add("ana", what));
  }
  VirtualClock clock;

 private:
  test::ScratchFolder scratch_;
  std::filesystem::path folder_ = scratch_.path();
};

TEST_F(AuditLogTest, GoesOnAfterReopening) {
  fill();
  fill();
  EXPECT_TRUE(AuditLog::open(path(), clock));
  const std::string all = text();
  EXPECT_EQ(std::count(all.begin(), all.end(), '\n'), 6);
}

TEST_F(AuditLogTest, HasAHeadThatStandsForAllOfItsLines) {
  EXPECT_EQ(audit_head(path()).error().code, ErrorCode::NotFound);
  write("");
  EXPECT_EQ(audit_head(path())->entries, 0U);
  std::filesystem::remove(path());
  fill();
  const auto three = audit_head(path());
  ASSERT_TRUE(three) << three.error().what;
  EXPECT_EQ(three->entries, 3U);
  const std::string whole = text();
  // The next line names it; one that is half written does not count yet.
  ASSERT_TRUE(AuditLog::open(path(), clock).value()->add("ana", std::string(5000, '"')));
  EXPECT_THAT(text().substr(whole.size()), HasSubstr("\"before\":\"" + to_hex(three->line)));
  EXPECT_EQ(audit_head(path())->entries, 4U);
  write(whole + "{\"n\":4,\"uni");
  EXPECT_EQ(audit_head(path())->line, three->line);
  write(whole + "no entry\n");
  EXPECT_EQ(audit_head(path()).error().code, ErrorCode::NotTrusted);
}

TEST_F(AuditLogTest, TellsAChangedADroppedAndASwappedLine) {
  fill();
  const std::string whole = text();
  std::string changed = whole;
  changed.replace(changed.find("pause"), 5, "print");
  std::string dropped = whole;
  const auto second = whole.find('\n') + 1;
  dropped.erase(second, whole.find('\n', second) + 1 - second);
  const std::string swapped = whole.substr(second) + whole.substr(0, second);
  for (const std::string& bad : {changed, dropped, swapped}) {
    write(bad);
    const auto log = AuditLog::open(path(), clock);
    ASSERT_FALSE(log);
    EXPECT_EQ(log.error().code, ErrorCode::NotTrusted);
    EXPECT_THAT(log.error().what, HasSubstr("line"));
  }
}

TEST_F(AuditLogTest, CutsOffALineThatWasNeverFinished) {
  fill();
  const std::string whole = text();
  write(whole + "{\"n\":4,\"who");
  EXPECT_TRUE(AuditLog::open(path(), clock));
  EXPECT_EQ(text(), whole);
}

TEST_F(AuditLogTest, TellsAChangedBitOfItsLastLine) {
  fill();
  const std::string whole = text();
  const std::size_t last = whole.rfind('\n', whole.size() - 2) + 1;
  for (std::size_t at = last; at + 1 < whole.size(); ++at) {
    std::string changed = whole;
    changed[at] = static_cast<char>(changed[at] ^ 4);
    write(changed);
    const auto log = AuditLog::open(path(), clock);
    ASSERT_FALSE(log) << at;
    EXPECT_EQ(log.error().code, ErrorCode::NotTrusted);
    EXPECT_EQ(text(), changed) << "damage is never cut";
  }
}

TEST_F(AuditLogTest, ReadsTheLinesOf01BeforeItsOwn) {
  const std::string old =
      R"({"n":1,"unix_ms":0,"who":"ana","what":"submit j1","before":")" + std::string(64, '0') + "\"}\n";
  write(old);
  fill();
  EXPECT_TRUE(AuditLog::open(path(), clock));
  EXPECT_TRUE(text().starts_with(old));
}

TEST_F(AuditLogTest, GoesOnBehindAWriteForWhichThereWasNoRoom) {
  fill();
  const auto log = AuditLog::open(path(), clock).value();
  // A limit of this process stands in for a full disk; the signal that comes with it is a program's to ignore.
  const auto before = ::signal(SIGXFSZ, SIG_IGN);
  rlimit usual{};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &usual), 0);
  const rlimit tight{text().size() + 30, usual.rlim_max};
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &tight), 0);
  const auto refused = log->add("ana", "cancel j2");
  ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &usual), 0);
  ::signal(SIGXFSZ, before);
  EXPECT_EQ(refused.error().code, ErrorCode::StorageFailed);
  EXPECT_TRUE(log->add("ana", "cancel j2"));
  EXPECT_TRUE(AuditLog::open(path(), clock)) << "the next start is not refused";
}

class AuditParts : public AuditLogTest {
 protected:
  static constexpr std::uint64_t kPartBytes = 1000;
  /// Some five lines a part.
  void fill_parts() const {
    const auto log = AuditLog::open(path(), clock, kPartBytes).value();
    for (int i = 0; i < 23; ++i) ASSERT_TRUE(log->add("ana", "submit j" + std::to_string(i)));
  }
  [[nodiscard]] std::filesystem::path part(int number) const {
    return path().string() + ".00000" + std::to_string(number);
  }
  static void change(const std::filesystem::path& file, std::string_view from, std::string_view to) {
    std::ifstream in{file, std::ios::binary};
    std::string text{std::istreambuf_iterator<char>{in}, {}};
    text.replace(text.find(from), from.size(), to);
    std::ofstream{file, std::ios::binary} << text;
  }
};

TEST_F(AuditParts, GoOnWhereTheOneBeforeEndsOverRestarts) {
  fill_parts();
  fill_parts();
  const auto parts = audit_parts(path());
  ASSERT_GT(parts.size(), 5U);
  EXPECT_EQ(parts.back(), path());
  for (const auto& each : parts) EXPECT_LT(std::filesystem::file_size(each), kPartBytes + 300) << each;
  const auto head = check_audit_log(path());
  ASSERT_TRUE(head) << head.error().what;
  EXPECT_EQ(head->entries, 46U);
  EXPECT_EQ(audit_head(path())->entries, 46U);
  EXPECT_EQ(audit_head(path())->line, head->line);
}

TEST_F(AuditParts, AStartReadsTheLastAndTheEndOfTheOneBefore) {
  fill_parts();
  const auto parts = audit_parts(path());
  change(parts[1], "submit", "cancel");  // whatever lies further back is not read
  EXPECT_TRUE(AuditLog::open(path(), clock, kPartBytes));
  const auto checked = check_audit_log(path());
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().code, ErrorCode::NotTrusted);
  EXPECT_THAT(checked.error().what, HasSubstr(parts[1].string()));
  change(parts[1], "cancel", "submit");
  ASSERT_TRUE(check_audit_log(path()));

  const auto before = parts[parts.size() - 2];
  std::ifstream in{before};
  const std::string whole{std::istreambuf_iterator<char>{in}, {}};
  const std::size_t last = whole.rfind('\n', whole.size() - 2) + 1;
  std::ofstream{before} << whole.substr(0, last);  // its last line dropped
  const auto opened = AuditLog::open(path(), clock, kPartBytes);
  ASSERT_FALSE(opened);
  EXPECT_EQ(opened.error().code, ErrorCode::NotTrusted);
}

TEST_F(AuditParts, OneThatIsMissingShows) {
  fill_parts();
  std::filesystem::remove(part(2));
  EXPECT_EQ(check_audit_log(path()).error().code, ErrorCode::NotTrusted);
  EXPECT_EQ(AuditLog::open(path(), clock, kPartBytes).error().code, ErrorCode::NotTrusted);
}

TEST_F(AuditParts, ALogOfOnePieceIsClosedAtTheFirstStartAndReadNoMore) {
  fill();
  ASSERT_TRUE(AuditLog::open(path(), clock, 100).value()->add("ana", "cancel j2"));
  EXPECT_EQ(audit_parts(path()).size(), 2U);
  EXPECT_EQ(check_audit_log(path())->entries, 4U);
}

// As a kill between the two steps leaves it.
TEST_F(AuditParts, APartThatWasClosedWithNoFileBehindItIsGoneOnFrom) {
  fill();
  const auto head = audit_head(path());
  std::filesystem::rename(path(), part(1));
  EXPECT_EQ(audit_head(path())->line, head->line);
  ASSERT_TRUE(AuditLog::open(path(), clock).value()->add("ana", "cancel j2"));
  EXPECT_EQ(check_audit_log(path())->entries, 4U);
}

}  // namespace
}  // namespace telefab
