// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>
#include <string_view>
#include <telefab/image/png.hpp>

namespace telefab {

struct Colour {
  std::uint8_t red = 0;
  std::uint8_t green = 0;
  std::uint8_t blue = 0;
};

/// A place on a canvas: pixels from the left and from the top, (0, 0) is the corner of the first pixel.
struct PixelPoint {
  double x_px = 0;
  double y_px = 0;
};

/// Draws anti-aliased shapes for pictures that people look at. What lies outside is cut off.
class Canvas {
 public:
  /// Sides of 1 to 16384 pixels; others are clamped into that.
  Canvas(std::uint32_t width_px, std::uint32_t height_px, Colour background);
  ~Canvas();
  Canvas(Canvas&&) noexcept;
  Canvas& operator=(Canvas&&) noexcept;

  void line(PixelPoint from, PixelPoint to, Colour colour, int width_px);
  void disc(PixelPoint centre, double radius_px, Colour colour);
  void circle(PixelPoint centre, double radius_px, Colour colour, int width_px);
  /// Fills what an odd number of rings surrounds: outer rings with their holes in one call.
  void fill(std::span<const std::vector<PixelPoint>> rings, Colour colour);
  void outline(std::span<const PixelPoint> ring, Colour colour, int width_px);
  /// `at` is the left end of the base line, `height_px` that of capitals. UTF-8: Latin, Greek and Cyrillic letters show
  /// as they are, characters of other scripts as a replacement, control characters as '?'.
  void text(PixelPoint at, std::string_view text, Colour colour, double height_px);
  /// Copies an image, grey or RGB, shrunk by area or enlarged to the given size, to the rectangle whose upper left
  /// corner is `at`.
  void paste(const Image& image, PixelPoint at, std::uint32_t width_px, std::uint32_t height_px);

  /// The picture so far, RGB.
  [[nodiscard]] Image image() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// How far a text of that height reaches to the right on a canvas.
[[nodiscard]] double text_width_px(std::string_view text, double height_px);

/// The image shrunk by area so that its longer side has `most_px` (at least 1); itself where it is no larger.
[[nodiscard]] Image shrunk_to(Image image, std::uint32_t most_px);

/// Pictures side by side with a label below each, `columns` in a row, all scaled to fit `tile_px` squares.
[[nodiscard]] Image contact_sheet(std::span<const Image> tiles, std::span<const std::string> labels,
                                  std::uint32_t columns, std::uint32_t tile_px);

}  // namespace telefab
