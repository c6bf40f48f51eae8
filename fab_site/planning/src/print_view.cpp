// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/fab/planning/print_view.hpp>
#include <telefab/image/canvas.hpp>
#include <telefab/image/palette.hpp>
#include <telefab/image/viewpoint.hpp>

namespace telefab::fab {
namespace {

constexpr int kFiner = 2;  ///< drawn so many times as large, so that edges are smooth
constexpr int kWide = kFiner * kViewWidth_px, kHigh = kFiner * kViewHeight_px;
constexpr std::uint32_t kMostLayers = 400;
constexpr double kFilled = 0.92;  ///< of the picture, by what is shown
constexpr std::uint8_t kPaper = 255;

using Vector = std::array<double, 3>;
double dot(const Vector& a, const Vector& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/// To the right of the middle of a picture and above it, in millimetres.
struct Seen {
  double right, up;
};
Seen seen(const Viewpoint& from, Point2 p, double z_mm) {
  const Vector place{p.x_mm, p.y_mm, z_mm};
  return {dot(from.right, place), dot(from.up, place)};
}

/// What a picture shows, of all that it must hold.
struct Extent {
  double left = 1e300, right = -1e300, low = 1e300, high = -1e300;
  void include(const Viewpoint& from, const ViewedLayer& layer) {
    for (const auto rings : {layer.part, layer.supports})
      for (const Contour& ring : rings)
        for (const Point2 v : ring.vertices()) {
          const Seen at = seen(from, v, layer.z_mm);
          left = std::min(left, at.right), right = std::max(right, at.right);
          low = std::min(low, at.up), high = std::max(high, at.up);
        }
  }
  [[nodiscard]] bool is_nothing() const { return left > right; }
};

/// Height and kind of what is seen at every pixel. Layers are drawn from below: seen from above, a later one hides.
class Relief {
 public:
  Relief(const Viewpoint& from, const Extent& shown)
      : from_{from},
        scale_{kFilled * std::min(kWide / std::max(shown.right - shown.left, 1e-9),
                                  kHigh / std::max(shown.high - shown.low, 1e-9))},
        middle_right_{(shown.left + shown.right) / 2},
        middle_up_{(shown.low + shown.high) / 2} {}

  void draw(const ViewedLayer& layer) {
    for (const Contour& ring : layer.supports) fill({&ring, 1}, layer.z_mm, Kind::Support);
    fill(layer.part, layer.z_mm, Kind::Part);
  }

  [[nodiscard]] Image shaded() const {
    Image image{kWide, kHigh, 3, {}};
    image.pixels.assign(std::size_t{3} * kWide * kHigh, kPaper);
    for (int y = 0; y < kHigh; ++y)
      for (int x = 0; x < kWide; ++x) {
        const Kind kind = kind_[at(x, y)];
        if (kind == Kind::None) continue;
        const double light = light_at(x, y);
        const Colour c = kind == Kind::Part ? palette::kPart : palette::kSupport;
        std::uint8_t* const pixel = &image.pixels[3 * at(x, y)];
        const std::array<std::uint8_t, 3> full{c.red, c.green, c.blue};
        for (std::size_t i = 0; i < full.size(); ++i)
          pixel[i] = static_cast<std::uint8_t>(std::clamp(full[i] * light, 0.0, 255.0));
      }
    return image;
  }

 private:
  enum class Kind : std::uint8_t { None, Part, Support };
  static std::size_t at(int x, int y) { return static_cast<std::size_t>(y) * kWide + static_cast<std::size_t>(x); }

  /// What an odd number of the rings surrounds.
  void fill(std::span<const Contour> rings, double z_mm, Kind kind) {
    crossings_.resize(kHigh);
    int first = kHigh, last = -1;
    for (const Contour& ring : rings) {
      const auto v = ring.vertices();
      for (std::size_t i = 0; i < v.size(); ++i) {
        auto [ax, ay] = pixel_of(v[i], z_mm);
        auto [bx, by] = pixel_of(v[(i + 1) % v.size()], z_mm);
        if (ay > by) std::swap(ax, bx), std::swap(ay, by);
        const int from = std::max(0, static_cast<int>(std::ceil(ay - 0.5)));
        const int to = std::min(kHigh - 1, static_cast<int>(std::ceil(by - 0.5)) - 1);
        for (int y = from; y <= to; ++y)
          crossings_[static_cast<std::size_t>(y)].push_back(ax + (y + 0.5 - ay) / (by - ay) * (bx - ax));
        if (from <= to) first = std::min(first, from), last = std::max(last, to);
      }
    }
    for (int y = first; y <= last; ++y) {
      auto& row = crossings_[static_cast<std::size_t>(y)];
      std::sort(row.begin(), row.end());
      for (std::size_t i = 0; i + 1 < row.size(); i += 2) {
        const int from = std::max(0, static_cast<int>(std::ceil(row[i] - 0.5)));
        const int behind = std::min(kWide, static_cast<int>(std::ceil(row[i + 1] - 0.5)));
        for (int x = from; x < behind; ++x) z_[at(x, y)] = z_mm, kind_[at(x, y)] = kind;
      }
      row.clear();
    }
  }

  [[nodiscard]] PixelPoint pixel_of(Point2 p, double z_mm) const {
    const Seen at = seen(from_, p, z_mm);
    return {kWide / 2.0 + scale_ * (at.right - middle_right_), kHigh / 2.0 - scale_ * (at.up - middle_up_)};
  }

  /// The mean height around a pixel, of what belongs together: layers are stairs, the object is smooth.
  [[nodiscard]] Vector place_at(int x, int y) const {
    constexpr int kAround = 3;
    const double near_mm = 8 / scale_;
    const double own = z_[at(x, y)];
    double sum = 0;
    int count = 0;
    for (int v = std::max(0, y - kAround); v <= std::min(kHigh - 1, y + kAround); ++v)
      for (int u = std::max(0, x - kAround); u <= std::min(kWide - 1, x + kAround); ++u)
        if (kind_[at(u, v)] == kind_[at(x, y)] && std::abs(z_[at(u, v)] - own) < near_mm) sum += z_[at(u, v)], ++count;
    const double z = sum / count;
    const double right = middle_right_ + (x + 0.5 - kWide / 2.0) / scale_;
    const double up = middle_up_ + (kHigh / 2.0 - (y + 0.5)) / scale_;
    const double away = (z - right * from_.right[2] - up * from_.up[2]) / from_.away[2];
    Vector place{};
    for (std::size_t i = 0; i < place.size(); ++i)
      place[i] = right * from_.right[i] + up * from_.up[i] + away * from_.away[i];
    return place;
  }

  /// By the surface's direction: of a lamp at the upper left in front, and of the sky.
  [[nodiscard]] double light_at(int x, int y) const {
    const auto is_same = [&](int u, int v) {
      return u >= 0 && u < kWide && v >= 0 && v < kHigh && kind_[at(u, v)] == kind_[at(x, y)];
    };
    const Vector left = place_at(is_same(x - 1, y) ? x - 1 : x, y), right = place_at(is_same(x + 1, y) ? x + 1 : x, y);
    const Vector upper = place_at(x, is_same(x, y - 1) ? y - 1 : y), lower = place_at(x, is_same(x, y + 1) ? y + 1 : y);
    Vector a{}, b{};
    for (std::size_t i = 0; i < a.size(); ++i) a[i] = right[i] - left[i], b[i] = upper[i] - lower[i];
    const Vector normal{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    const double length = std::sqrt(dot(normal, normal));
    constexpr double kShadow = 0.45, kLamp = 0.5, kSky = 0.2;
    if (!(length > 0)) return kShadow + kLamp / 2;
    // The lamp stands with whoever looks, at the left and above.
    Vector lamp{};
    for (std::size_t i = 0; i < lamp.size(); ++i)
      lamp[i] = 0.45 * from_.up[i] - 0.5 * from_.right[i] - 0.74 * from_.away[i];
    return kShadow + kLamp * std::max(0.0, dot(normal, lamp) / length) + kSky * std::max(0.0, normal[2] / length);
  }

  Viewpoint from_;
  double scale_;  ///< pixels a millimetre
  double middle_right_, middle_up_;
  std::vector<double> z_ = std::vector<double>(std::size_t{kWide} * kHigh);
  std::vector<Kind> kind_ = std::vector<Kind>(std::size_t{kWide} * kHigh, Kind::None);
  std::vector<std::vector<double>> crossings_;  ///< by row; empty between two calls
};

}  // namespace

Result<Image> draw_print(LayerIndex layers, const LayerViewer& viewer) {
  std::vector<std::uint32_t> looked_at;
  const std::uint32_t step = std::max(1U, (layers.count() + kMostLayers - 1) / kMostLayers);
  for (std::uint32_t i = 0; i < layers.count(); i += step) looked_at.push_back(i);
  if (!looked_at.empty() && looked_at.back() + 1 != layers.count()) looked_at.push_back(layers.count() - 1);
  const auto all = [&](const std::function<void(const ViewedLayer&)>& look) -> Result<void> {
    for (const std::uint32_t i : looked_at)
      if (auto seen = viewer(LayerIndex{i}, look); !seen) return seen;
    return {};
  };
  const Viewpoint from = usual_viewpoint();
  Extent shown;
  if (auto seen = all([&](const ViewedLayer& layer) { shown.include(from, layer); }); !seen)
    return tl::unexpected{seen.error()};
  if (shown.is_nothing()) shown = {0, 1, 0, 1};
  Relief relief{from, shown};
  if (auto seen = all([&](const ViewedLayer& layer) { relief.draw(layer); }); !seen)
    return tl::unexpected{seen.error()};
  return shrunk_to(relief.shaded(), kViewWidth_px);
}

}  // namespace telefab::fab
