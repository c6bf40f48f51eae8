// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <telefab/fab/drivers/dlpc900_image.hpp>

namespace telefab::fab {

namespace {

constexpr std::uint32_t kLongestCount = 32767;
/// A run or copy shorter than this costs more than it saves inside raw pixels.
constexpr std::uint32_t kWorthBreaking = 3;
constexpr std::string_view kSignature = "Spld";
constexpr std::uint8_t kPixelFormat24Bit = 1;
constexpr std::uint8_t kEnhancedRunLength = 2;

void append_u16(std::vector<std::byte>& out, std::uint32_t v) {
  out.push_back(std::byte(v & 0xFF));
  out.push_back(std::byte(v >> 8 & 0xFF));
}

void append_pixel(std::vector<std::byte>& out, std::uint8_t grey) { out.insert(out.end(), 3, std::byte{grey}); }

/// Pixels from x on that are equal to the first, at most `most`.
std::uint32_t run_at(const std::uint8_t* row, std::uint32_t x, std::uint32_t most) {
  const std::uint64_t eight = 0x0101010101010101ULL * row[x];
  std::uint32_t n = 1;
  for (std::uint64_t word = 0; n + 8 <= most; n += 8) {
    std::memcpy(&word, row + x + n, 8);
    if (word != eight) break;
  }
  while (n < most && row[x + n] == row[x]) ++n;
  return n;
}

/// Pixels from x on that are equal to the row above, at most `most`.
std::uint32_t match_at(const std::uint8_t* row, const std::uint8_t* above, std::uint32_t x, std::uint32_t most) {
  std::uint32_t n = 0;
  for (std::uint64_t a = 0, b = 0; n + 8 <= most; n += 8) {
    std::memcpy(&a, row + x + n, 8);
    std::memcpy(&b, above + x + n, 8);
    if (a != b) break;
  }
  while (n < most && row[x + n] == above[x + n]) ++n;
  return n;
}

void encode_row(std::vector<std::byte>& out, const std::uint8_t* row, const std::uint8_t* above, std::uint32_t width) {
  std::uint32_t x = 0;
  while (x < width) {
    const std::uint32_t most = std::min(width - x, kLongestCount);
    const std::uint32_t copy = above != nullptr ? match_at(row, above, x, most) : 0;
    const std::uint32_t run = run_at(row, x, most);
    if (copy >= kWorthBreaking && copy >= run) {
      out.insert(out.end(), {std::byte{0}, std::byte{1}});
      append_count(out, copy);
      x += copy;
    } else if (run >= kWorthBreaking) {
      append_count(out, run);
      append_pixel(out, row[x]);
      x += run;
    } else {
      std::uint32_t raw = 1;
      while (raw < most) {
        const std::uint32_t at = x + raw;
        const std::uint32_t look = std::min(width - at, kWorthBreaking);
        if (look == kWorthBreaking &&
            (run_at(row, at, look) == look || (above != nullptr && match_at(row, above, at, look) == look)))
          break;
        ++raw;
      }
      if (raw == 1) {
        append_count(out, 1);
      } else {
        out.push_back(std::byte{0});
        append_count(out, raw);
      }
      for (std::uint32_t i = 0; i < raw; ++i) append_pixel(out, row[x + i]);
      x += raw;
    }
  }
}

/// Reads coded bytes; `broken` once something was missing.
class Reader {
 public:
  explicit Reader(std::span<const std::byte> bytes) : bytes_{bytes} {}
  [[nodiscard]] std::uint8_t byte() {
    if (at_ == bytes_.size()) {
      broken_ = true;
      return 0;
    }
    return static_cast<std::uint8_t>(bytes_[at_++]);
  }
  /// A count whose first byte is known.
  [[nodiscard]] std::uint32_t count(std::uint8_t first) {
    return first < 128 ? first : (first & 127u) | static_cast<std::uint32_t>(byte()) << 7;
  }
  [[nodiscard]] bool broken() const { return broken_; }
  [[nodiscard]] std::size_t left() const { return bytes_.size() - at_; }

