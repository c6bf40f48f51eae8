// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <telefab/base/json_number.hpp>

namespace telefab {
namespace {

using nlohmann::json;

TEST(WholeNumber, GivesWhatFits) {
  EXPECT_EQ(whole_number<std::uint32_t>(json::parse("4294967295")), 4294967295U);
  EXPECT_EQ(whole_number<std::int64_t>(json::parse("-9223372036854775808")), INT64_MIN);
  EXPECT_EQ(whole_number<std::uint64_t>(json::parse("18446744073709551615")), UINT64_MAX);
  EXPECT_EQ(whole_number<int>(json::parse("7"), 0, 7), 7);
}

TEST(WholeNumber, ThrowsWhereAnythingElseStands) {
  for (const char* text : {"8e51", "1.0", "-1", "4294967296", "true", "null", "\"1\"", "[1]", "1e400"}) {
    const auto value = json::parse(text, nullptr, false);
    EXPECT_THROW((void)whole_number<std::uint32_t>(value), json::exception) << text;
  }
  EXPECT_THROW((void)whole_number<int>(json::parse("8"), 0, 7), json::exception);
}

}  // namespace
}  // namespace telefab
