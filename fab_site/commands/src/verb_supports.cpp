// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/formats/mesh_export.hpp>
#include <telefab/fab/support/pictures.hpp>
#include <telefab/fab/support/structure_mesh.hpp>

#include "read_stack.hpp"
#include "support_choice.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

struct Options {
  std::string stack;
  MachineChoice machine;
  SupportChoice support;
  std::string out, preview, structure, stress, model;
  std::optional<std::uint32_t> layer;
  int threads = 0;
  bool json = false;
};

Result<SupportOptions> support_options(const Options& o) {
  SupportOptions options;
  options.threads = o.threads;
  if (auto ok = apply(o.support, options); !ok) return tl::unexpected{ok.error()};
  return options;
}

Result<void> write_png(const std::string& path, const Image& image) {
  const auto png = encode_png(image);
  if (!png) return tl::unexpected{png.error()};
  return write_file_atomically(path, *png);
}

/// The layer asked for, or the one with the most to support that no anchor of a layer below holds.
std::uint32_t layer_to_show(const Options& o, const SupportPlan& plan) {
  if (o.layer) return *o.layer;
  std::uint32_t best = 0;
  std::size_t most = 0, here = 0;
  const auto anchors = plan.anchors();
  for (std::size_t i = 0; i < anchors.size(); ++i) {
    here = i > 0 && anchors[i].layer == anchors[i - 1].layer ? here + 1 : 1;
    if (here > most) most = here, best = anchors[i].layer.count();
  }
  return best;
}

