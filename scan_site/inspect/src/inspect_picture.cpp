// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <telefab/image/frame.hpp>
#include <telefab/scan/inspect/inspect_scan.hpp>

#include "inspect_colours.hpp"

namespace telefab::scan {
namespace {

constexpr std::uint32_t kPanel = 800;
constexpr double kMargin = 0.06;  // of a panel
constexpr Colour kNoise = palette::kPaleInk;

/// One direction of sight.
struct View {
  Vec3 right;  ///< on the screen
  Vec3 up;     ///< on the screen
  Vec3 away;   ///< from the eye into the picture
  std::string_view name;
};

/// As the other pictures show a part, turned on by an angle.
View view_from(double turned_on_deg, std::string_view name) {
  const Viewpoint v = turned_on_deg == 0 ? usual_viewpoint() : viewpoint_from(25 + turned_on_deg, 30);
  const auto vec = [](const std::array<double, 3>& a) { return Vec3{a[0], a[1], a[2]}; };
  return {vec(v.right), vec(v.up), vec(v.away), name};
}

struct Frame {
  const View& view;
  Vec3 centre;
  double px_per_mm;

  [[nodiscard]] PixelPoint at(const Vec3& p) const {
    const Vec3 d = p - centre;
    return {kPanel / 2.0 + px_per_mm * d.dot(view.right), kPanel / 2.0 - px_per_mm * d.dot(view.up)};
  }
  [[nodiscard]] double depth(const Vec3& p) const { return (p - centre).dot(view.away); }
};

/// The whole object, as large as the panel allows.
Frame fitted(const View& view, std::span<const Vec3> samples) {
  const Eigen::Matrix3d screen = (Eigen::Matrix3d{} << view.right, view.up, view.away).finished();
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high = -low;
  for (const Vec3& p : samples) {
    low = low.cwiseMin(screen.transpose() * p);
    high = high.cwiseMax(screen.transpose() * p);
  }
  if (samples.empty()) low = high = Vec3::Zero();
  const double extent = std::max((high - low).head<2>().maxCoeff(), 1e-9);
  return {view, screen * (0.5 * (low + high)), (1 - 2 * kMargin) * kPanel / extent};
}

/// Shaded samples with their depths, so that lines behind the object can be drawn faintly.
class Splats {
 public:
  Splats(const Frame& frame, const Inspection& inspection, double strength)
      : image_{kPanel, kPanel, 3, std::vector<std::uint8_t>(std::size_t{kPanel} * kPanel * 3, 255)},
        depth_(std::size_t{kPanel} * kPanel, std::numeric_limits<double>::infinity()) {
    const double radius = std::clamp(0.75 * inspection.kernel.spacing_mm * frame.px_per_mm, 0.7, 12.0);
    const Vec3 light = (-frame.view.away - 0.5 * frame.view.right + 0.5 * frame.view.up).normalized();
    for (std::size_t i = 0; i < inspection.samples.size(); ++i) {
      const Vec3& n = inspection.normals[i];
      if (n.dot(frame.view.away) > 0.1) continue;  // looks the other way
      const double bright = 0.25 + 0.75 * std::max(0.0, n.dot(light));
      const auto grey = static_cast<std::uint8_t>(255 - strength * (235 - 190 * bright));
      splat(frame.at(inspection.samples[i]), frame.depth(inspection.samples[i]), radius, grey);
    }
  }
  [[nodiscard]] const Image& image() const { return image_; }
  [[nodiscard]] bool hides(PixelPoint p, double depth, double slack) const {
    const auto x = static_cast<std::int64_t>(p.x_px);
    const auto y = static_cast<std::int64_t>(p.y_px);
    if (x < 0 || y < 0 || x >= kPanel || y >= kPanel) return false;
    return depth_[static_cast<std::size_t>(y) * kPanel + static_cast<std::size_t>(x)] < depth - slack;
  }

 private:
  void splat(PixelPoint p, double depth, double radius, std::uint8_t grey) {
    const auto low = [](double v) { return static_cast<std::int64_t>(std::max(0.0, std::ceil(v))); };
    const auto high = [](double v) { return static_cast<std::int64_t>(std::min(kPanel - 1.0, std::floor(v))); };
    for (auto y = low(p.y_px - radius); y <= high(p.y_px + radius); ++y)
      for (auto x = low(p.x_px - radius); x <= high(p.x_px + radius); ++x) {
        const std::size_t at = static_cast<std::size_t>(y) * kPanel + static_cast<std::size_t>(x);
        if (depth_[at] <= depth) continue;
        depth_[at] = depth;
        std::fill_n(image_.pixels.begin() + static_cast<std::ptrdiff_t>(3 * at), 3, grey);
      }
  }
  Image image_;
  std::vector<double> depth_;
};

Colour faint(Colour c) {
  const auto mix = [](std::uint8_t v) { return static_cast<std::uint8_t>(255 - (255 - v) / 2); };
  return {mix(c.red), mix(c.green), mix(c.blue)};
}

/// Draws a panel at its place on the sheet.
class Panel {
 public:
  Panel(Canvas& canvas, const Inspection& inspection, const Frame& frame, double strength, PixelPoint corner)
      : canvas_{canvas},
        frame_{frame},
        splats_{frame, inspection, strength},
        corner_{corner},
        slack_mm_{2 * inspection.kernel.kernel_mm} {
    canvas_.paste(splats_.image(), corner, kPanel, kPanel);
  }
  void path(std::span<const Vec3> points, Colour colour, int width_px) {
    // What is hidden first, so that it never covers what is seen.
    for (const bool hidden : {true, false})
      for (std::size_t i = 1; i < points.size(); ++i) {
        const PixelPoint a = frame_.at(points[i - 1]);
        const PixelPoint b = frame_.at(points[i]);
        if (splats_.hides(b, frame_.depth(points[i]), slack_mm_) != hidden) continue;
        canvas_.line(on_sheet(a), on_sheet(b), hidden ? faint(colour) : colour, hidden ? width_px - 1 : width_px);
      }
  }
  void mark(const Vec3& point, Colour colour, double radius_px) {
    const PixelPoint p = frame_.at(point);
    const bool hidden = splats_.hides(p, frame_.depth(point), slack_mm_);
    if (!hidden) canvas_.disc(on_sheet(p), radius_px + 1.5, {255, 255, 255});
    if (hidden)
      canvas_.circle(on_sheet(p), radius_px, colour, 1);
    else
      canvas_.disc(on_sheet(p), radius_px, colour);
  }
  void title(std::string_view text) {
    canvas_.text({corner_.x_px + 16, corner_.y_px + kPanel - 14}, text, palette::kInk, 12);
  }

