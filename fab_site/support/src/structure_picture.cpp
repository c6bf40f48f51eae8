// SPDX-License-Identifier: GPL-3.0-or-later
#include <tbb/parallel_for.h>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <telefab/fab/support/pictures.hpp>
#include <telefab/image/palette.hpp>

#include "scan_lines.hpp"
#include "stress_colours.hpp"

namespace telefab::fab {
namespace {

// Layers are painted from the platform upwards in parallel projection from above the horizon: what is higher lies in
// front, so no depth test is needed, and the height painted last tells where in space a pixel lies.
constexpr int kSide = 1400;       ///< of the finished picture
constexpr int kFine = 2 * kSide;  ///< of the picture that is painted; four of its pixels make one
// As usual_viewpoint(), for a plane that is turned first and seen from above then; radians.
constexpr double kTurn = -25 * std::numbers::pi / 180;
constexpr double kTilt = 30 * std::numbers::pi / 180;
constexpr std::array<double, 3> kLight{-0.45, -0.55, 0.70};  ///< towards the light, build frame turned by kTurn
constexpr int kShadowSide = 1400;

enum Kind : std::uint8_t { kNothing = 0, kPart = 1, kSupport = 2, kPlatform = 3 };

std::array<double, 3> rgb(Colour c) { return {double(c.red), double(c.green), double(c.blue)}; }

struct Flat2 {
  double x = 0, y = 0;
};
using Ring2 = std::vector<Flat2>;

/// Calls `span(row, first column, last column)` for what rings enclose by a winding number that is not zero.
template <class Span>
void scan(const std::vector<Ring2>& rings, int width, int height, Span span) {
  double low = std::numeric_limits<double>::infinity(), high = -low;
  for (const Ring2& ring : rings)
    for (const Flat2& p : ring) low = std::min(low, p.y), high = std::max(high, p.y);
  const double first = std::max(0.0, std::floor(low)), last = std::min<double>(height, std::ceil(high));
  if (!(first < last)) return;
  ScanLines lines{first, 1, static_cast<int>(last - first)};
  for (const Ring2& ring : rings)
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const Flat2 a = ring[i], b = ring[i + 1 < ring.size() ? i + 1 : 0];
      lines.add(a.x, a.y, b.x, b.y);
    }
  const auto column = [](double x) { return static_cast<int>(std::ceil(x - 0.5)); };
  lines.for_spans([&](int line, double from, double to) {
    const int c0 = std::max(0, column(from)), c1 = std::min(width, column(to)) - 1;
    if (c0 <= c1) span(static_cast<int>(first) + line, c0, c1);
  });
}

/// Rings of one print layer in the turned frame, millimetres from the middle of the print.
struct Slab {
  std::vector<Ring2> part, supports;
};

class Scene {
 public:
  /// With `stress`, which outlives this, supports have its colours.
  Scene(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm, const StressColours* stress)
      : t_{thickness_mm}, stress_{stress} {
    slabs_.resize(part.size() + plan.elevation_layers());
    tbb::parallel_for(std::size_t{0}, slabs_.size(), [&](std::size_t k) {
      if (k >= plan.elevation_layers())
        for (const Contour& contour : part[k - plan.elevation_layers()].contours) {
          Ring2 ring;
          for (const Point2& p : contour.vertices()) ring.push_back(turned(p));
          slabs_[k].part.push_back(std::move(ring));
        }
      const Region section = plan.section_region(LayerIndex{static_cast<std::uint32_t>(k)});
      for (const GridRing& grid : section.rings()) {
        Ring2 ring;
        for (const GridPoint& p : grid) ring.push_back(turned(to_mm(p)));
        slabs_[k].supports.push_back(std::move(ring));
      }
    });
    low_ = {1e9, 1e9}, high_ = {-1e9, -1e9};
    for (const Slab& slab : slabs_)
      for (const auto* rings : {&slab.part, &slab.supports})
        for (const Ring2& ring : *rings)
          for (const Flat2& p : ring) {
            low_ = {std::min(low_.x, p.x), std::min(low_.y, p.y)};
            high_ = {std::max(high_.x, p.x), std::max(high_.y, p.y)};
          }
    if (low_.x > high_.x) low_ = {0, 0}, high_ = {1, 1};
    tall_ = t_ * static_cast<double>(slabs_.size());
    margin_ = 0.06 * std::max({high_.x - low_.x, high_.y - low_.y, tall_});
    const double wide = high_.x - low_.x + 2 * margin_;
    const double deep = high_.y - low_.y + 2 * margin_;
    scale_ = 0.97 * kFine / std::max(wide, tall_ * std::cos(kTilt) + deep * std::sin(kTilt));
    middle_ = {(low_.x + high_.x) / 2, (low_.y + high_.y) / 2};
    height_.assign(std::size_t{kFine} * kFine, 0);
    kind_.assign(std::size_t{kFine} * kFine, kNothing);
  }

