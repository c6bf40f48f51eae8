// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <map>
#include <memory>
#include <span>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/machine_choice.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/slice_options.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <telefab/job/readable_scans.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>
#include <telefab/scan/slicing/preview.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

#include "verbs.hpp"

namespace telefab::scan {
namespace {

constexpr std::uint64_t kMaxScanBytes = 64ULL << 30U;

struct Options {
  std::string cloud;
  MachineChoice machine;
  std::string out, contours, report, preview, points;
  SliceParameters asked;
  bool require_certified = false;
  bool json = false;
  unsigned threads = 0;
  std::string layers;
};

/// "FIRST:LAST", both counted from 0 and both cut.
Result<std::array<std::uint32_t, 2>> range_from(const std::string& text) {
  std::array<std::uint32_t, 2> range{};
  const char* at = text.data();
  const char* const end = at + text.size();
  for (std::size_t i = 0; i < 2; ++i) {
    const auto [after, error] = std::from_chars(at, end, range[i]);
    if (error != std::errc{} || (i == 0 ? after == end || *after != ':' : after != end))
      return fail(ErrorCode::InvalidInput, fmt::format("{} must be FIRST:LAST, e.g. 0:99", text));
    at = after + 1;
  }
  return range;
}

Result<JobParameters> parameters_from(const Options& o) {
  const auto machine = chosen_machine(o.machine);
  if (!machine) return tl::unexpected{machine.error()};
  auto parameters = job_parameters_of(o.asked, *machine, o.out.empty() ? Contours::Plain : Contours::Coded);
  if (!parameters) return parameters;
  parameters->slice.threads = o.threads;
  if (!o.layers.empty()) {
    if (!o.out.empty())
      return fail(ErrorCode::InvalidInput, "a .tfc file holds a whole stack: use --contours with --layers");
    const auto range = range_from(o.layers);
    if (!range) return tl::unexpected{range.error()};
    parameters->slice.layers = *range;
  }
  if (auto ok = parameters->slice.validate(); !ok) return tl::unexpected{ok.error()};
  return parameters;
}

/// Vertices and chord middles of contours, taken back to where the scan stood.
class ContourPoints {
 public:
  void add(const StackHeader& header, const Layer& layer) {
    const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> to_build{header.scan_to_build.data()};
    const Eigen::Affine3d to_scan{Eigen::Affine3d{Eigen::Matrix4d{to_build}}.inverse()};
    // Square to the surface in both frames, and outward where one is mirrored.
    const Eigen::Matrix3d normals = to_build.topLeftCorner<3, 3>().transpose();
    const auto put = [&](double x, double y, double dx, double dy) {
      cloud_.points.push_back((to_scan * Vec3{x, y, layer.z_mm}).cast<float>());
      // Solid on the left: outward is to the right.
      cloud_.normals.push_back((normals * Vec3{dy, -dx, 0}).normalized().cast<float>());
    };
    for (const Contour& ring : layer.contours)
      for (std::size_t i = 0; i < ring.vertices().size(); ++i) {
        const Point2 a = ring.vertices()[i];
        const Point2 b = ring.vertices()[i + 1 == ring.vertices().size() ? 0 : i + 1];
        put(a.x_mm, a.y_mm, b.x_mm - a.x_mm, b.y_mm - a.y_mm);
        put((a.x_mm + b.x_mm) / 2, (a.y_mm + b.y_mm) / 2, b.x_mm - a.x_mm, b.y_mm - a.y_mm);
      }
  }
  [[nodiscard]] const PointCloud& cloud() const { return cloud_; }

 private:
  PointCloud cloud_;
};

/// The files asked for; all of them are written after the last layer, each whole or not at all.
class Outputs {
 public:
  Outputs(const Options& options, const JobParameters& parameters) : options_{options}, parameters_{parameters} {}

  Result<void> take(const StackHeader& header, const Layer& layer) {
    if (!started_) {
      started_ = true;
      if (!options_.out.empty()) {
        auto writer =
            TfcWriter::start(header, parameters_.codec, [this](std::span<const std::byte> bytes) -> Result<void> {
              tfc_.insert(tfc_.end(), bytes.begin(), bytes.end());
              return {};
            });
        if (!writer) return tl::unexpected{writer.error()};
        writer_ = std::move(*writer);
      }
      if (!options_.preview.empty()) {
        const LayerIndex last{parameters_.slice.layers ? (*parameters_.slice.layers)[1] : header.layer_count - 1};
        preview_.emplace(header, layer.index, last);
      }
    }
    if (!options_.contours.empty()) lines_ += to_json_line(layer) + '\n';
    if (preview_) preview_->add(layer);
    if (!options_.points.empty()) points_.add(header, layer);
    if (writer_) return writer_->add(layer);
    return {};
  }

