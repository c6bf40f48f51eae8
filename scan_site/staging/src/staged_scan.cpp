// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/staging/staged_scan.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/slicing/standings.hpp>
#include <telefab/scan/slicing/surface_survey.hpp>

namespace telefab::scan {
namespace {

using Json = nlohmann::ordered_json;

Json json_of(const Vec3& v) { return Json::array({v.x(), v.y(), v.z()}); }

Json json_of(const Box3& box) { return {{"min", json_of(box.min)}, {"max", json_of(box.max)}}; }

Box3 box_of(const PointCloud& cloud) {
  Box3 box = Box3::nothing();
  for (const Eigen::Vector3f& p : cloud.points) box.include(Vec3{cloud.origin + p.cast<double>()});
  return box;
}

/// What of the file is not among the points that are left: those stay in the order and with the values they had.
void add_left_out(ShownPoints& shown, const PointCloud& all, const PointCloud& kept) {
  const Eigen::Vector3f moved = (all.origin - kept.origin).cast<float>();
  std::size_t next = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (next < kept.size() && all.points[i] == kept.points[next] && all.origin == kept.origin) {
      ++next;
      continue;
    }
    shown.points.push_back(all.points[i] + moved);
    shown.normals.push_back(Eigen::Vector3f::Zero());
    shown.kinds.push_back(PointKind::LeftOut);
  }
}

}  // namespace

Result<RawScan> raw_scan(std::span<const std::byte> file, std::string_view name, std::stop_token stop) {
  auto read = read_scan_file(file, name, {.most_points = IntakeOptions{}.most_points}, stop);  // as it will be sliced
  if (!read) return tl::unexpected{read.error()};
  const PointCloud& cloud = read->cloud;
  const Box3 box = box_of(cloud);
  RawScan raw;
  Json facts{{"format", name_of(read->format)},
             {"points", cloud.size()},
             {"views", read->views.size()},
             {"box", json_of(box)}};
  facts["unit_mm"] = cloud.unit_mm ? Json(*cloud.unit_mm) : Json(nullptr);
  const auto question = scale_warning(Vec3{box.size() * cloud.unit_mm.value_or(1)}, cloud.unit_mm.value_or(1));
  facts["unit_is_open"] = question && !cloud.unit_mm;
  facts["notes"] = Json::array();
  for (const ScanNote& note : cloud.notes) facts["notes"].push_back(note.text);
  raw.facts_json = json_text(facts);
  raw.picture = CloudPicture{{cloud.origin, cloud.points, cloud.normals, {}}};
  return raw;
}

Result<StagedScan> staged_scan(std::span<const std::byte> file, std::string_view name, const SliceRequest& request,
                               const ProgressSink& progress, std::stop_token stop) {
  std::vector<StageTime> times;
  StageClock clock{times};
  IntakeOptions intake = request.intake;
  intake.pick.keep_outliers |= !request.mls.drop_outliers;
  auto prepared = prepare_scan(file, name, intake, progress, clock, stop);
  if (!prepared) return tl::unexpected{prepared.error()};
  // In millimetres, as everything is that the request says of gaps, thickness and kernel.
  const double scale = print_scale(prepared->cloud, request);
  const auto survey = survey_surface(scaled(prepared->cloud, scale), request, progress, stop);
  if (!survey) return fail_in(name, survey.error());
  clock.lap("surface");

  const Vec3 origin = prepared->cloud.origin;
  ShownPoints shown;
  shown.origin = origin;
  const auto add = [&](const SurfaceSurvey::Sample& s) {
    shown.points.push_back((s.place / scale - origin).cast<float>());
    shown.normals.push_back(s.normal);
    shown.kinds.push_back(static_cast<PointKind>(s.kind));
  };
  for (const SurfaceSurvey::Sample& s : survey->measured) add(s);
  for (const SurfaceSurvey::Sample& s : survey->added) add(s);
  const PickReport& pick = prepared->pick;
  if (pick.cropped + pick.strays + pick.in_other_pieces > 0) {
    // Read once more, to show what was left out; a mesh that is sampled has no such points.
    if (!intake.sample_faces)
      if (const auto all = read_cloud(file, name, {}, stop)) add_left_out(shown, *all, prepared->cloud);
  }

  const auto count = [&](const std::vector<SurfaceSurvey::Sample>& samples, SurfaceClass kind) {
    return std::count_if(samples.begin(), samples.end(), [&](const auto& s) { return s.kind == kind; });
  };
  Json facts{
      {"points", prepared->points},
      {"kept", prepared->cloud.size()},
      {"box", json_of(box_of(prepared->cloud))},
      {"pick", json_or_discarded(to_json(pick))},
      {"measured", count(survey->measured, SurfaceClass::Measured)},
      {"completed", count(survey->added, SurfaceClass::Completed)},
      {"doubtful", count(survey->measured, SurfaceClass::Doubtful) + count(survey->added, SurfaceClass::Doubtful)},
      {"asked", survey->asked},
      {"spacing", survey->spacing / scale},
      {"noise", survey->noise / scale},
      {"largest_gap", survey->largest_gap / scale},
      {"missing_share", survey->open.share()}};
  facts["warnings"] = prepared->warnings;
  for (const std::string& warning : survey->warnings) facts["warnings"].push_back(warning);
  facts["seconds"] = Json::object();
  for (const StageTime& time : times) facts["seconds"][time.stage] = time.seconds;
  const Openness open{survey->open.seen_mm2 / (scale * scale), survey->open.missing_mm2 / (scale * scale)};
  return StagedScan{std::move(*prepared), open, CloudPicture{shown}, json_text(facts)};
}

}  // namespace telefab::scan