  /// Of the finished picture.
  [[nodiscard]] double px_per_mm() const { return scale_ / 2; }

  Image picture() {
    cast_shadow();
    paint();
    measure_depth();
    return shaded();
  }

 private:
  [[nodiscard]] static Flat2 turned(Point2 p) {
    return {p.x_mm * std::cos(kTurn) + p.y_mm * std::sin(kTurn), -p.x_mm * std::sin(kTurn) + p.y_mm * std::cos(kTurn)};
  }
  [[nodiscard]] static Point2 turned_back(Flat2 p) {
    return {p.x * std::cos(kTurn) - p.y * std::sin(kTurn), p.x * std::sin(kTurn) + p.y * std::cos(kTurn)};
  }
  [[nodiscard]] Flat2 to_screen(Flat2 p, double z) const {
    return {kFine / 2.0 + (p.x - middle_.x) * scale_,
            kFine / 2.0 - ((z - tall_ / 2) * std::cos(kTilt) + (p.y - middle_.y) * std::sin(kTilt)) * scale_};
  }
  [[nodiscard]] std::vector<Ring2> to_screen(const std::vector<Ring2>& rings, double z) const {
    std::vector<Ring2> out = rings;
    for (Ring2& ring : out)
      for (Flat2& p : ring) p = to_screen(p, z);
    return out;
  }
  /// The place in the turned frame that a pixel of known height shows.
  [[nodiscard]] Flat2 seen(int row, int column, double z) const {
    const double v = (kFine / 2.0 - row - 0.5) / scale_;
    return {middle_.x + (column + 0.5 - kFine / 2.0) / scale_,
            middle_.y + (v - (z - tall_ / 2) * std::cos(kTilt)) / std::sin(kTilt)};
  }

  /// Where a ray towards the light through a place meets the shadow's picture.
  [[nodiscard]] Flat2 to_shadow(Flat2 p, double z) const {
    const double reach = tall_ * std::max(std::abs(kLight[0]), std::abs(kLight[1])) / kLight[2];
    const double side = std::max(high_.x - low_.x, high_.y - low_.y) + 2 * margin_ + 2 * reach;
    const double s = kShadowSide / side;
    return {kShadowSide / 2.0 + (p.x - z * kLight[0] / kLight[2] - middle_.x) * s,
            kShadowSide / 2.0 + (p.y - z * kLight[1] / kLight[2] - middle_.y) * s};
  }

  void cast_shadow() {
    shadow_.assign(std::size_t{kShadowSide} * kShadowSide, -1);
    for (std::size_t k = 0; k < slabs_.size(); ++k) {
      const double z = (static_cast<double>(k) + 0.5) * t_;
      for (const auto* rings : {&slabs_[k].part, &slabs_[k].supports}) {
        std::vector<Ring2> cast = *rings;
        for (Ring2& ring : cast)
          for (Flat2& p : ring) p = to_shadow(p, z);
        scan(cast, kShadowSide, kShadowSide, [&](int row, int c0, int c1) {
          std::fill_n(shadow_.begin() + row * kShadowSide + c0, c1 - c0 + 1, static_cast<float>(z));
        });
      }
    }
  }

  /// 0 in the dark to 1 in the light, over a few cells so that the edge is soft.
  [[nodiscard]] double lit(Flat2 p, double z) const {
    const Flat2 at = to_shadow(p, z);
    const double bias = std::max(2.5 * t_, tall_ * 0.012);
    int clear = 0, all = 0;
    for (int dy = -3; dy <= 3; ++dy)
      for (int dx = -3; dx <= 3; ++dx) {
        const int x = static_cast<int>(at.x) + dx, y = static_cast<int>(at.y) + dy;
        if (dx * dx + dy * dy > 10) continue;
        ++all;
        if (x < 0 || y < 0 || x >= kShadowSide || y >= kShadowSide)
          ++clear;
        else
          clear += shadow_[static_cast<std::size_t>(y * kShadowSide + x)] < z + bias;
      }
    return static_cast<double>(clear) / all;
  }

