// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <telefab/image/canvas.hpp>
#include <vector>

#include "font.hpp"

namespace telefab {
namespace {

constexpr int kShift = 6;  // OpenCV draws at 1/64 pixel
constexpr std::uint32_t kMaxSide = 16384;
constexpr double kEmUnits = 1000;  ///< outlines are in thousandths
constexpr double kAscent = 1.2;    ///< of the em, with room for marks on capitals
constexpr double kDescent = 0.3;
constexpr int kOversample = 6;

cv::Scalar scalar(Colour c) {
  return {static_cast<double>(c.red), static_cast<double>(c.green), static_cast<double>(c.blue)};
}

/// OpenCV's pixel centres lie on whole numbers, ours half a pixel farther. Far points are pulled in, so that they fit
/// its fixed-point numbers.
cv::Point fixed(PixelPoint p) {
  const auto number = [](double v) {
    return static_cast<int>(std::lround(std::clamp(v - 0.5, -30000.0, 30000.0) * (1 << kShift)));
  };
  return {number(p.x_px), number(p.y_px)};
}

double width_of(const std::vector<const Glyph*>& glyphs, double em_px) {
  double advance = 0;
  for (const Glyph* glyph : glyphs) advance += glyph->advance;
  return em_px * advance / kEmUnits;
}

}  // namespace

struct Canvas::Impl {
  cv::Mat picture;
};

Canvas::Canvas(std::uint32_t width_px, std::uint32_t height_px, Colour background) : impl_{std::make_unique<Impl>()} {
  impl_->picture = cv::Mat(static_cast<int>(std::clamp(height_px, 1U, kMaxSide)),
                           static_cast<int>(std::clamp(width_px, 1U, kMaxSide)), CV_8UC3, scalar(background));
}
Canvas::~Canvas() = default;
Canvas::Canvas(Canvas&&) noexcept = default;
Canvas& Canvas::operator=(Canvas&&) noexcept = default;

void Canvas::line(PixelPoint from, PixelPoint to, Colour colour, int width_px) {
  cv::line(impl_->picture, fixed(from), fixed(to), scalar(colour), std::clamp(width_px, 1, 1000), cv::LINE_AA, kShift);
}

void Canvas::disc(PixelPoint centre, double radius_px, Colour colour) {
  cv::circle(impl_->picture, fixed(centre),
             static_cast<int>(std::lround(std::clamp(radius_px, 0.0, 20000.0) * (1 << kShift))), scalar(colour),
             cv::FILLED, cv::LINE_AA, kShift);
}

void Canvas::circle(PixelPoint centre, double radius_px, Colour colour, int width_px) {
  // A thick line is drawn piece by piece, and the pieces' ends would show as beads: a ring between two circles is not.
  if (width_px > 1 && radius_px > width_px && radius_px < 20000 && std::isfinite(centre.x_px) &&
      std::isfinite(centre.y_px)) {
    const int corners = std::clamp(static_cast<int>(radius_px), 24, 720);
    std::array<std::vector<PixelPoint>, 2> rings;
    for (std::size_t r = 0; r < 2; ++r)
      for (int i = 0; i < corners; ++i) {
        const double angle = 2 * std::numbers::pi * i / corners,
                     radius = radius_px + (r == 0 ? 0.5 : -0.5) * (width_px - 1);
        rings[r].push_back({centre.x_px + radius * std::cos(angle), centre.y_px + radius * std::sin(angle)});
      }
    return fill(rings, colour);
  }
  cv::circle(impl_->picture, fixed(centre),
             static_cast<int>(std::lround(std::clamp(radius_px, 0.0, 20000.0) * (1 << kShift))), scalar(colour),
             std::clamp(width_px, 1, 1000), cv::LINE_AA, kShift);
}

void Canvas::fill(std::span<const std::vector<PixelPoint>> rings, Colour colour) {
  std::vector<std::vector<cv::Point>> polygons;
  for (const auto& ring : rings) {
    auto& polygon = polygons.emplace_back();
    for (const PixelPoint p : ring) polygon.push_back(fixed(p));
  }
  std::erase_if(polygons, [](const auto& polygon) { return polygon.size() < 3; });
  if (!polygons.empty()) cv::fillPoly(impl_->picture, polygons, scalar(colour), cv::LINE_AA, kShift);
}

void Canvas::outline(std::span<const PixelPoint> ring, Colour colour, int width_px) {
  for (std::size_t i = 0; i < ring.size(); ++i) line(ring[i], ring[(i + 1) % ring.size()], colour, width_px);
}

void Canvas::text(PixelPoint at, std::string_view text, Colour colour, double height_px) {
  const auto glyphs = glyphs_of(text);
  const double em_px = height_px / kCapHeight * kEmUnits;
  const double width_px = std::min(width_of(glyphs, em_px), static_cast<double>(kMaxSide));
  const int left = static_cast<int>(std::floor(std::clamp(at.x_px, -30000.0, 30000.0))) - 1;
  const int base = static_cast<int>(std::floor(std::clamp(at.y_px, -30000.0, 30000.0)));
  const int above = static_cast<int>(std::ceil(em_px * kAscent)), below = static_cast<int>(std::ceil(em_px * kDescent));
  const cv::Rect wanted{left, base - above, static_cast<int>(std::ceil(width_px)) + 3, above + below};
  const cv::Rect seen = wanted & cv::Rect{0, 0, impl_->picture.cols, impl_->picture.rows};
  if (seen.empty()) return;

  const int times = std::clamp(30000 / wanted.width, 1, kOversample);  // within what fixed() takes
  // Drawn large and shrunk by area: every pixel gets the share that the letter covers.
  cv::Mat large = cv::Mat::zeros(wanted.height * times, wanted.width * times, CV_8UC1);
  double pen_px = at.x_px - left;
  const double base_px = at.y_px - (base - above);
  for (const Glyph* glyph : glyphs) {
    std::vector<std::vector<cv::Point>> rings;
    for (const auto& ring : glyph->rings) {
      auto& points = rings.emplace_back();
      for (const OutlinePoint p : ring)
        points.push_back(
            fixed({(pen_px + em_px * p.x / kEmUnits) * times, (base_px - em_px * p.y / kEmUnits) * times}));
    }
    if (!rings.empty()) cv::fillPoly(large, rings, cv::Scalar{255}, cv::LINE_8, kShift);
    pen_px += em_px * glyph->advance / kEmUnits;
    if (pen_px > width_px + 2) break;
  }
  cv::Mat share;
  cv::resize(large, share, wanted.size(), 0, 0, cv::INTER_AREA);
  const std::array<int, 3> ink{colour.red, colour.green, colour.blue};
  for (int y = seen.y; y < seen.br().y; ++y)
    for (int x = seen.x; x < seen.br().x; ++x) {
      const int covered = share.at<std::uint8_t>(y - wanted.y, x - wanted.x);
      if (covered == 0) continue;
      auto& pixel = impl_->picture.at<cv::Vec3b>(y, x);
      for (int c = 0; c < 3; ++c)
        pixel[c] = static_cast<std::uint8_t>(
            (pixel[c] * (255 - covered) + ink[static_cast<std::size_t>(c)] * covered + 127) / 255);
    }
}

double text_width_px(std::string_view text, double height_px) {
  return width_of(glyphs_of(text), height_px / kCapHeight * kEmUnits);
}

namespace {

/// Of an image that is not empty.
cv::Mat resized(const Image& image, std::uint32_t width_px, std::uint32_t height_px) {
  // The matrix only looks at the pixels and is not written.
  const cv::Mat source(static_cast<int>(image.height_px), static_cast<int>(image.width_px),
                       image.channels == 1 ? CV_8UC1 : CV_8UC3, const_cast<std::uint8_t*>(image.pixels.data()));
  cv::Mat sized;
  cv::resize(source, sized,
             cv::Size{static_cast<int>(std::min(width_px, kMaxSide)), static_cast<int>(std::min(height_px, kMaxSide))},
             0, 0, cv::INTER_AREA);
  return sized;
}

struct Sides {
  std::uint32_t width_px, height_px;
};

/// Those of an image whose longer side is to have so many pixels.
Sides fitted(const Image& image, std::uint32_t most_px) {
  const double scale = static_cast<double>(most_px) / std::max({image.width_px, image.height_px, 1U});
  return {static_cast<std::uint32_t>(std::max(1.0, std::floor(image.width_px * scale))),
          static_cast<std::uint32_t>(std::max(1.0, std::floor(image.height_px * scale)))};
}

}  // namespace

void Canvas::paste(const Image& image, PixelPoint at, std::uint32_t width_px, std::uint32_t height_px) {
  if (image.pixels.empty() || width_px == 0 || height_px == 0) return;
  cv::Mat sized = resized(image, width_px, height_px);
  if (sized.channels() == 1) cv::cvtColor(sized, sized, cv::COLOR_GRAY2RGB);
  const cv::Rect wanted{static_cast<int>(std::lround(at.x_px)), static_cast<int>(std::lround(at.y_px)), sized.cols,
                        sized.rows};
  const cv::Rect seen = wanted & cv::Rect{0, 0, impl_->picture.cols, impl_->picture.rows};
  if (seen.empty()) return;
  sized(seen - wanted.tl()).copyTo(impl_->picture(seen));
}

Image Canvas::image() const {
  const cv::Mat& m = impl_->picture;
  Image image{static_cast<std::uint32_t>(m.cols), static_cast<std::uint32_t>(m.rows), 3, {}};
  image.pixels.assign(m.datastart, m.dataend);
  return image;
}

Image shrunk_to(Image image, std::uint32_t most_px) {
  if (image.pixels.empty() || std::max(image.width_px, image.height_px) <= most_px) return image;
  const auto [width, height] = fitted(image, most_px);
  const cv::Mat sized = resized(image, width, height);
  return {width, height, image.channels, {sized.datastart, sized.dataend}};
}

Image contact_sheet(std::span<const Image> tiles, std::span<const std::string> labels, std::uint32_t columns,
                    std::uint32_t tile_px) {
  constexpr std::uint32_t gap = 8;
  constexpr std::uint32_t label = 22;
  const auto count = static_cast<std::uint32_t>(tiles.size());
  columns = std::clamp(columns, 1U, std::max(count, 1U));
  const std::uint32_t rows = std::max(1U, (count + columns - 1) / columns);
  Canvas canvas{columns * (tile_px + gap) + gap, rows * (tile_px + gap + label) + gap, Colour{250, 250, 249}};
  for (std::uint32_t i = 0; i < count; ++i) {
    const Image& tile = tiles[i];
    const auto [width, height] = fitted(tile, tile_px);
    const PixelPoint corner{static_cast<double>(gap + (i % columns) * (tile_px + gap)),
                            static_cast<double>(gap + (i / columns) * (tile_px + gap + label))};
    canvas.paste(tile, {corner.x_px + (tile_px - width) / 2, corner.y_px + (tile_px - height) / 2}, width, height);
    if (i < labels.size())
      canvas.text({corner.x_px + 2, corner.y_px + tile_px + 16}, labels[i], Colour{87, 83, 78}, 11);
  }
  return canvas.image();
}

}  // namespace telefab
