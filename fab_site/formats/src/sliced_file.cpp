// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <telefab/fab/formats/sliced_file.hpp>
#include <telefab/image/png.hpp>

#include "goo_layout.hpp"
#include "sliced_readers.hpp"

namespace telefab::fab {
namespace {

constexpr std::array<std::string_view, 3> kFormats{"sl1", "nanodlp", "goo"};
constexpr std::array<std::string_view, 11> kValues{"pixel-pitch",
                                                   "model",
                                                   "mirroring",
                                                   "exposure",
                                                   "lift",
                                                   "lower-speed",
                                                   "wait-before-exposure",
                                                   "wait-after-exposure",
                                                   "wait-after-lift",
                                                   "slow-tilts",
                                                   "printer-profile"};

bool begins_with(std::span<const std::byte> bytes, std::string_view text) {
  return bytes.size() >= text.size() && std::equal(text.begin(), text.end(), bytes.begin(),
                                                   [](char c, std::byte b) { return static_cast<std::byte>(c) == b; });
}

}  // namespace

std::string_view name_of(SlicedFormat format) { return kFormats.at(static_cast<std::size_t>(format)); }
std::string_view name_of(SlicedValue value) { return kValues.at(static_cast<std::size_t>(value)); }

bool SlicedJob::lacks(SlicedValue value) const {
  return std::find(absent.begin(), absent.end(), value) != absent.end();
}

std::optional<SlicedFormat> sliced_format_of(std::span<const std::byte> bytes) {
  if (begins_with(bytes, goo::kVersion)) return SlicedFormat::Goo;
  if (!begins_with(bytes, "PK")) return std::nullopt;
  const auto archive = ZipReader::open(bytes);
  if (!archive) return std::nullopt;
  if (archive->has("config.ini")) return SlicedFormat::Sl1;
  if (archive->has("plate.json") && archive->has("meta.json")) return SlicedFormat::NanoDlp;
  return std::nullopt;
}

Result<std::unique_ptr<SlicedFile>> read_sliced_file(std::span<const std::byte> bytes) {
  const auto format = sliced_format_of(bytes);
  if (!format)
    return fail(ErrorCode::InvalidInput,
                "the file is none of GOO, SL1 (a zip archive with config.ini) and NanoDLP (one with plate.json)");
  if (*format == SlicedFormat::Goo) return read_goo(bytes);
  auto archive = ZipReader::open(bytes);
  if (!archive) return tl::unexpected{archive.error()};
  return *format == SlicedFormat::Sl1 ? read_sl1(std::move(*archive)) : read_nanodlp(std::move(*archive));
}

double stepped_exposure_s(std::uint32_t layer, std::uint32_t bottom_layers, std::uint32_t steps, double bottom_s,
                          double normal_s) {
  if (layer < bottom_layers) return bottom_s;
  if (layer - bottom_layers >= steps) return normal_s;
  const double share = (layer - bottom_layers + 1.0) / (steps + 1.0);
  return bottom_s * (1 - share) + normal_s * share;
}

Result<Mask> grey_mask(const std::string& png, std::optional<PixelSize> expected, std::string_view name) {
  auto image = decode_png(std::as_bytes(std::span{png}), kMostSlicedPixels);
  if (!image) return fail_in(name, image.error());
  if (image->channels != 1)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} is coloured; masks are grey. Pictures that pack several pixels of a panel into one "
                            "colour are not read",
                            name));
  Mask mask{{image->width_px, image->height_px}, std::move(image->pixels)};
  if (expected && mask.size != *expected)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} has {} x {} pixels, where the first layer has {} x {}", name, mask.size.width_px,
                            mask.size.height_px, expected->width_px, expected->height_px));
  return mask;
}

}  // namespace telefab::fab
