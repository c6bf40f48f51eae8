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
            "8 31b3d821ee3316109d360ecd1c90f4e8dad2f5935ef870dc7fab07363ba58b05")
      << "a site of another release must refuse this one by name instead of meeting a message that it does not know: "
         "raise kProtocolVersion, then write the new digest here";
}

}  // namespace
}  // namespace telefab