 private:
  [[nodiscard]] PixelPoint on_sheet(PixelPoint p) const { return {p.x_px + corner_.x_px, p.y_px + corner_.y_px}; }
  Canvas& canvas_;
  const Frame& frame_;
  Splats splats_;
  PixelPoint corner_;
  double slack_mm_;
};

}  // namespace

Image draw_inspection(const Inspection& inspection) {
  Canvas canvas{2 * kPanel, 2 * kPanel, palette::kPaper};
  const HeightTopology& t = inspection.topology;
  const auto is_noise = [&](const CriticalPoint& c) { return c.persistence_mm < inspection.kernel.noise_mm; };
  double px_per_mm = 0;  // of the first view, which is the larger picture of most things
  const std::array views{view_from(0, "from the front"), view_from(-90, "a quarter turn on")};
  for (std::size_t v = 0; v < views.size(); ++v) {
    const Frame frame = fitted(views[v], inspection.samples);
    const double x = static_cast<double>(v) * kPanel;
    if (v == 0) px_per_mm = frame.px_per_mm;
    Panel complex{canvas, inspection, frame, 0.9, {x, 0}};
    for (const IntegralLine& line : t.integral_lines())
      complex.path(line.path_mm, line.ascending ? kAscending : kDescending, 2);
    // What lasts is drawn over what does not.
    for (const bool noise : {true, false})
      for (const CriticalPoint& c : t.critical_points())
        if (is_noise(c) == noise)
          complex.mark(c.position_mm, noise ? kNoise : colour_of(c.kind), noise || c.plateau ? 2.5 : 6);
    complex.title(fmt::format("{}: critical points and integral lines", views[v].name));

    Panel graph{canvas, inspection, frame, 0.35, {x, kPanel}};
    for (const ReebArc& arc : t.arcs()) {
      // A contour may be long: its path can arrive on the far side of it from the node.
      if (arc.path_mm.empty()) continue;
      const std::array arrival{arc.path_mm.back(), t.nodes()[arc.upper].place_mm};
      graph.path(arrival, kLink, 2);
      graph.path(arc.path_mm, arc.hole ? kHoleArc : kOuterArc, 3);
    }
    for (const ReebNode& n : t.nodes())
      graph.mark(
          n.place_mm,
          n.plateau || n.critical_points.empty() ? kPlateau : colour_of(t.critical_points()[n.critical_points[0]].kind),
          6);
    graph.title(fmt::format("{}: enhanced Reeb graph", views[v].name));
  }

  const auto count = [&](bool noise) {
    return static_cast<std::size_t>(std::ranges::count_if(
        t.critical_points(), [&](const CriticalPoint& c) { return !c.plateau && is_noise(c) == noise; }));
  };
  const auto some = [](std::size_t number, std::string_view one, std::string_view many) {
    return fmt::format("{} {}", number, number == 1 ? one : many);
  };
  PictureCaption caption{inspection.scan_name,
                         {},
                         {inspection.size_mm.x(), inspection.size_mm.y(), inspection.size_mm.z()},
                         {},
                         {},
                         px_per_mm,
                         axes_of(usual_viewpoint())};
  caption.detail =
      fmt::format("{} points, {}, chi {}; {} that last, {} of noise (they live over less than {:.3g} mm), {}, {}",
                  inspection.points, some(t.components().size(), "piece", "pieces"), t.euler(),
                  some(count(false), "critical point", "critical points"), count(true), inspection.kernel.noise_mm,
                  some(t.plateaus().size(), "plateau", "plateaus"),
                  some(t.inconsistencies().size(), "inconsistency", "inconsistencies"));
  for (const CriticalKind kind :
       {CriticalKind::Minimum, CriticalKind::BottomSaddle, CriticalKind::TopSaddle, CriticalKind::Maximum})
    caption.legend.push_back({colour_of(kind), std::string{name_of(kind)}, LegendMark::Disc});
  caption.legend.insert(caption.legend.end(), {{kNoise, "noise", LegendMark::Ring},
                                               {kAscending, "ascending line", LegendMark::Line},
                                               {kDescending, "descending line", LegendMark::Line},
                                               {kOuterArc, "outer contour", LegendMark::Line},
                                               {kHoleArc, "hole contour", LegendMark::Line},
                                               {kPlateau, "plateau", LegendMark::Disc}});
  return framed(canvas.image(), caption);
}

}  // namespace telefab::scan
