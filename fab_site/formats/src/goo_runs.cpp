// SPDX-License-Identifier: GPL-3.0-or-later
#include "goo_runs.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace telefab::fab::goo {
namespace {

constexpr std::byte kBegin{0x55};
enum Kind : std::uint8_t { kBlack = 0, kGrey = 1, kDifference = 2, kWhite = 3 };
constexpr std::size_t kMostRun = (1U << 28U) - 1;
constexpr int kMostDifference = 15;
constexpr std::size_t kMostDifferenceRun = 255;

/// NOT of the sum of the chunks' bytes.
std::byte checksum(std::span<const std::byte> chunks) {
  std::uint8_t sum = 0;
  for (const std::byte b : chunks) sum = static_cast<std::uint8_t>(sum + std::to_integer<std::uint8_t>(b));
  return static_cast<std::byte>(static_cast<std::uint8_t>(~sum));
}

class Packer {
 public:
  Packer() { out_.push_back(kBegin); }
  void add(std::uint8_t value, std::size_t run) {
    const int step = int{value} - int{previous_};
    const bool is_grey = value != 0 && value != 255;
    // A run of greys near the one before: two bytes at most instead of two at least.
    if (is_grey && step != 0 && std::abs(step) <= kMostDifference && run <= kMostDifferenceRun) {
      const auto size = static_cast<std::uint8_t>(std::abs(step));
      put(static_cast<std::uint8_t>(kDifference << 6U | (step < 0 ? 0x20U : 0U) | (run > 1 ? 0x10U : 0U) | size));
      if (run > 1) put(static_cast<std::uint8_t>(run));
    } else {
      for (std::size_t left = run; left > 0;) {
        const std::size_t part = std::min(left, kMostRun);
        put_run(value, static_cast<std::uint32_t>(part), is_grey ? kGrey : value == 0 ? kBlack : kWhite);
        left -= part;
      }
    }
    previous_ = value;
  }
  std::vector<std::byte> finish() && {
    out_.push_back(checksum(std::span{out_}.subspan(1)));
    return std::move(out_);
  }

 private:
  void put(std::uint8_t byte) { out_.push_back(static_cast<std::byte>(byte)); }
  void put_run(std::uint8_t value, std::uint32_t run, Kind kind) {
    const unsigned further = run < (1U << 4U) ? 0 : run < (1U << 12U) ? 1 : run < (1U << 20U) ? 2 : 3;
    put(static_cast<std::uint8_t>(kind << 6U | further << 4U | (run & 0xFU)));
    if (kind == kGrey) put(value);
    for (unsigned i = further; i > 0; --i) put(static_cast<std::uint8_t>(run >> (4 + 8 * (i - 1))));
  }
  std::vector<std::byte> out_;
  std::uint8_t previous_ = 0;
};

}  // namespace

std::vector<std::byte> pack(std::span<const std::uint8_t> pixels) {
  Packer packer;
  for (auto at = pixels.begin(); at != pixels.end();) {
    const std::uint8_t value = *at;
    const auto end = std::find_if(at, pixels.end(), [value](std::uint8_t v) { return v != value; });
    packer.add(value, static_cast<std::size_t>(end - at));
    at = end;
  }
  return std::move(packer).finish();
}

Result<std::vector<std::uint8_t>> unpack(std::span<const std::byte> data, std::size_t count) {
  const auto bad = [](std::size_t at, std::string_view what) {
    return fail(ErrorCode::InvalidInput, fmt::format("byte {} of its packed pixels: {}", at, what));
  };
  if (data.size() < 2 || data.front() != kBegin) return bad(0, "they do not begin with 0x55");
  if (checksum(data.subspan(1, data.size() - 2)) != data.back())
    return bad(data.size() - 1, "the checksum does not hold; the file is damaged, copy it again");
  const auto chunks = data.first(data.size() - 1);
  std::vector<std::uint8_t> pixels;
  pixels.reserve(count);
  std::uint8_t value = 0;
  for (std::size_t at = 1; at < chunks.size();) {
    const std::size_t begin = at;
    const auto first = std::to_integer<std::uint8_t>(chunks[at++]);
    const auto kind = static_cast<Kind>(first >> 6U);
    const unsigned further = (first >> 4U) & 3U;
    const unsigned with_value = kind == kGrey ? 1 : 0;
    const unsigned needs = kind == kDifference ? further & 1U : with_value + further;
    if (chunks.size() - at < needs) return bad(begin, "the last chunk is cut off");
    std::size_t run = 1;
    if (kind == kDifference) {
      const int size = first & 0xF;
      const int step = (further & 2U) != 0 ? -size : size;
      if (int{value} + step < 0 || int{value} + step > 255)
        return bad(begin, "a difference leads below 0 or above 255");
      value = static_cast<std::uint8_t>(int{value} + step);
      if (needs == 1) run = std::to_integer<std::uint8_t>(chunks[at++]);
    } else {
      value = kind == kGrey ? std::to_integer<std::uint8_t>(chunks[at++]) : kind == kBlack ? 0 : 255;
      run = 0;
      for (unsigned i = 0; i < further; ++i) run = run << 8U | std::to_integer<std::uint8_t>(chunks[at++]);
      run = run << 4U | (first & 0xFU);
    }
    if (run == 0) return bad(begin, "a run of no pixels");
    if (run > count - pixels.size()) return bad(begin, fmt::format("more pixels than the frame has, {}", count));
    pixels.insert(pixels.end(), run, value);
  }
  if (pixels.size() != count)
    return bad(chunks.size(), fmt::format("{} pixels, where the frame has {}", pixels.size(), count));
  return pixels;
}

}  // namespace telefab::fab::goo
