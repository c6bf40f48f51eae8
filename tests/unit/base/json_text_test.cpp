// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>

namespace telefab {
namespace {

using Json = nlohmann::ordered_json;

TEST(JsonText, KeepsTheOrderOfItsKeys) {
  EXPECT_EQ(json_text({{"z", 1}, {"a", {{"y", 2.5}, {"b", nullptr}}}}), R"({"z":1,"a":{"y":2.5,"b":null}})");
  EXPECT_EQ(json_text(parsed_json(R"({"z":1,"a":2})")), R"({"z":1,"a":2})");
}

TEST(JsonText, WritesANameThatIsNotUtf8WithAMarkInstead) {
  EXPECT_EQ(json_text({{"job",
                        "gr\xf6\xdf"
                        "e"}}),
            "{\"job\":\"gr\xEF\xBF\xBD\xEF\xBF\xBD"
            "e\"}");
}

TEST(JsonText, IndentsWhereAsked) { EXPECT_EQ(json_text({{"a", 1}}, 1), "{\n \"a\": 1\n}"); }

TEST(ParsedJson, ThrowsWhereTheTextIsNone) {
  for (const char* text : {"", "{", "{\"a\":1}}", "nan"}) {
    EXPECT_THROW((void)parsed_json(text), Json::parse_error) << text;
    EXPECT_TRUE(json_or_discarded(text).is_discarded()) << text;
  }
}

}  // namespace
}  // namespace telefab
