// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <telefab/fab/mask/orientation.hpp>
#include <telefab/fab/screen/packing.hpp>
#include <vector>

namespace telefab::fab {

namespace {

constexpr std::uint32_t kFull = 255;
/// Rows of a mask on its side that are gathered at once: as many cache lines as a core keeps near.
constexpr std::uint32_t kTileRows = 64;
constexpr std::size_t kCacheLine_bytes = 64;

bool is_on_its_side(ScreenTurn turn) { return turn == ScreenTurn::Quarter || turn == ScreenTurn::ThreeQuarters; }

PixelSize turned_size(PixelSize mask, ScreenTurn turn) {
  return is_on_its_side(turn) ? PixelSize{mask.height_px, mask.width_px} : mask;
}

/// Where the pixels of the turned mask lie in the mask's rows: at first + x * across + y * down.
struct Walk {
  std::ptrdiff_t first = 0, across = 0, down = 0;
};

Walk walk_of(PixelSize mask, OpticsTurn optics, ScreenTurn turn) {
  const auto w = static_cast<std::ptrdiff_t>(mask.width_px), h = static_cast<std::ptrdiff_t>(mask.height_px);
  const Orientation mirrors = orientation_of(optics);
  const auto place = [&](std::ptrdiff_t x, std::ptrdiff_t y) {
    std::ptrdiff_t column = x, row = y;
    if (turn == ScreenTurn::Quarter) column = y, row = h - 1 - x;
    if (turn == ScreenTurn::Half) column = w - 1 - x, row = h - 1 - y;
    if (turn == ScreenTurn::ThreeQuarters) column = w - 1 - y, row = x;
    if (mirrors.mirrors_x) column = w - 1 - column;
    if (mirrors.mirrors_y) row = h - 1 - row;
    return row * w + column;
  };
  const std::ptrdiff_t first = place(0, 0);
  return {first, place(1, 0) - first, place(0, 1) - first};
}

/// The nearest of as many levels, as its number.
std::array<std::uint16_t, 256> levels_of(std::uint32_t greys) {
  std::array<std::uint16_t, 256> levels{};
  for (std::uint32_t v = 0; v <= kFull; ++v)
    levels[v] = static_cast<std::uint16_t>((v * (greys - 1) + kFull / 2) / kFull);
  return levels;
}

/// Eight rows of eight bytes become eight columns: quarters change places, then their quarters, then bytes.
void transpose(std::array<std::uint64_t, 8>& rows) {
  const auto swap = [&](std::size_t a, std::size_t b, int bits, std::uint64_t mask) {
    const std::uint64_t other = ((rows[a] >> bits) ^ rows[b]) & mask;
    rows[b] ^= other;
    rows[a] ^= other << bits;
  };
  for (const std::size_t k : {0u, 1u, 2u, 3u}) swap(k, k + 4, 32, 0x00000000FFFFFFFF);
  for (const std::size_t k : {0u, 1u, 4u, 5u}) swap(k, k + 2, 16, 0x0000FFFF0000FFFF);
  for (const std::size_t k : {0u, 2u, 4u, 6u}) swap(k, k + 1, 8, 0x00FF00FF00FF00FF);
}

/// Some rows of a mask on its side: row i at `to + i * stride`, its pixel x from `from + x * across + i * down`, down
/// being 1 or -1.
void gather(const std::uint8_t* from, const Walk& walk, std::uint32_t width, std::uint32_t many, std::uint8_t* to,
            std::size_t stride) {
  constexpr std::uint32_t kBlock = 8;
  const std::uint32_t whole_x = width - width % kBlock, whole_i = many - many % kBlock;
  for (std::uint32_t x = 0; x < whole_x; x += kBlock)
    for (std::uint32_t i = 0; i < whole_i; i += kBlock) {
      std::array<std::uint64_t, kBlock> block{};
      const std::uint8_t* corner = from + x * walk.across + i * walk.down;
      for (std::uint32_t k = 0; k < kBlock; ++k, corner += walk.across) {
        std::memcpy(&block[k], walk.down == 1 ? corner : corner - (kBlock - 1), kBlock);
        if (walk.down != 1) block[k] = __builtin_bswap64(block[k]);
      }
      transpose(block);
      for (std::uint32_t k = 0; k < kBlock; ++k) std::memcpy(to + (i + k) * stride + x, &block[k], kBlock);
    }
  for (std::uint32_t i = 0; i < many; ++i)
    for (std::uint32_t x = i < whole_i ? whole_x : 0; x < width; ++x)
      to[i * stride + x] = from[x * walk.across + i * walk.down];
}

void pack_grey(std::span<const std::uint8_t> row, std::byte* out) {
  for (const std::uint8_t v : row) {
    const std::uint32_t word = v * 0x010101u;
    std::memcpy(out, &word, sizeof word);
    out += sizeof word;
  }
}

void pack_colours(std::span<const std::uint8_t> row, bool first_in_red, std::byte* out) {
  for (std::size_t x = 0; x < row.size(); x += 3) {
    const std::uint32_t a = row[x], b = row[x + 1], c = row[x + 2];
    const std::uint32_t word = first_in_red ? a << 16 | b << 8 | c : c << 16 | b << 8 | a;
    std::memcpy(out, &word, sizeof word);
    out += sizeof word;
  }
}

/// `middle_bits`: of the second pixel; the others have five.
void pack_bits(std::span<const std::uint8_t> row, int middle_bits, std::byte* out) {
  static const auto kFive = levels_of(32), kSix = levels_of(64);
  const auto& middle = middle_bits == 6 ? kSix : kFive;
  for (std::size_t x = 0; x < row.size(); x += 3) {
    const auto word =
        static_cast<std::uint16_t>(kFive[row[x]] << (middle_bits + 5) | middle[row[x + 1]] << 5 | kFive[row[x + 2]]);
    std::memcpy(out, &word, sizeof word);
    out += sizeof word;
  }
}

void pack_row(std::span<const std::uint8_t> row, PixelPacking packing, std::byte* out) {
  switch (packing) {
    case PixelPacking::Grey:
      return pack_grey(row, out);
    case PixelPacking::Rgb:
      return pack_colours(row, true, out);
    case PixelPacking::Bgr:
      return pack_colours(row, false, out);
    case PixelPacking::Bits565:
      return pack_bits(row, 6, out);
    case PixelPacking::Bits555:
      return pack_bits(row, 5, out);
  }
}

}  // namespace

std::uint32_t pixels_per_word(PixelPacking packing) { return packing == PixelPacking::Grey ? 1 : 3; }

std::uint32_t bytes_per_word(PixelPacking packing) {
  return packing == PixelPacking::Bits565 || packing == PixelPacking::Bits555 ? 2 : 4;
}

PixelSize panel_pixels(const PanelLayout& layout) {
  return {layout.words.width_px * pixels_per_word(layout.packing), layout.words.height_px};
}

std::array<std::uint32_t, 3> greys_of(PixelPacking packing) {
  if (packing == PixelPacking::Bits565) return {32, 64, 32};
  if (packing == PixelPacking::Bits555) return {32, 32, 32};
  return {256, 256, 256};
}

Result<void> check_fits(PixelSize mask, const PanelLayout& layout) {
  const PixelSize turned = turned_size(mask, layout.turn), panel = panel_pixels(layout);
  if (turned.width_px == 0 || turned.height_px == 0) return fail(ErrorCode::InvalidInput, "screen: an empty mask");
  if (turned.width_px > panel.width_px || turned.height_px > panel.height_px)
    return fail(ErrorCode::InvalidInput,
                fmt::format("screen: masks of {} x {} pixels, turned by {} degrees, are larger than its panel of {} x "
                            "{}; correct screen.rotation, width_px, height_px or packing, or the platform's size",
                            mask.width_px, mask.height_px, name_of(layout.turn), panel.width_px, panel.height_px));
  if (turned.width_px % pixels_per_word(layout.packing) != 0)
    return fail(ErrorCode::InvalidInput,
                fmt::format("screen: {} pixels across are not whole words of three (screen.packing = \"{}\"); make the "
                            "platform one or two pixels narrower",
                            turned.width_px, name_of(layout.packing)));
  return {};
}

Result<void> pack_mask(const MaskView& mask, const PanelLayout& layout, std::span<std::byte> out,
                       std::size_t pitch_bytes) {
  if (const auto fits = check_fits(mask.size, layout); !fits) return fits;
  const std::size_t row_bytes = std::size_t{layout.words.width_px} * bytes_per_word(layout.packing);
  if (mask.rows.size() != std::size_t{mask.size.width_px} * mask.size.height_px)
    return fail(ErrorCode::InvalidInput, "screen: the mask has not as many pixels as it says");
  if (pitch_bytes < row_bytes || out.size() < pitch_bytes * (layout.words.height_px - 1) + row_bytes)
    return fail(ErrorCode::InvalidInput, "screen: the frame is smaller than its words");

  const PixelSize panel = panel_pixels(layout), turned = turned_size(mask.size, layout.turn);
  const std::uint32_t left = (panel.width_px - turned.width_px) / 2, top = (panel.height_px - turned.height_px) / 2;
  const Walk walk = walk_of(mask.size, layout.optics, layout.turn);
  const std::uint8_t* pixels = mask.rows.data();
  const std::size_t width = panel.width_px;
  // An odd number of cache lines: rows of a round length would all want the same place in the cache.
  const std::size_t stride = ((width / kCacheLine_bytes + 1) | 1) * kCacheLine_bytes;
  const std::uint32_t tile = is_on_its_side(layout.turn) ? kTileRows : 1;
  std::vector<std::uint8_t> rows(stride * tile);  // dark at both sides of the mask
  for (std::uint32_t y = 0; y < turned.height_px; y += tile) {
    const std::uint32_t many = std::min(tile, turned.height_px - y);
    const std::uint8_t* from = pixels + walk.first + y * walk.down;
    if (walk.across == 1) {
      std::copy_n(from, turned.width_px, rows.data() + left);
    } else if (walk.across == -1) {
      std::reverse_copy(from - (turned.width_px - 1), from + 1, rows.data() + left);
    } else {
      gather(from, walk, turned.width_px, many, rows.data() + left, stride);
    }
    for (std::uint32_t i = 0; i < many; ++i)
      pack_row({rows.data() + i * stride, width}, layout.packing, out.data() + (top + y + i) * pitch_bytes);
  }
  const auto darken = [&](std::uint32_t row) { std::fill_n(out.data() + row * pitch_bytes, row_bytes, std::byte{0}); };
  for (std::uint32_t row = 0; row < top; ++row) darken(row);
  for (std::uint32_t row = top + turned.height_px; row < panel.height_px; ++row) darken(row);
  return {};
}

}  // namespace telefab::fab
