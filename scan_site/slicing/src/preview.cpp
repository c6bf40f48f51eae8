// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <telefab/image/canvas.hpp>
#include <telefab/scan/slicing/preview.hpp>

namespace telefab::scan {
namespace {

constexpr std::uint32_t kWidth = 1280;
constexpr std::uint32_t kHeight = 800;
constexpr double kPart = 800;  ///< side of the square the part is drawn in
constexpr int kSections = 6;
constexpr std::uint32_t kMostPainted = 300;
constexpr double kTurn = 25 * std::numbers::pi / 180;
constexpr double kRise = 30 * std::numbers::pi / 180;
constexpr Colour kPaper{250, 250, 248};
constexpr Colour kInk{40, 44, 52};
constexpr Colour kMaterial{122, 160, 196};
constexpr Colour kFlag{214, 69, 65};
/// What contours rest on.
constexpr Colour kMeasured{128, 132, 138};
constexpr Colour kCompleted{230, 145, 20};
constexpr Colour kDoubtful{208, 32, 32};
/// Completed and doubtful stretches are drawn thicker, or they would not be seen.
constexpr int kStretchWidth = 3;

Colour colour_of(SurfaceClass kind) {
  switch (kind) {
    case SurfaceClass::Completed:
      return kCompleted;
    case SurfaceClass::Doubtful:
      return kDoubtful;
    case SurfaceClass::Measured:
      break;
  }
  return kMeasured;
}

/// One byte of the way from a to b.
Colour blend(Colour a, Colour b, double share) {
  const auto mix = [&](std::uint8_t x, std::uint8_t y) {
    return static_cast<std::uint8_t>(x + share * (static_cast<double>(y) - x) + 0.5);
  };
  return {mix(a.red, b.red), mix(a.green, b.green), mix(a.blue, b.blue)};
}

/// A doubt that is not about a place: the whole plane is painted.
bool doubtful_throughout(const Layer& layer) {
  return layer.certificate.verdict == LayerCertificate::Verdict::Doubtful &&
         std::all_of(layer.contours.begin(), layer.contours.end(), [](const Contour& ring) {
           return ring.runs().size() == 1 && ring.runs()[0].kind == SurfaceClass::Doubtful;
         });
}

}  // namespace

struct Preview::Picture {
  StackHeader header;
  std::uint32_t first, last, every;
  Canvas canvas{kWidth, kHeight, kPaper};
  double scale = 1;  ///< pixels a millimetre of the part's view
  double section_scale = 1;
  double middle_x, middle_y, height_mm;
  int sections = 0;

  /// The stretches of a ring, drawn at `ring`, that are not measured.
  void stretches(const Contour& contour, std::span<const PixelPoint> ring) {
    std::size_t edge = 0;
    for (const SurfaceRun& run : contour.runs())
      for (const std::size_t end = edge + run.edges; edge < end; ++edge)
        if (run.kind != SurfaceClass::Measured)
          canvas.line(ring[edge], ring[(edge + 1) % ring.size()], colour_of(run.kind), kStretchWidth);
  }

  void legend() {
    double x = 16;
    const double y = 24;
    const auto entry = [&](Colour colour, std::string_view words) {
      canvas.line({x, y - 5}, {x + 28, y - 5}, colour, kStretchWidth + 2);
      canvas.text({x + 36, y}, words, kInk, 13);
      x += 64 + 10.5 * static_cast<double>(words.size());
    };
    entry(kMeasured, "measured");
    entry(kCompleted, "completed");
    entry(kDoubtful, "doubtful");
    entry(kFlag, "layer doubtful throughout");
  }

