// SPDX-License-Identifier: GPL-3.0-or-later
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

/// The solver told that white is 1 / tau and that the edge is wanted where the dose is one, as the judge has it.
fab::MaskBlender blender(const MachineProfile& machine, double tau, int iterations) {
  fab::MaskLight light = fab::mask_light(machine).value();
  light.white = 1 / tau;
  light.layer_mm = 1e-9;
  fab::BlendOptions options;
  options.iterations = iterations;
  return fab::MaskBlender::make(fab::mask_frame(machine), light, options).value();
}

template <int kIterations>
fab::Mask blended(const MachineProfile& machine, double tau, std::span<const Contour> rings) {
  fab::BlendTask task;
  task.part = rings;
  return blender(machine, tau, kIterations).blend(task).mask;
}

struct Method {
  const char* name;
  fab::Mask (*make)(const MachineProfile& machine, double tau, std::span<const Contour> rings);
};

constexpr Method kMethods[] = {
    {"binary", [](const MachineProfile& m, double, std::span<const Contour> r) { return binary_mask(m, r); }},
    {"cover",
     [](const MachineProfile& m, double, std::span<const Contour> r) { return fab::rasterise(r, fab::mask_frame(m)); }},
    {"blend", blended<20>},
    {"blend, 40 steps", blended<40>},
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

/// Smooth edges when dose, spread and field are not what the masks were made for: spot 0.5 px, tau 0.5.
void print_robustness(const Method& method) {
  const MachineProfile known = judge_machine(0.5);
  const struct {
    const char* what;
    double dose, spread;
    double field;  ///< cells are this much brighter and darker in turn
  } states[] = {{"nothing off", 1, 0.5, 0},      {"dose +2 %", 1.02, 0.5, 0},     {"dose -2 %", 0.98, 0.5, 0},
                {"spread +10 %", 1, 0.55, 0},    {"spread -10 %", 1, 0.45, 0},    {"field 2 %", 1, 0.5, 0.02},
                {"all, plus", 1.02, 0.55, 0.02}, {"all, minus", 0.98, 0.45, 0.02}};
  for (const auto& state : states) {
    MachineProfile real = judge_machine(state.spread);
    const double bright = 1 + state.field, dark = 1 - state.field;
    real.projection.field = {{bright, dark, bright, dark}, {dark, bright, dark, bright}, {bright, dark, bright, dark}};
    fab::EdgeFigures all;
    for (const MaskShape& shape : mask_shapes())
      all.add(judge(real, method.make(known, 0.5, shape.rings), 0.5 / state.dose, shape.rings));
    fmt::print("{:<12} {:<16} smooth mean {:.4f} bias {:+.4f}\n", method.name, state.what, all.smooth.mean_px(),
               all.smooth.bias_px());
  }
}

/// Walls and cones of 40 layers, cure depth two layers at L / Dp = 0.5: edge errors at the middles of the lower layers.
void print_stack() {
  const MachineProfile machine = judge_machine(0.5);
  fab::CureModel model = fab::cure_model(machine).value();
  const double white = std::exp(1.0);
  fab::MaskLight light = fab::mask_light(machine).value();
  light.white = white;
  const auto blender = fab::MaskBlender::make(fab::mask_frame(machine), light, {}).value();
  const auto exposure = std::chrono::nanoseconds{std::llround(1e9 * white)};
  constexpr int layers = 40;
  const auto scaled = [](const Contour& ring, double by_px) {
    std::vector<Point2> v;
    for (const Point2& p : ring.vertices()) {
      const double x = p.x_mm - 2.4, y = p.y_mm - 2.4, r = std::hypot(x, y);
      v.push_back({2.4 + x * (r + 0.05 * by_px) / r, 2.4 + y * (r + 0.05 * by_px) / r});
    }
    return Contour::from_vertices(v).value();
  };
  for (const double step_px : {0.0, -0.45, 0.45})  // the ring grows by this a layer upwards
    for (const MaskShape& shape : mask_shapes()) {
      if (shape.family != "circle 15" && (shape.family != "square 22" || step_px != 0)) continue;
      for (const std::string_view method : {"cover", "blend, alone", "blend-stack"}) {
        fab::BlendStack stack{blender};
        fab::DoseStream dose{model};
        fab::EdgeFigures all;
        for (int layer = layers - 1; layer >= 0; --layer) {
          const Contour ring = scaled(shape.rings[0], step_px * (layer - layers / 2));
          fab::BlendTask task;
          task.part = {&ring, 1};
          const fab::Mask mask = method == "cover"          ? fab::rasterise({&ring, 1}, fab::mask_frame(machine))
                                 : method == "blend, alone" ? blender.blend(task).mask
                                                            : stack.descend(task, 20).mask;
          const fab::MaskExposure shown{mask.view(), exposure};
          const fab::DoseField field = dose.descend({&shown, 1}).value();
          if (layer < layers - 10)
            all.add(fab::measure_edges(field, model.to_middle(), {{&ring, 1}, {}}, 0.05, {}).value());
        }
        fmt::print("{:<12} {:<10} {:+.2f} px a layer: mean {:.4f} bias {:+.4f} max {:.3f} lost {:.1f} %\n", method,
                   shape.family, step_px, all.smooth.mean_px(), all.smooth.bias_px(), all.smooth.max_px(),
                   100 * all.lost_share());
      }
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
  if (what == "all" || what == "robust")
    for (const Method& method : kMethods) print_robustness(method);
  if (what == "all" || what == "stack") print_stack();
  if (what == "all" || what == "widths")
    for (const Method& method : kMethods) print_widths(method, 1);
}
