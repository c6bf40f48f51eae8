#include <fmt/format.h>

#include <cmath>
#include <map>
#include <telefab/fab/mask/blend.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/test/mask_shapes.hpp>

// Prints how far what cures lies from the contours, by way of making masks: the tables of issue and notes.
namespace {

using namespace telefab;
using namespace telefab::test;

struct Method {
  const char* name;
  fab::Mask (*make)(const MachineProfile& machine, double tau, std::span<const Contour> rings);
};

fab::Mask blended(const MachineProfile& machine, double tau, std::span<const Contour> rings) {
  fab::MaskLight light = fab::mask_light(machine).value();
  light.white = std::exp(light.layer_mm / (2 * light.penetration_mm)) / tau;
  return fab::MaskBlender::make(fab::mask_frame(machine), light, {}).value().blend({.part = rings}).mask;
}

constexpr Method kMethods[] = {
    {"binary", [](const MachineProfile& m, double, std::span<const Contour> r) { return binary_mask(m, r); }},
    {"cover",
     [](const MachineProfile& m, double, std::span<const Contour> r) { return fab::rasterise(r, fab::mask_frame(m)); }},
    {"blend", blended},
};

constexpr std::pair<double, double> kSettings[] = {{0.5, 0.5}, {0.5, 0.2}, {1.0, 0.5}, {1.0, 0.2}};

void print_errors(const Method& method, bool families) {
  for (const auto& [spread, tau] : kSettings) {
    const MachineProfile machine = judge_machine(spread);
    fab::EdgeFigures all;
    std::map<std::string, fab::EdgeFigures> each;
    for (const MaskShape& shape : mask_shapes()) {
      const fab::EdgeFigures figures = judge(machine, method.make(machine, tau, shape.rings), tau, shape.rings);
      all.add(figures);
      each[shape.family].add(figures);
    }
    const auto print = [&](std::string_view what, const fab::EdgeFigures& f) {
      fmt::print(
          "{:<22} {:.1f} {:.1f} {:<10} {:7.4f} {:7.4f} {:7.4f} {:6.3f} {:6.3f} {:6.3f} {:6.3f} {:6.1f} {:7.4f} "
          "{:6.2f}\n",
          method.name, spread, tau, what, f.edges.mean_px(), f.smooth.mean_px(), f.smooth.bias_px(),
          f.edges.percentile_px(0.95), f.edges.max_px(), f.corners.mean_px(), f.cured.max_px(), 100 * f.lost_share(),
          f.latitude_px(), f.far_px2);
    };
    print("all", all);
    if (families)
      for (const auto& [name, figures] : each) print(name, figures);
  }
}

void print_widths(const Method& method, double dose) {
  for (const auto& [spread, tau] : kSettings)
    for (const double width : {0.5, 1.0, 1.5, 2.0})
      for (const bool gaps : {false, true}) {
        const MachineProfile machine = judge_machine(spread);
        double least = 1e9, most = 0, mean = 0;
        const auto features = thin_features(width, gaps);
        for (const ThinFeature& feature : features) {
          const KeptWidth kept =
              kept_width(exposed(machine, method.make(machine, tau, feature.rings), tau / dose), 1, feature);
          least = std::min(least, kept.least_px);
          most = std::max(most, kept.most_px);
          mean += kept.mean_px / static_cast<double>(features.size());
        }
        fmt::print("{:<22} {:.1f} {:.1f} {:+5.0f} % {} {:.1f}: {:.3f} [{:.3f}, {:.3f}]\n", method.name, spread, tau,
                   100 * (dose - 1), gaps ? "gap " : "wall", width, mean, least, most);
      }
}

}  // namespace

int main(int argc, char** argv) {
  const std::string_view what = argc > 1 ? argv[1] : "all";
  if (what == "all" || what == "families") {
    fmt::print("{:<22} {:>3} {:>3} {:<10} {:>7} {:>7} {:>7} {:>6} {:>6} {:>6} {:>6} {:>6} {:>7} {:>6}\n", "method",
               "sig", "tau", "shapes", "mean", "smooth", "bias", "p95", "max", "corner", "revmax", "lost%", "lat/1%",
               "far2");
    for (const Method& method : kMethods) print_errors(method, what == "families");
  }
  if (what == "all" || what == "widths")
    for (const Method& method : kMethods) print_widths(method, 1);
}
