// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cstdlib>
#include <telefab/wire/frame.hpp>

namespace {

struct Taken {
  std::vector<telefab::Frame> frames;
  bool broken = false;
  bool operator==(const Taken&) const = default;
};

/// All frames of the bytes, fed in pieces; the first byte sets how long the pieces are.
Taken take_all(std::span<const std::byte> bytes, std::size_t piece) {
  telefab::FrameReader reader{1U << 16U};
  Taken taken;
  while (!bytes.empty() && !taken.broken) {
    const auto part = bytes.first(std::min(piece, bytes.size()));
    reader.feed(part);
    bytes = bytes.subspan(part.size());
    while (true) {
      auto frame = reader.take();
      taken.broken = !frame;
      if (!frame || !*frame) break;
      taken.frames.push_back(std::move(**frame));
    }
  }
  return taken;
}

}  // namespace

// The first byte, then a stream: the same frames however it is split, each written back to what was read.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::span bytes{reinterpret_cast<const std::byte*>(data) + 1, size - 1};
  const Taken whole = take_all(bytes, bytes.size() + 1);
  if (!(take_all(bytes, std::size_t{1} + data[0] % 32U) == whole)) std::abort();
  std::size_t at = 0;
  for (const telefab::Frame& frame : whole.frames) {
    const auto again = telefab::to_bytes(frame);
    if (!again || !std::equal(again->begin(), again->end(), bytes.begin() + static_cast<std::ptrdiff_t>(at)))
      std::abort();
    at += again->size();
  }
  return 0;
}
