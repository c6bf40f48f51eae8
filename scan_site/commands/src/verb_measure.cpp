// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <telefab/image/palette.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/measure/contour_deviation.hpp>
#include <telefab/scan/measure/measure.hpp>
#include <telefab/scan/measure/point_picture.hpp>

#include "cloud_files.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

struct Options {
  std::string reference, built, out, report, picture;
  std::string units, reference_units, built_units;
  std::optional<double> height, range, max_distance;
  bool no_align = false;
  bool json = false;
};

/// Layers of a file, and the machine's pixel where the file states it.
struct Contours {
  std::vector<Layer> layers;
  double pixel_mm = 0;
};

bool are_contours(std::string_view path) { return path.ends_with(".tfc") || path.ends_with(".jsonl"); }

Result<Contours> load_contours(const std::string& path) {
  const auto bytes = read_file(path, kMaxScanFileBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  Contours contours;
  if (path.ends_with(".tfc")) {
    const auto stack = read_tfc(*bytes);
    if (!stack) return fail_in(path, stack.error());
    contours.layers.assign(stack->layers().begin(), stack->layers().end());
    contours.pixel_mm = stack->header().pixel_pitch_mm;
    return contours;
  }
  const std::string_view text{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
  const auto read = read_json_lines(text, [&](Layer layer) -> Result<void> {
    contours.layers.push_back(std::move(layer));
    return {};
  });
  if (!read) return fail_in(path, read.error());
  return contours;
}

Result<ExitCode> run_on_contours(const Options& o, std::stop_token stop) {
  const auto reference = load_contours(o.reference);
  if (!reference) return tl::unexpected{reference.error()};
  const auto built = load_contours(o.built);
  if (!built) return tl::unexpected{built.error()};
  ContourMeasure options;
  options.most_mm = o.max_distance.value_or(options.most_mm);
  const auto measured = measure_contours(reference->layers, built->layers, options, stop);
  if (!measured) return tl::unexpected{measured.error()};
  const double pixel_mm = std::max(reference->pixel_mm, built->pixel_mm);
  const std::string json = to_json(*measured, pixel_mm) + "\n";
  if (!o.report.empty())
    if (auto ok = write_file_atomically(o.report, json); !ok) return tl::unexpected{ok.error()};
  if (o.json) {
    write_output(json);
    return ExitCode::Ok;
  }
  const auto row = [&](std::string_view unit, double per) {
    write_output(fmt::format("{}: mean {:.4f}, 95 % within {:.4f}, largest {:.4f}\n", unit, measured->mean_mm / per,
                             measured->p95_mm / per, measured->max_mm / per));
  };
  write_output(fmt::format(
      "{} places along the contours of {} layers; {} and {} rings, {} layers with another number\n", measured->places,
      measured->layers, measured->reference_rings, measured->rings, measured->other_counts));
  row("mm", 1);
  if (pixel_mm > 0) row("pixels", pixel_mm);
  return ExitCode::Ok;
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  if (are_contours(o.reference) && are_contours(o.built)) return run_on_contours(o, stop);
  const auto reference = load_oriented(o.reference, o.reference_units.empty() ? o.units : o.reference_units, stop);
  if (!reference) return tl::unexpected{reference.error()};
  const auto built = load_oriented(o.built, o.built_units.empty() ? o.units : o.built_units, stop);
  if (!built) return tl::unexpected{built.error()};
  const auto measured = measure(*reference, *built,
                                {.align_first = !o.no_align, .height = o.height, .max_distance = o.max_distance}, stop);
  if (!measured) return tl::unexpected{measured.error()};
  const Deviation& d = measured->deviation;
  const double range = o.range.value_or(std::max({std::abs(d.p1), std::abs(d.p99), 1e-12}));
  const std::vector<PointColour> colours = heat_colours(*measured, range);
  if (!o.out.empty())
    if (auto ok = write_file_atomically(
            o.out, write_ply(*built, colours, fmt::format("deviation, blue to orange at +-{:.6g}", range)));
        !ok)
      return tl::unexpected{ok.error()};
  if (!o.picture.empty()) {
    PictureCaption caption{name_of_file(o.built), {}, {}, {}, {}, 0, {}};
    caption.detail =
        fmt::format("against {}: {} points compared, {} without a counterpart; 98 % from {:+.4g} to {:+.4g}",
                    name_of_file(o.reference), measured->compared, measured->unmatched, d.p1, d.p99);
    caption.legend = {{{110, 110, 110}, "without a counterpart"}};
    const auto png = encode_png(framed_points(
        *built, colours, std::move(caption), built->unit_mm.has_value(),
        DeviationScale{fmt::format("too little, -{:.3g}", range), fmt::format("+{:.3g}, too much", range)}));
    if (!png) return tl::unexpected{png.error()};
    if (auto ok = write_file_atomically(o.picture, *png); !ok) return tl::unexpected{ok.error()};
  }
  const std::string json = to_json(*measured) + "\n";
  if (!o.report.empty())
    if (auto ok = write_file_atomically(o.report, json); !ok) return tl::unexpected{ok.error()};
  if (o.json) {
    write_output(json);
    return ExitCode::Ok;
  }
  const double percent = 100 / measured->height;
  const auto row = [&](std::string_view name, double low, double high) {
    write_output(fmt::format("{:<8} [{:+.4f}, {:+.4f}]   [{:+.3f}, {:+.3f}] % of height\n", name, low, high,
                             low * percent, high * percent));
  };
  write_output(
      fmt::format("{} points compared, {} without a counterpart; height {:.4g}; pictures are full colour at +-{:.4g}\n",
                  measured->compared, measured->unmatched, measured->height, range));
  row("all", d.min, d.max);
  row("1-99 %", d.p1, d.p99);
  write_output(fmt::format("rms      {:.4f} ({:.3f} %)   bias {:+.4f} ({:+.3f} %)\n", d.rms, d.rms * percent, d.bias,
                           d.bias * percent));
  write_output(
      fmt::format("size     mean {:.4f}   95 % within {:.4f}   largest {:.4f}\n", d.size_mean, d.size_p95, d.size_max));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_measure(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options
      .add("REFERENCE", o->reference, "what it should be: a scan file of any format read, or contours (.tfc, .jsonl)")
      .required();
  options.add("BUILT", o->built, "what it is; contours where the other are contours").required();
  options.add("--units", o->units,
              "unit of both files (mm, cm, m, in); unset: what they state (E57, LAS: m), or as they stand");
  options.add("--reference-units", o->reference_units, "unit of the reference alone");
  options.add("--built-units", o->built_units, "unit of the built cloud alone");
  options.add("--height", o->height, "length that is 100 %; unset: extent of the reference along z");
  options.add("--max-distance", o->max_distance,
              "farther points have no counterpart; unset: 10 % of the height; contours: count as this, 1 mm");
  options.add("--range", o->range,
              "deviation at which the colours are full; unset: the larger of the 1 % and 99 % values");
  options.flag("--no-align", o->no_align, "compare the files as they stand");
  options.add_output("--out", o->out, "the built cloud coloured by deviation, PLY");
  options.add_output("--picture", o->picture,
                     "heat map from four sides, PNG: red too much, blue too little, grey no counterpart");
  options.add_output("--report", o->report, "all figures and the motion found, JSON");
  options.flag("--json", o->json, "print the report instead of text");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
