// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <telefab/net/endpoint.hpp>

namespace telefab::net {
namespace {

using testing::HasSubstr;

std::string refusal_of(std::string_view text) {
  const auto endpoint = endpoint_from_text(text);
  EXPECT_FALSE(endpoint) << text;
  return endpoint ? "" : endpoint.error().what;
}

TEST(Endpoint, IsReadAsItIsWritten) {
  for (const char* text : {"localhost:7420", "10.1.2.3:1", "[::1]:65535"}) {
    const auto endpoint = endpoint_from_text(text);
    ASSERT_TRUE(endpoint) << text;
    EXPECT_EQ(to_text(*endpoint), text);
  }
}

TEST(Endpoint, SaysWhatIsWrongWithItself) {
  EXPECT_THAT(refusal_of("http://127.0.0.1:7480"), HasSubstr("the address of a page"));
  EXPECT_THAT(refusal_of("https://fab.example.org/"), HasSubstr("the address of a page"));
  EXPECT_THAT(refusal_of("::1:7420"), HasSubstr("brackets"));
  EXPECT_THAT(refusal_of("localhost"), HasSubstr("port is missing"));
  EXPECT_THAT(refusal_of(":7420"), HasSubstr("host is missing"));
  EXPECT_THAT(refusal_of("localhost:70000"), HasSubstr("0 to 65535"));
}

}  // namespace
}  // namespace telefab::net
