// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cstring>
#include <string_view>
#include <vector>

#include "sliced_checks.hpp"

// Any bytes from the fields behind the previews on; what stands before is 195 kB that no reader looks at. An even first
// byte puts checksums right, so that the search goes on behind them; its next bit makes it a file with the low byte
// first.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kFields = 195'310, kHeader = 195'477;
  static std::vector<std::uint8_t> file = [] {
    std::vector<std::uint8_t> head(kFields);
    constexpr std::array<std::uint8_t, 12> kBegin{'V', '3', '.', '0', 7, 0, 0, 0, 'D', 'L', 'P', 0};
    std::copy(kBegin.begin(), kBegin.end(), head.begin());
    for (const std::size_t at : {27'106U, 195'308U}) head[at] = 0x0D, head[at + 1] = 0x0A;
    return head;
  }();
  if (size == 0) return 0;
  constexpr std::string_view kLittle = "ELEGOO Jupiter 2";
  const bool is_little = (data[0] & 2U) != 0;
  for (std::size_t i = 0; i < kLittle.size(); ++i)
    file[92 + i] = is_little ? static_cast<std::uint8_t>(kLittle[i]) : std::uint8_t{0};
  file.resize(kFields);
  file.insert(file.end(), data + 1, data + size);
  for (std::size_t at = kHeader; (data[0] & 1U) == 0 && at + 70 < file.size();) {
    std::size_t packed = 0;
    for (std::size_t i = 0; i < 4; ++i) packed |= std::size_t{file[at + 66 + i]} << 8U * (is_little ? i : 3 - i);
    if (packed < 2 || packed > file.size() - at - 70) break;
    std::uint8_t sum = 0;
    for (std::size_t i = 1; i + 1 < packed; ++i) sum = static_cast<std::uint8_t>(sum + file[at + 70 + i]);
    file[at + 70 + packed - 1] = static_cast<std::uint8_t>(~sum);
    at += 70 + packed + 2;
  }
  telefab::fab::check_sliced(std::as_bytes(std::span{file}));
  return 0;
}
