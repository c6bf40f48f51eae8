// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <libdeflate.h>
#include <spng.h>

#include <cstring>
#include <memory>
#include <telefab/image/png.hpp>

#include "run_deflate.hpp"

namespace telefab {
namespace {

constexpr int kDeflateLevel = 1;
constexpr std::uint32_t kMaxSide = 1U << 24U;

void put_number(std::vector<std::byte>& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8)
    out.push_back(static_cast<std::byte>(value >> static_cast<unsigned>(shift)));
}

/// Writes length and type, lets `body` append, and closes with the checksum over type and body.
template <class Body>
void put_chunk(std::vector<std::byte>& out, std::string_view type, const Body& body) {
  const std::size_t start = out.size();
  put_number(out, 0);
  for (const char c : type) out.push_back(static_cast<std::byte>(c));
  body();
  const std::size_t length = out.size() - start - 8;
  for (unsigned i = 0; i < 4; ++i) out[start + i] = static_cast<std::byte>(length >> (24 - 8 * i));
  put_number(out, libdeflate_crc32(0, out.data() + start + 4, length + 4));
}

/// Rows led by their filter number, 0, as a zlib stream.
Result<std::vector<std::byte>> deflate_rows(std::span<const std::uint8_t> pixels, std::size_t row) {
  if (auto packed = deflate_runs(pixels, row)) return std::move(*packed);
  const std::size_t height = pixels.size() / row;
  std::vector<std::uint8_t> raw((row + 1) * height);
  for (std::size_t y = 0; y < height; ++y) std::memcpy(raw.data() + y * (row + 1) + 1, pixels.data() + y * row, row);
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> deflater{
      libdeflate_alloc_compressor(kDeflateLevel), &libdeflate_free_compressor};
  if (!deflater) return fail(ErrorCode::Internal, "no memory to compress an image");
  std::vector<std::byte> packed(libdeflate_zlib_compress_bound(deflater.get(), raw.size()));
  packed.resize(libdeflate_zlib_compress(deflater.get(), raw.data(), raw.size(), packed.data(), packed.size()));
  return packed;
}

Result<std::vector<std::byte>> encode(std::uint32_t width, std::uint32_t height, std::uint32_t channels,
                                      std::span<const std::uint8_t> pixels) {
  const std::uint64_t row = std::uint64_t{width} * channels;
  if (width == 0 || height == 0 || width > kMaxSide || height > kMaxSide || (channels != 1 && channels != 3) ||
      row * height != pixels.size())
    return fail(ErrorCode::InvalidInput, fmt::format("an image of {} x {} pixels and {} channels cannot have {} bytes",
                                                     width, height, channels, pixels.size()));
  const auto packed = deflate_rows(pixels, row);
  if (!packed) return tl::unexpected{packed.error()};

  std::vector<std::byte> out;
  out.reserve(packed->size() + 64);
  for (const unsigned c : {0x89U, 0x50U, 0x4eU, 0x47U, 0x0dU, 0x0aU, 0x1aU, 0x0aU})
    out.push_back(static_cast<std::byte>(c));
  put_chunk(out, "IHDR", [&] {
    put_number(out, width);
    put_number(out, height);
    for (const unsigned value : {8U, channels == 1 ? 0U : 2U, 0U, 0U, 0U}) out.push_back(static_cast<std::byte>(value));
  });
  put_chunk(out, "IDAT", [&] { out.insert(out.end(), packed->begin(), packed->end()); });
  put_chunk(out, "IEND", [] {});
  return out;
}

}  // namespace

Result<std::vector<std::byte>> encode_png(const Image& image) {
  return encode(image.width_px, image.height_px, image.channels, image.pixels);
}

Result<std::vector<std::byte>> encode_png_grey(std::uint32_t width_px, std::uint32_t height_px,
                                               std::span<const std::uint8_t> pixels) {
  return encode(width_px, height_px, 1, pixels);
}

Result<Image> decode_png(std::span<const std::byte> bytes, std::uint64_t max_pixels) {
  const std::unique_ptr<spng_ctx, decltype(&spng_ctx_free)> context{spng_ctx_new(0), &spng_ctx_free};
  if (!context) return fail(ErrorCode::Internal, "no memory to read an image");
  const auto bad = [](int code) {
    return fail(ErrorCode::InvalidInput, fmt::format("not a readable PNG image: {}", spng_strerror(code)));
  };
  spng_set_crc_action(context.get(), SPNG_CRC_ERROR, SPNG_CRC_ERROR);
  spng_set_image_limits(context.get(), kMaxSide, kMaxSide);
  spng_set_chunk_limits(context.get(), 1U << 20U, 4U << 20U);
  if (const int code = spng_set_png_buffer(context.get(), bytes.data(), bytes.size())) return bad(code);
  spng_ihdr header{};
  if (const int code = spng_get_ihdr(context.get(), &header)) return bad(code);
  if (std::uint64_t{header.width} * header.height > max_pixels)
    return fail(ErrorCode::TooLarge, fmt::format("an image of {} x {} pixels; at most {} are allowed here",
                                                 header.width, header.height, max_pixels));
  const bool grey = header.color_type == SPNG_COLOR_TYPE_GRAYSCALE && header.bit_depth <= 8;
  const int format = grey ? SPNG_FMT_G8 : SPNG_FMT_RGB8;
  std::size_t size = 0;
  if (const int code = spng_decoded_image_size(context.get(), format, &size)) return bad(code);
  Image image{header.width, header.height, grey ? 1U : 3U, std::vector<std::uint8_t>(size)};
  if (const int code = spng_decode_image(context.get(), image.pixels.data(), size, format, 0)) return bad(code);
  // Only on the way to the end of the file is the checksum of the last pixels compared.
  if (const int code = spng_decode_chunks(context.get())) return bad(code);
  return image;
}

}  // namespace telefab
