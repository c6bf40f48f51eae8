#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/fab/mask/raster.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <telefab/image/png.hpp>

#include "read_stack.hpp"
#include "verbs.hpp"

namespace telefab::fab {
namespace {

struct Options {
  std::string stack;
  std::string format;
  std::string out;
  std::string machine;
  std::string machines = default_machine_folder();
};

Result<void> export_lines(const LayerStack& stack, const Options& o, std::stop_token stop) {
  std::string lines;
  for (const Layer& layer : stack.layers()) {
    if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "the export was cancelled; nothing was written");
    lines += to_json_line(layer) + '\n';
  }
  return write_file_atomically(o.out, lines);
}

/// One picture a layer of the part alone, by exact area coverage; `plan` makes the masks of a print.
Result<void> export_pictures(const LayerStack& stack, const Options& o, std::stop_token stop) {
  const auto machine = machine_for(stack, o.machine, o.machines);
  if (!machine) return tl::unexpected{machine.error()};
  const MaskFrame frame = mask_frame(*machine);
  std::error_code error;
  const std::filesystem::path folder{o.out};
  std::filesystem::create_directories(folder, error);
  if (error) return fail(ErrorCode::NotPermitted, fmt::format("cannot make the folder {}: {}", o.out, error.message()));
  const ProgressSink progress = progress_line();
  for (const Layer& layer : stack.layers()) {
    if (stop.stop_requested())
      return fail(ErrorCode::Cancelled, fmt::format("the export was cancelled before layer {}", layer.index.count()));
    const auto png = encode_png_grey(frame.size.width_px, frame.size.height_px, rasterise(layer.contours, frame).rows);
    if (!png) return tl::unexpected{png.error()};
    if (auto done = write_new_file(folder / fmt::format("{:05}.png", layer.index.count()), *png); !done) return done;
    report(progress, "writing pictures", (layer.index.count() + 1.0) / stack.header().layer_count);
  }
  clear_progress();
  return sync_file_system(folder);
}

}  // namespace

VerbBody declare_export(CLI::App& options) {
  auto o = std::make_shared<Options>();
  options.add_option("FILE", o->stack, "contour file (.tfc)")->required();
  options
      .add_option("--format", o->format,
                  "jsonl: one JSON line a layer, as telefab-scan slice --contours writes it; png: one picture a layer "
                  "of the part alone")
      ->required()
      ->check(CLI::IsMember({"jsonl", "png"}));
  options.add_option("--out", o->out, "file (jsonl) or folder (png)")->required();
  options.add_option("--machine", o->machine, "png: machine whose pixels are used; default: the one it was sliced for");
  options.add_option("--machines", o->machines, "folder of machine profiles (*.toml)")->capture_default_str();
  return [o](std::stop_token stop) -> Result<ExitCode> {
    const auto stack = read_stack(o->stack);
    if (!stack) return tl::unexpected{stack.error()};
    const auto done = o->format == "jsonl" ? export_lines(*stack, *o, stop) : export_pictures(*stack, *o, stop);
    if (!done) return tl::unexpected{done.error()};
    fmt::print("{} layers written to {}\n", stack->header().layer_count, o->out);
    return ExitCode::Ok;
  };
}

}  // namespace telefab::fab