  void fill(const std::vector<Ring2>& rings, double z, Kind kind) {
    scan(to_screen(rings, z), kFine, kFine, [&](int row, int c0, int c1) {
      const auto at = row * kFine + c0;
      std::fill_n(height_.begin() + at, c1 - c0 + 1, static_cast<float>(z));
      std::fill_n(kind_.begin() + at, c1 - c0 + 1, static_cast<std::uint8_t>(kind));
    });
  }

  void paint() {
    const std::vector<Ring2> plate{{{low_.x - margin_, low_.y - margin_},
                                    {high_.x + margin_, low_.y - margin_},
                                    {high_.x + margin_, high_.y + margin_},
                                    {low_.x - margin_, high_.y + margin_}}};
    fill(plate, 0, kPlatform);
    const int steps = std::max(1, static_cast<int>(std::ceil(t_ * std::cos(kTilt) * scale_)));
    for (std::size_t k = 0; k < slabs_.size(); ++k)
      for (int s = 1; s <= steps; ++s) {
        const double z = (static_cast<double>(k) + static_cast<double>(s) / steps) * t_;
        fill(slabs_[k].part, z, kPart);
        // Where a support enters the part it is the part's own material that is seen.
        fill(slabs_[k].supports, z, kSupport);
      }
  }

  [[nodiscard]] static std::size_t cell(int row, int column) {
    return static_cast<std::size_t>(row) * kFine + static_cast<std::size_t>(column);
  }

  /// Distance from the eye, smoothed over a few layers where nothing breaks off: steps of layers are no edges.
  void measure_depth() {
    depth_.assign(height_.size(), 0);
    tbb::parallel_for(0, kFine, [&](int row) {
      for (int c = 0; c < kFine; ++c) {
        if (kind_[cell(row, c)] == kNothing) continue;
        const double z = height_[cell(row, c)];
        depth_[cell(row, c)] =
            static_cast<float>((seen(row, c, z).y - middle_.y) * std::cos(kTilt) - z * std::sin(kTilt));
      }
    });
    const double layer_px = t_ * scale_;
    const int reach = std::clamp(static_cast<int>(std::ceil(1.6 * layer_px)), 3, 14);
    const auto near = static_cast<float>(3.0 * t_ / std::sin(kTilt) + 4 / scale_);
    std::vector<float> pass(depth_.size());
    for (int round = 0; round < 2; ++round)
      for (const bool along : {true, false}) {
        tbb::parallel_for(0, kFine, [&](int row) {
          for (int c = 0; c < kFine; ++c) {
            const std::size_t here = cell(row, c);
            if (kind_[here] == kNothing) continue;
            float sum = 0, weight = 0;
            for (int d = -reach; d <= reach; ++d) {
              const int x = along ? c + d : c, y = along ? row : row + d;
              if (x < 0 || y < 0 || x >= kFine || y >= kFine) continue;
              const std::size_t there = cell(y, x);
              if (kind_[there] != kind_[here] ||
                  std::abs(depth_[there] - depth_[here]) >
                      near + std::abs(static_cast<float>(d)) * 3 / static_cast<float>(scale_))
                continue;
              const float w = static_cast<float>(reach + 1 - std::abs(d));
              sum += w * depth_[there];
              weight += w;
            }
            pass[here] = sum / weight;
          }
        });
        depth_.swap(pass);
      }
  }

  /// How much of the surroundings stands in front of the tangent plane: hollows and the feet of walls are darker.
  [[nodiscard]] double openness(int row, int column, Flat2 slope) const {
    const float here = depth_[cell(row, column)];
    const double span = 0.035 * kFine / scale_;
    double hidden = 0;
    int all = 0;
    for (int ring = 1; ring <= 3; ++ring)
      for (int i = 0; i < 8; ++i) {
        const double angle = (i + 0.33 * ring) * 0.78539816;
        const int dx = static_cast<int>(ring * 0.012 * kFine * std::cos(angle));
        const int dy = static_cast<int>(ring * 0.012 * kFine * std::sin(angle));
        const int x = column + dx, y = row + dy;
        ++all;
        if (x < 0 || y < 0 || x >= kFine || y >= kFine || kind_[cell(y, x)] == kNothing) continue;
        const double plane = here + (slope.x * dx - slope.y * dy) / scale_;
        const double nearer = plane - depth_[cell(y, x)];
        if (nearer > 0.1 * span && nearer < 4 * span) hidden += std::min(1.0, nearer / span);
      }
    return 1 - 0.8 * hidden / all;
  }

