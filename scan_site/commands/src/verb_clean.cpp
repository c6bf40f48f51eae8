// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/image/palette.hpp>
#include <telefab/job/readable_scans.hpp>
#include <telefab/scan/cloud/clean.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/measure/point_picture.hpp>

#include "cloud_files.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

struct Options {
  std::string cloud, out, report, picture, units;
  std::string preset = "careful";
};

PointColour colour_of(PointFate fate) {
  switch (fate) {
    case PointFate::Kept:
      return point_colour(palette::kKept);
    case PointFate::Duplicate:
      return point_colour(palette::kDuplicate);
    case PointFate::Outlier:
      return point_colour(palette::kOutlier);
    case PointFate::SmallCluster:
      return point_colour(palette::kSmallCluster);
  }
  return {0, 0, 0};
}

PictureCaption caption_of(const Options& o, const CleanResult& cleaned) {
  const CleanReport& r = cleaned.report;
  PictureCaption caption{name_of_file(o.cloud), {}, {}, {}, {}, 0, {}};
  caption.detail = fmt::format("{} of {} points kept, preset {}", cleaned.cloud.size(), r.points_in, o.preset);
  caption.legend = {{palette::kKept, "kept"},
                    {palette::kDuplicate, fmt::format("{} duplicates", r.duplicates)},
                    {palette::kOutlier, fmt::format("{} outliers", r.outliers)},
                    {palette::kSmallCluster, fmt::format("{} in small clusters", r.cluster_points)}};
  return caption;
}

Result<ExitCode> clean(const Options& o, std::stop_token stop) {
  if (o.preset != "careful" && o.preset != "strong")
    return fail(ErrorCode::InvalidInput, fmt::format("--preset {}: careful or strong", o.preset));
  auto cloud = load_cloud(o.cloud, o.units, stop);
  if (!cloud) return tl::unexpected{cloud.error()};
  const auto cleaned =
      clean_cloud(*cloud, o.preset == "strong" ? CleanOptions::strong() : CleanOptions::careful(), stop);
  if (!cleaned) return fail_in(name_of_file(o.cloud), cleaned.error());
  const CleanReport& r = cleaned->report;
  if (auto ok =
          write_file_atomically(o.out, write_ply(cleaned->cloud, {}, "cleaned by telefab-scan clean, " + o.preset));
      !ok)
    return tl::unexpected{ok.error()};
  if (!o.report.empty())
    if (auto ok = write_file_atomically(o.report, to_json(r) + "\n"); !ok) return tl::unexpected{ok.error()};
  if (!o.picture.empty()) {
    std::vector<PointColour> colours;
    for (const PointFate f : cleaned->fate) colours.push_back(colour_of(f));
    const auto png = encode_png(framed_points(*cloud, colours, caption_of(o, *cleaned), cloud->unit_mm.has_value()));
    if (!png) return tl::unexpected{png.error()};
    if (auto ok = write_file_atomically(o.picture, *png); !ok) return tl::unexpected{ok.error()};
  }
  write_output(fmt::format("{} of {} points kept: {} duplicates, {} outliers, {} in {} small clusters removed\n",
                           cleaned->cloud.size(), r.points_in, r.duplicates, r.outliers, r.cluster_points,
                           r.clusters_removed));
  write_output(
      fmt::format("spacing {:.4g}, unevenness {:.3g}, noise {:.3g} -> {:.3g}, moved {:.3g} rms, {:.3g} at most\n",
                  r.spacing, r.unevenness, r.noise, r.noise_after, r.moved_rms, r.moved_max));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_clean(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("CLOUD", o->cloud, fmt::format("scan: {}", kReadableScans)).required();
  options.add_output("--out", o->out, "the cleaned cloud, PLY").required();
  options.add("--preset", o->preset, "careful: only what is surely wrong, nothing moves; strong: more, and smoothing")
      .shows_default();
  options.add(
      "--units", o->units,
      "unit of the file (mm, cm, m, in); the result is in mm. Unset: what the file states (E57, LAS: m), or lengths "
      "stay as they are");
  options.add_output("--report", o->report, "what was removed and moved, JSON");
  options.add_output("--picture", o->picture, "PNG: kept grey, outliers red, small clusters yellow, duplicates blue");
  return [o](std::stop_token stop) { return clean(*o, stop); };
}

}  // namespace telefab::scan
