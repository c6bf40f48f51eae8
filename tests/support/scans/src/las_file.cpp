// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/test/las_file.hpp>

#include <algorithm>
#include <bit>

namespace telefab::test {
namespace {

template <class T>
void put_at(std::string& out, std::size_t at, T value) {
  const auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
  std::copy(raw.begin(), raw.end(), out.begin() + static_cast<std::ptrdiff_t>(at));
}

}  // namespace

std::string las_file(std::span<const std::array<std::int32_t, 3>> points, const LasOptions& options) {
  constexpr std::array<std::uint16_t, 11> kRecord{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
  const std::size_t head = options.minor == 4 ? 375 : options.minor == 3 ? 235 : 227;
  const std::size_t record = kRecord.at(options.format) + std::size_t{options.extra_bytes};
  const std::size_t gap = 10;  // variable length records may lie between header and points
  std::string out(head + gap + points.size() * record, '\0');
  std::copy_n("LASF", 4, out.begin());
  out[24] = 1;
  out[25] = static_cast<char>(options.minor);
  put_at(out, 94, static_cast<std::uint16_t>(head));
  put_at(out, 96, static_cast<std::uint32_t>(head + gap));
  out[104] = static_cast<char>(options.format);
  put_at(out, 105, static_cast<std::uint16_t>(record));
  if (options.minor == 4)
    put_at(out, 247, std::uint64_t{points.size()});
  else
    put_at(out, 107, static_cast<std::uint32_t>(points.size()));
  for (int axis = 0; axis < 3; ++axis) {
    const auto place = 8 * static_cast<std::size_t>(axis);
    put_at(out, 131 + place, options.scale[axis]);
    put_at(out, 155 + place, options.offset[axis]);
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::size_t at = head + gap + i * record;
    for (std::size_t axis = 0; axis < 3; ++axis) put_at(out, at + 4 * axis, points[i][axis]);
    if (static_cast<std::int64_t>(i) == options.withheld) out[at + 15] = options.format < 6 ? '\x80' : '\x04';
  }
  return out;
}

}  // namespace telefab::test
