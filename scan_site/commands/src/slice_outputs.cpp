// SPDX-License-Identifier: GPL-3.0-or-later
#include "slice_outputs.hpp"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <span>
#include <telefab/base/file.hpp>
#include <telefab/codec/tfc_file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/command_line/program.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/slicing/preview.hpp>

namespace telefab::scan {
namespace {

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

}  // namespace

void declare_slice_outputs(VerbOptions& options, SliceOutputChoice& choice) {
  options.add_output("--out", choice.stack, "write the stack here (.tfc)");
  options.add_output("--preview", choice.preview, "write a picture here (PNG)");
  options.add_output("--contours", choice.contours, "write contours here, one JSON line a layer");
  options.add_output("--points", choice.points,
                     "write the contours' vertices and chord middles here, in the frame of the scan (PLY, to measure)");
  options.add_output("--report", choice.report, "write the report here (JSON)");
  options.flag("--require-certified", choice.require_certified, "exit with code 8 if a layer is flagged");
  options.flag("--json", choice.json, "print the report as JSON");
}

struct SliceOutputs::Begun {
  std::string lines;
  std::vector<std::byte> tfc;
  std::optional<TfcWriter> writer;
  std::optional<Preview> preview;
  ContourPoints points;
};

SliceOutputs::SliceOutputs(const SliceOutputChoice& choice, const CodecOptions& codec)
    : choice_{choice}, codec_{codec} {}
SliceOutputs::~SliceOutputs() = default;

Result<void> SliceOutputs::take(const StackHeader& header, const Layer& layer, std::uint32_t end) {
  if (!begun_) {
    begun_ = std::make_unique<Begun>();
    if (!choice_.stack.empty()) {
      auto writer =
          TfcWriter::start(header, codec_, [begun = begun_.get()](std::span<const std::byte> bytes) -> Result<void> {
            begun->tfc.insert(begun->tfc.end(), bytes.begin(), bytes.end());
            return {};
          });
      if (!writer) return tl::unexpected{writer.error()};
      begun_->writer = std::move(*writer);
    }
    if (!choice_.preview.empty()) begun_->preview.emplace(header, layer.index, LayerIndex{end - 1});
  }
  if (!choice_.contours.empty()) begun_->lines += to_json_line(layer) + '\n';
  if (begun_->preview) begun_->preview->add(layer);
  if (!choice_.points.empty()) begun_->points.add(header, layer);
  if (begun_->writer) return begun_->writer->add(layer);
  return {};
}

Result<void> SliceOutputs::write(const std::string& report) {
  if (!begun_) begun_ = std::make_unique<Begun>();
  if (begun_->writer) {
    if (auto digest = begun_->writer->finish(); !digest) return tl::unexpected{digest.error()};
    if (auto ok = write_file_atomically(choice_.stack, begun_->tfc); !ok) return ok;
  }
  if (!choice_.contours.empty())
    if (auto ok = write_file_atomically(choice_.contours, begun_->lines); !ok) return ok;
  if (!choice_.points.empty())
    if (auto ok =
            write_file_atomically(choice_.points, write_ply(begun_->points.cloud(), {}, "contours, frame of the scan"));
        !ok)
      return ok;
  if (begun_->preview) {
    const auto png = begun_->preview->png();
    if (!png) return tl::unexpected{png.error()};
    if (auto ok = write_file_atomically(choice_.preview, *png); !ok) return ok;
  }
  if (!choice_.report.empty()) return write_file_atomically(choice_.report, report + '\n');
  return {};
}

ProgressSink progress_bar(int& shown) {
  shown = -1;
  return [&shown, bar = on_terminal()](const Progress& p) {
    const int percent = static_cast<int>(100 * p.fraction);
    if (!bar || percent == shown) return;
    shown = percent;
    write_note(fmt::format("\r{:<10} {:3} %", label_of(p.stage), percent));
  };
}

void end_progress_bar(int shown) {
  if (shown >= 0) write_note(fmt::format("\r{:20}\r", ""));
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

ExitCode verdict_of(const SliceReport& report, const SliceOutputChoice& choice) {
  return choice.require_certified && !report.flagged.empty() ? ExitCode::NotCertified : ExitCode::Ok;
}

}  // namespace telefab::scan