 private:
  std::span<const std::byte> bytes_;
  std::size_t at_ = 0;
  bool broken_ = false;
};

tl::unexpected<Error> bad(std::string_view what) {
  return fail(ErrorCode::InvalidInput, fmt::format("coded image: {}", what));
}

}  // namespace

void append_count(std::vector<std::byte>& out, std::uint32_t n) {
  if (n < 128) {
    out.push_back(std::byte(n));
  } else {
    out.push_back(std::byte((n & 127) | 128));
    out.push_back(std::byte(n >> 7));
  }
}

std::vector<std::byte> encode_dlpc900_image(const MaskView& mask) {
  const auto [width, height] = mask.size;
  std::vector<std::byte> out;
  out.reserve(kSplashHeaderBytes + 64 * std::size_t{height});
  for (const char c : kSignature) out.push_back(std::byte(c));
  append_u16(out, width);
  append_u16(out, height);
  out.resize(12);  // size, filled in below
  out.resize(20, std::byte{0xFF});
  out.resize(kSplashHeaderBytes);
  out[24] = std::byte{kPixelFormat24Bit};
  out[25] = std::byte{kEnhancedRunLength};
  out[26] = std::byte{1};  // byte order
  out[29] = std::byte{1};
  for (std::uint32_t y = 0; y < height; ++y) {
    const std::uint8_t* row = mask.rows.data() + std::size_t{y} * width;
    encode_row(out, row, y == 0 ? nullptr : row - width, width);
  }
  out.insert(out.end(), {std::byte{0}, std::byte{1}, std::byte{0}});
  out.resize((out.size() + 3) / 4 * 4);
  const auto size = static_cast<std::uint32_t>(out.size() - kSplashHeaderBytes);
  for (std::size_t i = 0; i < 4; ++i) out[8 + i] = std::byte(size >> (8 * i) & 0xFF);
  return out;
}

Result<Mask> decode_dlpc900_image(std::span<const std::byte> image) {
  if (image.size() < kSplashHeaderBytes) return bad("no whole header");
  const auto at = [&](std::size_t i) { return static_cast<std::uint32_t>(image[i]); };
  if (std::memcmp(image.data(), kSignature.data(), kSignature.size()) != 0) return bad("wrong signature");
  if (at(24) != kPixelFormat24Bit || at(25) != kEnhancedRunLength || at(26) != 1)
    return bad("not 24 bits with enhanced run lengths");
  Mask mask;
  mask.size = {at(4) | at(5) << 8, at(6) | at(7) << 8};
  const std::uint32_t size = at(8) | at(9) << 8 | at(10) << 16 | at(11) << 24;
  if (size != image.size() - kSplashHeaderBytes) return bad("the size in the header is not the size sent");
  const std::uint32_t width = mask.size.width_px;
  if (width == 0 || mask.size.height_px == 0 || width > 4096 || mask.size.height_px > 4096)
    return bad("impossible width or height");
  const std::size_t pixels = std::size_t{width} * mask.size.height_px;
  mask.rows.reserve(pixels);
  Reader in{image.subspan(kSplashHeaderBytes)};
  const auto pixel = [&] {
    const std::uint8_t r = in.byte(), g = in.byte(), b = in.byte();
    return r == g && g == b ? std::optional{r} : std::nullopt;
  };
  const auto room = [&](std::uint32_t n) { return n > 0 && n <= pixels - mask.rows.size(); };
  while (true) {
    const std::uint8_t first = in.byte();
    if (in.broken()) return bad("ends before its end");
    if (first != 0) {
      const std::uint32_t n = in.count(first);
      const auto grey = pixel();
      if (in.broken() || !grey || !room(n)) return bad("a run is cut off, coloured or too long");
      mask.rows.insert(mask.rows.end(), n, *grey);
      continue;
    }
    const std::uint8_t second = in.byte();
    if (second == 0) {
      while (mask.rows.size() % width != 0) mask.rows.push_back(0);
      continue;
    }
    if (second == 1) {
      const std::uint8_t third = in.byte();
      if (third == 0) break;
      const std::uint32_t n = in.count(third);
      if (in.broken() || !room(n) || mask.rows.size() < width)
        return bad("a copy is cut off, too long or has no row above");
      const std::size_t from = mask.rows.size() - width;
      mask.rows.resize(mask.rows.size() + n);
      std::uint8_t* to = mask.rows.data() + from + width;
      for (std::uint32_t i = 0; i < n; ++i) to[i] = mask.rows[from + i];
      continue;
    }
    const std::uint32_t n = in.count(second);
    if (!room(n)) return bad("raw pixels past the end");
    for (std::uint32_t i = 0; i < n; ++i) {
      const auto grey = pixel();
      if (in.broken() || !grey) return bad("raw pixels cut off or coloured");
      mask.rows.push_back(*grey);
    }
  }
  if (in.broken() || mask.rows.size() != pixels) return bad("not all pixels were given");
  if (in.left() > 3) return bad("bytes behind its end");
  return mask;
}

}  // namespace telefab::fab