  /// How fast the distance from the eye grows to the right and upwards.
  [[nodiscard]] Flat2 slope_at(int row, int column) const {
    const std::size_t here = cell(row, column);
    const auto slope = [&](int dr, int dc) {
      const int r0 = row - dr, r1 = row + dr, c0 = column - dc, c1 = column + dc;
      const bool before = r0 >= 0 && c0 >= 0 && kind_[cell(r0, c0)] == kind_[here];
      const bool after = r1 < kFine && c1 < kFine && kind_[cell(r1, c1)] == kind_[here];
      const double limit = 12;
      double sum = 0;
      int count = 0;
      if (before) {
        const double d = (depth_[here] - depth_[cell(r0, c0)]) * scale_;
        if (std::abs(d) < limit) sum += d, ++count;
      }
      if (after) {
        const double d = (depth_[cell(r1, c1)] - depth_[here]) * scale_;
        if (std::abs(d) < limit) sum += d, ++count;
      }
      return count > 0 ? sum / count : 0.0;
    };
    return {slope(0, 1), -slope(1, 0)};
  }

  [[nodiscard]] std::array<double, 3> colour(int row, int column) const {
    const std::size_t here = cell(row, column);
    const Kind kind = static_cast<Kind>(kind_[here]);
    if (kind == kNothing) return {255, 255, 255};
    const double z = height_[here];
    const Flat2 p = seen(row, column, z);
    if (kind == kPlatform) {
      const double shade = 0.72 + 0.28 * lit(p, 0);
      // A line every 10 mm, every millimetre on small platforms.
      const double pitch = std::max(high_.x - low_.x, high_.y - low_.y) > 30 ? 10 : 1;
      const double px = std::abs(std::remainder(p.x, pitch)) * scale_,
                   py = std::abs(std::remainder(p.y, pitch)) * scale_ * std::sin(kTilt);
      const double line = std::min(px, py) < 1.2 ? 0.93 : 1.0;
      const double level =
          248 * shade * line * (0.3 + 0.7 * openness(row, column, {0, std::cos(kTilt) / std::sin(kTilt)}));
      return {level, level, level * 1.01};
    }
    const Flat2 slope = slope_at(row, column);
    // In the turned frame; on the screen it points right, up and towards the eye.
    const double length = std::sqrt(slope.x * slope.x + slope.y * slope.y + 1);
    const double right = slope.x / length, up = slope.y / length, out_of = 1 / length;
    const std::array<double, 3> n{right, up * std::sin(kTilt) - out_of * std::cos(kTilt),
                                  up * std::cos(kTilt) + out_of * std::sin(kTilt)};
    const double norm = std::sqrt(kLight[0] * kLight[0] + kLight[1] * kLight[1] + kLight[2] * kLight[2]);
    const double facing = std::max(0.0, (n[0] * kLight[0] + n[1] * kLight[1] + n[2] * kLight[2]) / norm);
    const double sun = facing * lit(p, z + 0.5 * t_);
    const double sky = 0.5 + 0.5 * n[2], eye = std::max(0.0, -n[1] * std::cos(kTilt) + n[2] * std::sin(kTilt));
    const double light = (0.20 + 0.22 * sky + 0.12 * eye) * openness(row, column, slope) + 0.58 * sun;
    static const std::array<std::array<double, 3>, 4> kColours{
        {{255, 255, 255}, rgb(palette::kPart), rgb(palette::kSupport), {246, 246, 248}}};
    std::array<double, 3> out = kind == kSupport && stress_ ? stress_->at(turned_back(p), z) : kColours[kind];
    for (double& c : out) c = std::min(255.0, c * light * 1.12);
    return out;
  }

  /// The rows and columns of the finished picture that show anything, with a margin.
  [[nodiscard]] std::array<int, 4> shown() const {
    constexpr int kMargin = 24;
    int top = kSide, bottom = 0, left = kSide, right = 0;
    for (int row = 0; row < kFine; ++row)
      for (int column = 0; column < kFine; ++column)
        if (kind_[cell(row, column)] != kNothing) {
          top = std::min(top, row / 2), bottom = std::max(bottom, row / 2);
          left = std::min(left, column / 2), right = std::max(right, column / 2);
        }
    return {std::max(0, top - kMargin), std::min(kSide - 1, bottom + kMargin), std::max(0, left - kMargin),
            std::min(kSide - 1, right + kMargin)};
  }