  [[nodiscard]] PixelPoint seen(Point2 p, double z_mm) const {
    const double x = p.x_mm - middle_x;
    const double y = p.y_mm - middle_y;
    const double across = std::cos(kTurn) * x - std::sin(kTurn) * y;
    const double away = std::sin(kTurn) * x + std::cos(kTurn) * y;
    return {kPart / 2 + scale * across,
            kPart / 2 - scale * (std::sin(kRise) * away + std::cos(kRise) * (z_mm - height_mm / 2))};
  }
};

Preview::Preview(const StackHeader& header, LayerIndex first, LayerIndex last) : picture_{std::make_unique<Picture>()} {
  Picture& p = *picture_;
  p.header = header;
  p.first = first.count();
  p.last = last.count();
  p.every = std::max(1U, (p.last - p.first + kMostPainted) / kMostPainted);
  p.middle_x = (header.bounds.min.x_mm + header.bounds.max.x_mm) / 2;
  p.middle_y = (header.bounds.min.y_mm + header.bounds.max.y_mm) / 2;
  p.height_mm = header.layer_count * header.layer_thickness_mm;
  const double wide = header.bounds.max.x_mm - header.bounds.min.x_mm;
  const double deep = header.bounds.max.y_mm - header.bounds.min.y_mm;
  const double across = std::cos(kTurn) * wide + std::sin(kTurn) * deep;
  const double up = std::sin(kRise) * (std::sin(kTurn) * wide + std::cos(kTurn) * deep) + std::cos(kRise) * p.height_mm;
  p.scale = 0.94 * kPart / std::max({across, up, 1e-6});
  p.section_scale = 190 / std::max({wide, deep, 1e-6});
}
Preview::~Preview() = default;
Preview::Preview(Preview&&) noexcept = default;
Preview& Preview::operator=(Preview&&) noexcept = default;

void Preview::add(const Layer& layer) {
  Picture& p = *picture_;
  const std::uint32_t index = layer.index.count();
  const bool flagged = doubtful_throughout(layer);
  const double share = (index - p.first + 0.5) / (p.last - p.first + 1);
  if ((index - p.first) % p.every == 0 || index == p.last) {
    std::vector<std::vector<PixelPoint>> rings;
    for (const Contour& contour : layer.contours) {
      auto& ring = rings.emplace_back();
      for (const Point2 v : contour.vertices()) ring.push_back(p.seen(v, layer.z_mm));
    }
    if (!rings.empty()) {
      const Colour top = flagged ? kFlag : blend(kMaterial, {235, 243, 250}, share);
      p.canvas.fill(rings, top);
      for (std::size_t r = 0; r < rings.size(); ++r) {
        p.canvas.outline(rings[r], flagged ? blend(top, kInk, 0.35) : kMeasured, 1);
        p.stretches(layer.contours[r], rings[r]);
      }
    }
  }
  if (p.sections < kSections && share >= (p.sections + 0.5) / kSections) {
    const PixelPoint corner{kPart + 20 + 230 * (p.sections % 2), 20 + 260.0 * (p.sections / 2)};
    std::vector<std::vector<PixelPoint>> rings;
    for (const Contour& contour : layer.contours) {
      auto& ring = rings.emplace_back();
      for (const Point2 v : contour.vertices())
        ring.push_back({corner.x_px + 105 + p.section_scale * (v.x_mm - p.middle_x),
                        corner.y_px + 105 - p.section_scale * (v.y_mm - p.middle_y)});
    }
    if (!rings.empty()) p.canvas.fill(rings, flagged ? kFlag : kMaterial);
    for (std::size_t r = 0; r < rings.size(); ++r) {
      p.canvas.outline(rings[r], kInk, 1);
      p.stretches(layer.contours[r], rings[r]);
    }
    p.canvas.text({corner.x_px, corner.y_px + 232}, fmt::format("{:.2f} mm: {} rings", layer.z_mm, rings.size()), kInk,
                  12);
    ++p.sections;
  }
}

Result<std::vector<std::byte>> Preview::png() const {
  Picture& p = *picture_;
  p.legend();
  p.canvas.text({16, kHeight - 16},
                fmt::format("{}: {} layers of {} mm for {}", p.header.scan_name, p.header.layer_count,
                            p.header.layer_thickness_mm, p.header.machine),
                kInk, 14);
  return encode_png(p.canvas.image());
}

}  // namespace telefab::scan
