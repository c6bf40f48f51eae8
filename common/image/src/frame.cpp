// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/image/frame.hpp>
#include <telefab/image/palette.hpp>

namespace telefab {
namespace {

constexpr double kText = 12;   ///< height of capitals
constexpr double kTitle = 15;  ///< the same of the title
constexpr double kMargin = 20;
constexpr double kHead = 64;  ///< above the picture
constexpr double kFoot = 64;  ///< below it, for bar and axes
constexpr double kLegendRow = 28;
constexpr double kMark = 22;  ///< room of a mark
constexpr double kGap = 26;   ///< between entries
constexpr double kAxis = 26;  ///< length of an axis
constexpr std::uint32_t kLeastWidth = 720;
constexpr double kScaleWidth = 320;

/// As much of a text as fits, with an ellipsis where something is left out.
std::string fitted(std::string text, double height_px, double most_px) {
  if (text_width_px(text, height_px) <= most_px) return text;
  while (!text.empty() && text_width_px(text + "…", height_px) > most_px) {
    while (!text.empty() && (static_cast<unsigned char>(text.back()) & 0xC0U) == 0x80U) text.pop_back();
    if (!text.empty()) text.pop_back();
  }
  return text + "…";
}

std::string title_of(const PictureCaption& c) {
  std::string title = c.part;
  const auto add = [&](const std::string& what) {
    if (!what.empty()) title += (title.empty() ? "" : "   ") + what;
  };
  add(c.machine.empty() ? "" : "on " + c.machine);
  if (c.size_mm[0] > 0) add(fmt::format("{:.1f} × {:.1f} × {:.1f} mm", c.size_mm[0], c.size_mm[1], c.size_mm[2]));
  return title;
}

void draw_mark(Canvas& canvas, PixelPoint middle, const LegendEntry& entry) {
  const double x = middle.x_px, y = middle.y_px;
  switch (entry.mark) {
    case LegendMark::Area: {
      const std::vector<PixelPoint> square{{x - 8, y - 8}, {x + 8, y - 8}, {x + 8, y + 8}, {x - 8, y + 8}};
      canvas.fill(std::span{&square, 1}, entry.colour);
      canvas.outline(square, palette::kPaleInk, 1);
      break;
    }
    case LegendMark::Line:
      canvas.line({x - 9, y}, {x + 9, y}, entry.colour, 4);
      break;
    case LegendMark::Disc:
      canvas.disc(middle, 6, entry.colour);
      break;
    case LegendMark::Ring:
      canvas.circle(middle, 6, entry.colour, 2);
      break;
  }
}

double width_of(const LegendEntry& entry) { return kMark + 6 + text_width_px(entry.text, kText) + kGap; }

/// Rows of a legend of that width; draws them where there is a canvas.
int lay_out(const std::vector<LegendEntry>& legend, double width_px, double top_px, Canvas* canvas) {
  if (legend.empty()) return 0;
  int rows = 1;
  double x = kMargin;
  for (const LegendEntry& entry : legend) {
    if (x > kMargin && x + width_of(entry) - kGap > width_px - kMargin) {
      x = kMargin;
      ++rows;
    }
    const double y = top_px + kLegendRow * (rows - 0.5);
    if (canvas != nullptr) {
      draw_mark(*canvas, {x + kMark / 2, y}, entry);
      canvas->text({x + kMark + 6, y + kText / 2}, entry.text, palette::kInk, kText);
    }
    x += width_of(entry);
  }
  return rows;
}

void draw_bar(Canvas& canvas, double x, double y, double px_per_mm, double most_px) {
  const double length_mm = round_length(most_px / px_per_mm), end = x + length_mm * px_per_mm;
  canvas.line({x, y}, {end, y}, palette::kInk, 2);
  for (const double at : {x, end}) canvas.line({at, y - 6}, {at, y + 6}, palette::kInk, 2);
  canvas.text({end + 10, y + kText / 2}, fmt::format("{:g} mm", length_mm), palette::kInk, kText);
}

void draw_axes(Canvas& canvas, double x, double y, const std::vector<PictureAxis>& axes) {
  for (const PictureAxis& axis : axes) {
    const PixelPoint tip{x + kAxis * axis.right, y - kAxis * axis.up};
    if (std::hypot(axis.right, axis.up) < 0.1) continue;  // it points at who looks
    canvas.line({x, y}, tip, palette::kInk, 2);
    const double reach = 1 + 9 / (kAxis * std::hypot(axis.right, axis.up));
    canvas.text({x + (tip.x_px - x) * reach - 4, y + (tip.y_px - y) * reach + 4}, axis.name, palette::kInk, 9);
  }
}

void draw_scale(Canvas& canvas, double x, double y, const DeviationScale& scale) {
  canvas.text({x, y + kText / 2}, scale.least, palette::kInk, kText);
  const double from = x + text_width_px(scale.least, kText) + 10;
  for (int i = 0; i < static_cast<int>(kScaleWidth); ++i)
    canvas.line({from + i, y - 7}, {from + i, y + 7}, palette::deviation_colour(2 * i / (kScaleWidth - 1) - 1), 1);
  canvas.text({from + kScaleWidth + 10, y + kText / 2}, scale.most, palette::kInk, kText);
}

Image framed_by(const Image& picture, const PictureCaption& caption, const DeviationScale* scale) {
  const std::uint32_t width_px = std::max(picture.width_px, kLeastWidth);
  const double width = width_px, bottom = kHead + picture.height_px;
  const int rows = lay_out(caption.legend, width, 0, nullptr) + (scale != nullptr ? 1 : 0);
  const bool has_foot = caption.px_per_mm > 0 || !caption.axes.empty();
  const double foot = 12 + kLegendRow * rows + (has_foot ? kFoot : 12);
  Canvas canvas{width_px, static_cast<std::uint32_t>(std::ceil(bottom + foot)), palette::kPaper};
  canvas.paste(picture, {std::floor((width - picture.width_px) / 2), kHead}, picture.width_px, picture.height_px);
  canvas.text({kMargin, 28}, fitted(title_of(caption), kTitle, width - 2 * kMargin), palette::kInk, kTitle);
  canvas.text({kMargin, 52}, fitted(caption.detail, kText, width - 2 * kMargin), palette::kPaleInk, kText);
  canvas.line({0, kHead - 1}, {width, kHead - 1}, palette::kRule, 1);
  canvas.line({0, bottom + 1}, {width, bottom + 1}, palette::kRule, 1);
  const int legend_rows = lay_out(caption.legend, width, bottom + 8, &canvas);
  if (scale != nullptr) draw_scale(canvas, kMargin, bottom + 8 + kLegendRow * (legend_rows + 0.5), *scale);
  const double middle = bottom + 8 + kLegendRow * rows + kFoot / 2;
  if (caption.px_per_mm > 0) draw_bar(canvas, kMargin, middle, caption.px_per_mm, width / 5);
  draw_axes(canvas, width - 60, middle + 10, caption.axes);
  return canvas.image();
}

}  // namespace

namespace palette {

Colour mixed(Colour a, Colour b, double share) {
  const double s = std::clamp(share, 0.0, 1.0);
  const auto mix = [s](std::uint8_t x, std::uint8_t y) {
    return static_cast<std::uint8_t>(std::lround(x + s * (static_cast<double>(y) - x)));
  };
  return {mix(a.red, b.red), mix(a.green, b.green), mix(a.blue, b.blue)};
}

Colour deviation_colour(double share) { return mixed(kFits, share < 0 ? kMissing : kBeyond, std::abs(share)); }

}  // namespace palette

Viewpoint viewpoint_from(double turned_deg, double above_deg) {
  constexpr double kRad = std::numbers::pi / 180;
  const double ct = std::cos(turned_deg * kRad), st = std::sin(turned_deg * kRad);
  const double ca = std::cos(above_deg * kRad), sa = std::sin(above_deg * kRad);
  return {{ct, -st, 0}, {sa * st, sa * ct, ca}, {ca * st, ca * ct, -sa}};
}

Viewpoint usual_viewpoint() { return viewpoint_from(25, 30); }

std::vector<PictureAxis> axes_of(const Viewpoint& v) {
  return {{"x", v.right[0], v.up[0]}, {"y", v.right[1], v.up[1]}, {"z", v.right[2], v.up[2]}};
}

std::vector<PictureAxis> axes_of_plane() { return {{"x", 1, 0}, {"y", 0, 1}}; }

double round_length(double most) {
  const double power = std::pow(10, std::floor(std::log10(most)));
  return power * (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1);
}

Image framed(const Image& picture, const PictureCaption& caption) { return framed_by(picture, caption, nullptr); }
Image framed(const Image& picture, const PictureCaption& caption, const DeviationScale& scale) {
  return framed_by(picture, caption, &scale);
}

}  // namespace telefab