  [[nodiscard]] Image shaded() const {
    const auto [top, bottom, left, right] = shown();
    const int wide = right - left + 1, high = bottom - top + 1;
    Image image{static_cast<std::uint32_t>(wide), static_cast<std::uint32_t>(high), 3, {}};
    image.pixels.resize(static_cast<std::size_t>(wide) * static_cast<std::size_t>(high) * 3);
    tbb::parallel_for(0, high, [&, left = left, top = top](int y) {
      for (int x = 0; x < wide; ++x) {
        std::array<double, 3> sum{};
        for (int i = 0; i < 4; ++i) {
          const auto c = colour(2 * (top + y) + i / 2, 2 * (left + x) + i % 2);
          for (std::size_t k = 0; k < 3; ++k) sum[k] += c[k] / 4;
        }
        for (std::size_t k = 0; k < 3; ++k)
          image
              .pixels[(static_cast<std::size_t>(y) * static_cast<std::size_t>(wide) + static_cast<std::size_t>(x)) * 3 +
                      k] = static_cast<std::uint8_t>(std::clamp(sum[k], 0.0, 255.0));
      }
    });
    return image;
  }

  double t_;
  const StressColours* stress_;
  std::vector<Slab> slabs_;
  Flat2 low_, high_, middle_;
  double tall_ = 0, margin_ = 0, scale_ = 1;
  std::vector<float> height_, depth_, shadow_;
  std::vector<std::uint8_t> kind_;
};

}  // namespace

Image draw_structure(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm,
                     PictureCaption caption) {
  Scene scene{part, plan, thickness_mm, nullptr};
  caption.legend = {{palette::kPart, "part"}, {palette::kSupport, "supports and base"}};
  caption.px_per_mm = scene.px_per_mm();
  caption.axes = axes_of(usual_viewpoint());
  return framed(scene.picture(), caption);
}

Image draw_stress(std::span<const Layer> part, const SupportPlan& plan, double thickness_mm, double most_demand,
                  PictureCaption caption) {
  const StressColours colours{plan, most_demand};
  Scene stressed{part, plan, thickness_mm, &colours};
  const Image scene = stressed.picture();
  caption.px_per_mm = stressed.px_per_mm();
  caption.axes = axes_of(usual_viewpoint());
  constexpr std::uint32_t kLegend = 84, kLeastWidth = 640;
  using palette::kInk, palette::kPaper;
  constexpr double kText_px = 12, kBar = 300, kBarHigh = 18, kMost = 1.3;
  Canvas canvas{std::max(scene.width_px, kLeastWidth), scene.height_px + kLegend, kPaper};
  canvas.paste(scene, {(std::max(scene.width_px, kLeastWidth) - scene.width_px) / 2.0, 0}, scene.width_px,
               scene.height_px);
  const double x = 24, y = scene.height_px + 14.0;
  const auto place = [&](double share) { return x + kBar * share / kMost; };
  for (int i = 0; i < static_cast<int>(kBar); ++i) {
    const auto c = StressColours::of(kMost * (i + 0.5) / kBar);
    canvas.line({x + i + 0.5, y}, {x + i + 0.5, y + kBarHigh},
                {static_cast<std::uint8_t>(c[0]), static_cast<std::uint8_t>(c[1]), static_cast<std::uint8_t>(c[2])}, 1);
  }
  for (const double share : {0.0, 0.5, 1.0}) {
    canvas.line({place(share), y + kBarHigh}, {place(share), y + kBarHigh + 6}, kInk, 2);
    canvas.text({place(share) - (share > 0 ? 10 : 0), y + kBarHigh + 26}, fmt::format("{:.0f}", share * most_demand),
                kInk, kText_px);
  }
  canvas.text({x + kBar + 20, y + 15}, "worst stress of each tip over the pull,", kInk, kText_px);
  canvas.text({x + kBar + 20, y + 38}, fmt::format("as planned; allowed are {:.0f}", most_demand), kInk, kText_px);
  return framed(canvas.image(), caption);
}

}  // namespace telefab::fab