  Result<void> write(const std::string& report) {
    if (writer_) {
      if (auto digest = writer_->finish(); !digest) return tl::unexpected{digest.error()};
      if (auto ok = write_file_atomically(options_.out, tfc_); !ok) return ok;
    }
    if (!options_.contours.empty())
      if (auto ok = write_file_atomically(options_.contours, lines_); !ok) return ok;
    if (!options_.points.empty())
      if (auto ok =
              write_file_atomically(options_.points, write_ply(points_.cloud(), {}, "contours, frame of the scan"));
          !ok)
        return ok;
    if (preview_) {
      const auto png = preview_->png();
      if (!png) return tl::unexpected{png.error()};
      if (auto ok = write_file_atomically(options_.preview, *png); !ok) return ok;
    }
    if (!options_.report.empty()) return write_file_atomically(options_.report, report + '\n');
    return {};
  }

 private:
  const Options& options_;
  const JobParameters& parameters_;
  bool started_ = false;
  std::string lines_;
  std::vector<std::byte> tfc_;
  std::optional<TfcWriter> writer_;
  std::optional<Preview> preview_;
  ContourPoints points_;
};

void print_gaps(const std::vector<LayerGap>& gaps) {
  for (const bool bridged : {true, false}) {
    const LayerGap* widest = nullptr;
    std::size_t count = 0;
    for (const LayerGap& g : gaps) {
      if (g.bridged != bridged) continue;
      ++count;
      if (!widest || g.size_mm > widest->size_mm) widest = &g;
    }
    if (!widest) continue;
    write_output(fmt::format("{} gaps of contours {}; widest {:.3g} mm in layer {} at ({:.2f}, {:.2f})\n", count,
                             bridged ? "closed by the side that all samples tell" : "left open, and their contours out",
                             widest->size_mm, widest->layer.count(), widest->place.x_mm, widest->place.y_mm));
  }
}

/// One line a reason, the most frequent first, with the layer to look at: the one with the most doubtful contour.
void print_flagged(std::span<const FlaggedLayer> flagged) {
  struct Reason {
    std::size_t layers = 0;
    const FlaggedLayer* worst = nullptr;
  };
  std::map<DoubtReason, Reason> reasons;
  for (const FlaggedLayer& f : flagged) {
    if (!f.certificate.doubt) continue;
    Reason& reason = reasons[f.certificate.doubt->reason];
    ++reason.layers;
    if (!reason.worst || f.doubtful_share > reason.worst->doubtful_share) reason.worst = &f;
  }
  std::vector<Reason> sorted;
  for (const auto& [name, reason] : reasons) sorted.push_back(reason);
  std::stable_sort(sorted.begin(), sorted.end(), [](const auto& a, const auto& b) { return a.layers > b.layers; });
  for (const auto& [layers, worst] : sorted) {
    const auto& place = worst->certificate.doubt->place;
    write_output(fmt::format("  {} layer{}, as layer {} at {:.3f} mm{} ({:.3g} % of its contours): {}\n", layers,
                             layers == 1 ? "" : "s", worst->layer.count(), worst->z_mm,
                             place ? fmt::format(", ({:.2f}, {:.2f})", place->x_mm, place->y_mm) : "",
                             100 * worst->doubtful_share, sentence_of(worst->certificate)));
  }
}

void print_summary(const SliceReport& report) {
  double seconds = 0;
  std::string stages;
  for (const StageTime& t : report.times) {
    seconds += t.seconds;
    stages += fmt::format("{}{} {:.2f} s", stages.empty() ? "" : ", ", t.stage, t.seconds);
  }
  write_output(fmt::format("{}: {} points, {:.2f} x {:.2f} x {:.2f} mm on {}\n", report.header.scan_name, report.points,
                           report.size_mm[0], report.size_mm[1], report.size_mm[2], report.header.machine));
  if (const std::string placed = sentence_of(report.placement); !placed.empty())
    write_output(fmt::format("{}\n", placed));
  if (report.chosen) write_output(fmt::format("{}\n", sentence_of(*report.chosen)));
  write_output(fmt::format("kernel {:.3f} mm{} at a spacing of {:.3f} mm, surface {}\n", report.kernel.kernel_mm,
                           report.kernel.adaptive ? " (median, by local spacing)" : "", report.kernel.spacing_mm,
                           report.surface));
  write_output(fmt::format("{} layers, {} contours, {} vertices in {:.2f} s ({})\n", report.layers_cut, report.contours,
                           report.vertices, seconds, stages));
  if (const CompletionSummary& added = report.completion; added.virtual_samples > 0)
    write_output(
        fmt::format("gaps of the scan closed with {} samples nobody measured, up to {:.3g} mm from the nearest "
                    "measured one; wrong by {:.2g} mm at most (19 of 20)\n",
                    added.virtual_samples, added.largest_gap_mm, added.largest_error_mm));
  print_gaps(report.gaps);
  if (const SpeckSummary& specks = report.specks; specks.rings > 0)
    write_output(fmt::format("{} contours too small to be printed left out in {} layers, the largest of {:.2g} mm2\n",
                             specks.rings, specks.layers.size(), specks.largest_mm2));
  write_output(fmt::format("{} layers certified ({} marched), {} flagged\n", report.certified,
                           report.certified_by_march, report.flagged.size()));
  if (const SurfaceShares& s = report.shares; s.completed_mm + s.doubtful_mm > 0)
    write_output(
        fmt::format("{:.1f} % of the contours completed in {} certified layers, up to {:.2f} mm from a sample, "
                    "possible error {:.2f} mm; {:.1f} % doubtful\n",
                    100 * s.completed_mm / s.length_mm(), report.completed, s.largest_gap_mm, s.largest_error_mm,
                    100 * s.doubtful_mm / s.length_mm()));
  print_flagged(report.flagged);
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  const auto parameters = parameters_from(o);
  if (!parameters) return tl::unexpected{parameters.error()};
  const auto scan = read_file(o.cloud, kMaxScanBytes);
  if (!scan) return tl::unexpected{scan.error()};

  Outputs outputs{o, *parameters};
  const LayerSink sink = [&](const StackHeader& header, Layer&& layer) { return outputs.take(header, layer); };
  int shown = -1;
  const ProgressSink progress = [&, bar = on_terminal()](const Progress& p) {
    const int percent = static_cast<int>(100 * p.fraction);
    if (!bar || percent == shown) return;
    shown = percent;
    write_note(fmt::format("\r{:<10} {:3} %", label_of(p.stage), percent));
  };
  const std::string name = std::filesystem::path{o.cloud}.filename().string();
  const auto report = slice_scan(*scan, name, parameters->slice, sink, progress, stop);
  if (shown >= 0) write_note(fmt::format("\r{:20}\r", ""));
  if (!report) return tl::unexpected{report.error()};

  for (const std::string& warning : report->warnings) write_note(fmt::format("warning: {}\n", warning));
  const std::string json = to_json(*report);
  if (auto ok = outputs.write(json); !ok) return tl::unexpected{ok.error()};
  if (o.json)
    write_output(fmt::format("{}\n", json));
  else
    print_summary(*report);
  return o.require_certified && !report->flagged.empty() ? ExitCode::NotCertified : ExitCode::Ok;
}

}  // namespace

VerbBody declare_slice(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options.add("CLOUD", o->cloud, fmt::format("scan: {}", kReadableScans)).required();
  declare_machine_choice(options, o->machine, "machine profile to slice for", MachineIs::Required);
  options.add_output("--out", o->out, "write the stack here (.tfc)");
  options.add_output("--preview", o->preview, "write a picture here (PNG)");
  options.add_output("--contours", o->contours, "write contours here, one JSON line a layer");
  options.add_output("--points", o->points,
                     "write the contours' vertices and chord middles here, in the frame of the scan (PLY, to measure)");
  options.add_output("--report", o->report, "write the report here (JSON)");
  declare_slice_parameters(options, o->asked);
  options.add("--threads", o->threads, "worker threads; 0: one a core").shows_default();
  options.add("--layers", o->layers, "cut these layers only, FIRST:LAST, counted from 0").read_by(range_from);
  options.flag("--require-certified", o->require_certified, "exit with code 8 if a layer is flagged");
  options.flag("--json", o->json, "print the report as JSON");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
