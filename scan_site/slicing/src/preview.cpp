// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <telefab/image/frame.hpp>
#include <telefab/image/palette.hpp>
#include <telefab/scan/slicing/preview.hpp>

namespace telefab::scan {
namespace {

constexpr std::uint32_t kWidth = 1280;
constexpr std::uint32_t kHeight = 800;
constexpr double kPart = 800;  ///< side of the square the part is drawn in
constexpr int kSections = 6;
constexpr std::uint32_t kMostPainted = 300;
constexpr Colour kMaterial{176, 182, 190};
constexpr Colour kLightest{240, 242, 246};
/// A layer that is doubtful throughout is painted so; its edge is kDoubtful.
constexpr Colour kFlag{228, 130, 118};
using palette::kInk, palette::kMeasured, palette::kCompleted, palette::kDoubtful, palette::kPaper;
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
  Viewpoint view = usual_viewpoint();
  double scale = 1;  ///< pixels a millimetre of the part's view
  double section_scale = 1;
  double middle_x, middle_y, height_mm;
  std::optional<Bounds2> drawn;  ///< of the contours; a header may state more
  int sections = 0;

  /// The stretches of a ring, drawn at `ring`, that are not measured.
  void stretches(const Contour& contour, std::span<const PixelPoint> ring) {
    std::size_t edge = 0;
    for (const SurfaceRun& run : contour.runs())
      for (const std::size_t end = edge + run.edges; edge < end; ++edge)
        if (run.kind != SurfaceClass::Measured)
          canvas.line(ring[edge], ring[(edge + 1) % ring.size()], colour_of(run.kind), kStretchWidth);
  }

  [[nodiscard]] PixelPoint seen(Point2 p, double z_mm) const {
    const std::array<double, 3> from_middle{p.x_mm - middle_x, p.y_mm - middle_y, z_mm - height_mm / 2};
    const auto along = [&](const std::array<double, 3>& axis) {
      return axis[0] * from_middle[0] + axis[1] * from_middle[1] + axis[2] * from_middle[2];
    };
    return {kPart / 2 + scale * along(view.right), kPart / 2 - scale * along(view.up)};
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
  const auto extent = [&](const std::array<double, 3>& axis) {
    return std::abs(axis[0]) * wide + std::abs(axis[1]) * deep + std::abs(axis[2]) * p.height_mm;
  };
  const double across = extent(p.view.right), up = extent(p.view.up);
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
  for (const Contour& contour : layer.contours) {
    if (!p.drawn) p.drawn = contour.bounds();
    p.drawn->include(contour.bounds());
  }
  const double share = (index - p.first + 0.5) / (p.last - p.first + 1);
  if ((index - p.first) % p.every == 0 || index == p.last) {
    std::vector<std::vector<PixelPoint>> rings;
    for (const Contour& contour : layer.contours) {
      auto& ring = rings.emplace_back();
      for (const Point2 v : contour.vertices()) ring.push_back(p.seen(v, layer.z_mm));
    }
    if (!rings.empty()) {
      const Colour top = flagged ? kFlag : palette::mixed(kMaterial, kLightest, share);
      p.canvas.fill(rings, top);
      for (std::size_t r = 0; r < rings.size(); ++r) {
        p.canvas.outline(rings[r], flagged ? kDoubtful : kMeasured, 1);
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
    p.canvas.text({corner.x_px, corner.y_px + 232},
                  fmt::format("z = {:.2f} mm: {} contour{}", layer.z_mm, rings.size(), rings.size() == 1 ? "" : "s"),
                  kInk, 10);
    ++p.sections;
  }
}

Result<std::vector<std::byte>> Preview::png() const {
  Picture& p = *picture_;
  const Bounds2 box = p.drawn.value_or(Bounds2{});
  const double height_mm = (p.last - p.first + 1) * p.header.layer_thickness_mm;
  PictureCaption caption{p.header.scan_name,
                         p.header.machine,
                         {box.max.x_mm - box.min.x_mm, box.max.y_mm - box.min.y_mm, height_mm},
                         {},
                         {},
                         p.scale,
                         axes_of(p.view)};
  const std::string which = p.last - p.first + 1 == p.header.layer_count
                                ? fmt::format("{} layers", p.header.layer_count)
                                : fmt::format("layers {} to {} of {}", p.first, p.last, p.header.layer_count);
  caption.detail = fmt::format("{} of {:g} mm; to the right {} of them from above, at a scale of their own", which,
                               p.header.layer_thickness_mm, p.sections);
  caption.legend = {{kMeasured, "measured", LegendMark::Line},
                    {kCompleted, "completed where the scan shows nothing", LegendMark::Line},
                    {kDoubtful, "doubtful", LegendMark::Line},
                    {kFlag, "layer doubtful throughout", LegendMark::Area}};
  return encode_png(framed(p.canvas.image(), caption));
}

}  // namespace telefab::scan
