// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/prepare_scan.hpp>

#include <algorithm>
#include <telefab/scan/cloud/two_sheets.hpp>
#include <telefab/scan/formats/face_samples.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/slicing/orient_cloud.hpp>

namespace telefab::scan {
namespace {

Result<PointCloud> read_points(std::span<const std::byte> scan, std::string_view name, const IntakeOptions& options,
                               std::stop_token stop) {
  auto file = read_scan_file(scan, name,
                             {.keep_faces = true, .most_points = options.most_points, .let_go = options.let_go}, stop);
  if (options.let_go) options.let_go();
  if (!file) return tl::unexpected{file.error()};
  if (!options.sample_faces) return cloud_of(std::move(*file));
  auto sampled = sample_faces(*file, stop);
  if (!sampled) return fail_in(name, sampled.error());
  return sampled;
}

}  // namespace

void StageClock::lap(std::string stage) {
  const Nanoseconds now = clock_.now();
  times_.push_back({std::move(stage), std::chrono::duration<double>(now - since_).count()});
  since_ = now;
}

Result<PreparedScan> prepare_scan(std::span<const std::byte> scan, std::string_view name, const IntakeOptions& options,
                                  const ProgressSink& progress, StageClock& clock, std::stop_token stop) {
  report(progress, WorkStage::ReadingScan, 0);
  auto cloud = read_points(scan, name, options, stop);
  if (!cloud) return tl::unexpected{cloud.error()};
  PreparedScan prepared;
  prepared.points = cloud->size();
  for (const ScanNote& note : cloud->notes) {
    prepared.warnings.push_back(note.text);
    prepared.has_empty_faces |= note.remark == ScanRemark::EmptyFaces;
    prepared.is_thinned |= note.remark == ScanRemark::Thinned;
  }
  clock.lap("reading");

  report(progress, WorkStage::PickingObject, 0);
  PickOptions pick = options.pick;
  // The corners of a drawing are far apart and all of them true.
  pick.keep_outliers |= prepared.has_empty_faces;
  auto picked = pick_object(std::move(*cloud), pick, stop);
  if (!picked) return fail_in(name, picked.error());
  prepared.pick = std::move(picked->report);
  for (std::string& sentence : sentences_of(prepared.pick)) prepared.warnings.push_back(std::move(sentence));
  clock.lap("picking the object");

  report(progress, WorkStage::FindingNormals, 0);
  auto oriented = orient_cloud(std::move(picked->cloud), std::move(picked->graph), stop);
  if (!oriented) return fail_in(name, oriented.error());
  for (std::string& sentence : oriented->warnings) prepared.warnings.push_back(std::move(sentence));
  prepared.normals = oriented->report;
  prepared.cloud = std::move(oriented->cloud);
  clock.lap("normals");

  if (prepared.cloud.sheets_apart.empty()) {
    const auto marked = mark_two_sheets(prepared.cloud, stop);
    if (!marked) return tl::unexpected{marked.error()};
    prepared.sheets_are_guessed = *marked > 0;
    clock.lap("sheets");
  }
  return prepared;
}

}  // namespace telefab::scan
