// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>
#include <telefab/base/digest.hpp>
#include <telefab/wire/message.hpp>

// Two sites understand each other exactly where they say the same protocol number, so whatever one of them may say is
// fixed under that number.
namespace telefab {
namespace {

std::string source(const std::string& path) {
  std::ifstream file{std::string{std::getenv("TELEFAB_SOURCE")} + "/" + path};
  return {std::istreambuf_iterator<char>{file}, {}};
}

/// Without comments, and with one space where there were any.
std::string bare(const std::string& text) {
  std::istringstream lines{text};
  std::string bare;
  for (std::string line, word; std::getline(lines, line);) {
    std::istringstream words{line.substr(0, line.find("//"))};
    while (words >> word) bare += word + " ";
  }
  return bare;
}

std::string messages_and_frame_numbers() {
  std::string all;
  for (const char* file : {"shared", "client", "fab"})
    all += bare(source(fmt::format("proto/telefab/v1/{}.proto", file)));
  const std::string frames = source("common/wire/include/telefab/wire/frame.hpp");
  const auto from = frames.find("enum class FrameType");
  return all + bare(frames.substr(from, frames.find("};", from) - from));
}

TEST(GoldenWire, NoMessageChangesUnderTheSameProtocolNumber) {
  const std::string wire = messages_and_frame_numbers();
  ASSERT_NE(wire.find("message OfferDeferred {"), std::string::npos);
  ASSERT_NE(wire.find("OfferDeferred = 37"), std::string::npos);
  EXPECT_EQ(fmt::format("{} {}", kProtocolVersion, to_hex(digest_of(std::as_bytes(std::span{wire})))),
            "8 78323a37fc7c17f97835453e3e03de1f0197b0efd67b8289cc7534614b6567e3")
      << "a site of another release must refuse this one by name instead of meeting a message that it does not know: "
         "raise kProtocolVersion, then write the new digest here";
}

}  // namespace
}  // namespace telefab