/// The figures for programs, fixed key order.
std::string figures_json(const SupportPlan& plan, double thickness_mm) {
  const SupportFigures& f = plan.figures();
  const nlohmann::ordered_json figures{{"anchors", plan.anchors().size()},
                                       {"layers_with_regions", f.layers_with_regions},
                                       {"to_support_mm2", f.to_support_mm2},
                                       {"pins_on_part", f.feet_on_part},
                                       {"thin_pins", f.thin_pins},
                                       {"braces", f.braces},
                                       {"medium_tips", f.medium_tips},
                                       {"heavy_tips", f.heavy_tips},
                                       {"bearing", f.bearing},
                                       {"bearing_demand", f.bearing_demand},
                                       {"stabilising", f.stabilising},
                                       {"stability_mm", f.stability_mm},
                                       {"support_mm3", f.support_mm3},
                                       {"part_mm3", f.part_mm3},
                                       {"lifted_mm", plan.elevation_layers() * thickness_mm}};
  return json_text(figures);
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  const auto options = support_options(o);
  if (!options) return tl::unexpected{options.error()};
  const auto stack = read_stack(o.stack);
  if (!stack) return tl::unexpected{stack.error()};
  const auto machine = chosen_machine(o.machine, stack->header().machine);
  if (!machine) return tl::unexpected{machine.error()};
  const auto plan = plan_supports(stack->layers(), stack->header(), *machine, *options, progress_line(), stop);
  clear_progress();
  if (!plan) return tl::unexpected{plan.error()};
  const double thickness_mm = stack->header().layer_thickness_mm;
  const SupportFigures& f = plan->figures();
  if (o.json) write_output(figures_json(*plan, thickness_mm) + "\n");
  const auto print_unless_json = [&](const std::string& line) {
    if (!o.json) write_output(line);
  };
  print_unless_json(
      fmt::format("{} anchors on {} layers; {} pins stand on the part, {} of the pins are thin, {} braces\n",
                  plan->anchors().size(), f.layers_with_regions, f.feet_on_part, f.thin_pins, f.braces));
  if (f.bearing_demand > 0)
    print_unless_json(
        fmt::format("{} medium and {} heavy tips, {} anchors for the pull alone; the worst tip bears {:.0f} times the "
                    "pull, allowed "
                    "are {:.0f}\n",
                    f.medium_tips, f.heavy_tips, f.bearing, f.bearing_demand, machine->carried_demand()));
  if (f.unreached > 0)
    print_unless_json(fmt::format("{} anchors have no pin: none reaches them from the platform\n", f.unreached));
  print_unless_json(fmt::format("supports {:.1f} mm3, {:.1f} % of the part's {:.1f} mm3; lifted by {:.2f} mm\n",
                                f.support_mm3, f.part_mm3 > 0 ? 100 * f.support_mm3 / f.part_mm3 : 0.0, f.part_mm3,
                                plan->elevation_layers() * thickness_mm));
  if (!o.out.empty()) {
    const std::string text = to_json(*plan);
    if (auto ok = write_file_atomically(o.out, text); !ok) return tl::unexpected{ok.error()};
  }
  PictureCaption caption{stack->header().scan_name, machine->name, part_size_mm(*stack), {}, {}, 0, {}};
  caption.detail =
      fmt::format("{} anchors, {} pins on the part, supports {:.1f} mm³, lifted by {:.2f} mm", plan->anchors().size(),
                  f.feet_on_part, f.support_mm3, plan->elevation_layers() * thickness_mm);
  if (!o.preview.empty()) {
    const std::uint32_t layer = layer_to_show(o, *plan);
    const auto regions = regions_of_layer(stack->layers(), LayerIndex{layer}, *machine);
    if (!regions) return tl::unexpected{regions.error()};
    const Millimetres reach{machine->supports.anchor_distance_mm};
    PictureCaption about = caption;
    about.detail = fmt::format("layer {} of the part, z = {:.3f} mm, from above", layer,
                               cut_height_mm(LayerIndex{layer}, thickness_mm));
    const auto near = anchors_at(*plan, LayerIndex{layer}, thickness_mm, reach);
    print_unless_json(fmt::format(
        "layer {} at {:.3f} mm: attached {:.2f}, self-supported {:.2f}, to support {:.2f} mm2, {} anchors\n", layer,
        cut_height_mm(LayerIndex{layer}, thickness_mm), regions->attached.area_mm2(),
        subtract(regions->self_supported, regions->attached).area_mm2(), regions->to_support.area_mm2(), near.size()));
    if (auto ok = write_png(o.preview, draw_layer(*regions, near, about)); !ok) return tl::unexpected{ok.error()};
  }
  if (!o.structure.empty())
    if (auto ok = write_png(o.structure, draw_structure(stack->layers(), *plan, thickness_mm, caption)); !ok)
      return tl::unexpected{ok.error()};
  if (!o.stress.empty())
    if (auto ok =
            write_png(o.stress, draw_stress(stack->layers(), *plan, thickness_mm, machine->carried_demand(), caption));
        !ok)
      return tl::unexpected{ok.error()};
  if (!o.model.empty()) {
    const StructureMesh mesh =
        structure_mesh(stack->layers(), *plan, thickness_mm, Millimetres{machine->projection.pixel_pitch_mm / 4});
    const bool is_threemf = std::filesystem::path{o.model}.extension() == ".3mf";
    auto written = is_threemf ? export_threemf(mesh, o.model, progress_line(), stop)
                              : write_file_atomically(o.model, to_ply(mesh));
    clear_progress();
    if (!written) return tl::unexpected{written.error()};
  }
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_supports(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("FILE", o->stack, "contour file (.tfc) of telefab-scan slice").required();
  declare_machine_choice(options, o->machine, "machine profile; default: the one it was sliced for",
                         MachineIs::Optional);
  declare_support_choice(options, o->support);
  options.add("--layer", o->layer, "part layer of --preview; default: the one with the most anchors of its own");
  options.add_output("--preview", o->preview,
                     "PNG of one layer: attached, self-supported, to support, anchors and the circles they reach");
  options.add_output("--structure", o->structure, "PNG of the part with its supports in 3-D");
  options.add_output("--stress", o->stress,
                     "PNG of the same, pins in colours by what the film's pull asks of their tips at the worst moment");
  options.add_output("--model", o->model,
                     "the part with its supports in colours, for a viewer: 3MF if the name ends so, else PLY");
  options.add_output("--out", o->out, "anchors and primitives as JSON, as supports.json of a plan");
  options.flag("--json", o->json, "print the figures as JSON");
  options.add("--threads", o->threads, "0: all cores; the supports are the same for any number")
      .within(0, 1024)
      .shows_default();
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::fab
