// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/geometry/limits.hpp>
#include <telefab/scan/inspect/inspect_scan.hpp>
#include <telefab/scan/slicing/placed_surface.hpp>

namespace telefab::scan {

Result<Inspection> inspect_scan(std::span<const std::byte> scan, std::string_view name, const InspectRequest& request,
                                const ProgressSink& progress, std::stop_token stop) {
  SliceRequest place;
  if (request.machine) {
    place.machine = *request.machine;
  } else {
    place.machine.name = "the coordinate limit";
    place.machine.platform = {kMaxCoordinateMm, kMaxCoordinateMm, kMaxCoordinateMm};
  }
  place.placement = request.placement;
  place.mls = request.mls;
  if (auto ok = place.validate(); !ok) return tl::unexpected{ok.error()};

  std::vector<StageTime> times;
  StageClock clock{times};
  IntakeOptions intake = request.intake;
  intake.pick.keep_outliers |= !request.mls.drop_outliers;
  intake.about_origin = !request.machine;
  auto surface = surface_of(scan, name, intake, place, progress, clock, stop);
  if (!surface) return tl::unexpected{surface.error()};
  const PreparedScan& prepared = surface->prepared;
  const MlsField& field = *surface->field;
  clock.lap("surface");

  telefab::report(progress, WorkStage::FindingTopology, 0);
  SurfaceSamples all;
  const Box3 box = field.bounds();
  field.samples_between(box.min.z(), box.max.z(), all);
  TopologyOptions options;
  options.noise_mm = field.kernel().noise_mm;
  auto topology = analyse_height(field, all, options, stop);
  if (!topology) return fail_in(name, topology.error());
  clock.lap("topology");
  std::vector<std::string> warnings = prepared.warnings;
  if (surface->placed.scale_warning) warnings.push_back(*surface->placed.scale_warning);
  return Inspection{.scan_name = std::string{name},
                    .points = prepared.points,
                    .kernel = field.kernel(),
                    .surface = std::string{name_of(request.mls.surface)},
                    .size_mm = surface->placed.size_mm,
                    .placement = surface->placed.options,
                    .chosen = surface->chosen,
                    .pick = prepared.pick,
                    .warnings = std::move(warnings),
                    .normals_json = to_json(prepared.normals),
                    .samples = std::move(all.points),
                    .normals = std::move(all.normals),
                    .topology = std::move(*topology),
                    .times = std::move(times)};
}

std::string to_json(const Inspection& inspection) {
  using Json = nlohmann::ordered_json;
  const auto place = [](const Vec3& p) { return Json::array({p.x(), p.y(), p.z()}); };
  const HeightTopology& t = inspection.topology;
  Json json;
  json["scan"] = inspection.scan_name;
  json["points"] = inspection.points;
  json["size_mm"] = place(inspection.size_mm);
  json["placing"] = json_or_discarded(to_json(inspection.placement));
  json["chosen_standing"] = inspection.chosen ? json_or_discarded(to_json(*inspection.chosen)) : Json(nullptr);
  json["surface"] = inspection.surface;
  const KernelChoice& k = inspection.kernel;
  json["kernel"] = {{"kernel_mm", k.kernel_mm}, {"adaptive", k.adaptive},     {"spacing_mm", k.spacing_mm},
                    {"noise_mm", k.noise_mm},   {"unevenness", k.unevenness}, {"dropped_samples", k.dropped_samples}};
  json["pick"] = json_or_discarded(to_json(inspection.pick));
  json["warnings"] = inspection.warnings;
  json["normals"] = json_or_discarded(inspection.normals_json);
  json["euler"] = t.euler();
  json["euler_is_certain"] = t.euler_is_certain();
  json["components"] = Json::array();
  for (const SurfaceComponent& c : t.components())
    json["components"].push_back({{"euler", c.euler},
                                  {"genus", c.genus ? Json(*c.genus) : Json(nullptr)},
                                  {"nodes", c.nodes},
                                  {"low_mm", c.low_mm},
                                  {"high_mm", c.high_mm}});
  json["critical_points"] = Json::array();
  for (const CriticalPoint& c : t.critical_points()) {
    Json row{{"kind", name_of(c.kind)}, {"place_mm", place(c.position_mm)}, {"normal_up", c.normal_up}};
    row["curvature_per_mm"] = {c.curvature_per_mm[0], c.curvature_per_mm[1]};
    row["persistence_mm"] = std::isfinite(c.persistence_mm) ? Json(c.persistence_mm) : Json();
    row["plateau"] = c.plateau ? Json(*c.plateau) : Json();
    json["critical_points"].push_back(std::move(row));
  }
  json["plateaus"] = Json::array();
  for (const Plateau& p : t.plateaus())
    json["plateaus"].push_back({{"low_mm", p.low_mm},
                                {"high_mm", p.high_mm},
                                {"place_mm", place(p.place_mm)},
                                {"critical_points", p.critical_points}});
  json["nodes"] = Json::array();
  for (const ReebNode& n : t.nodes())
    json["nodes"].push_back({{"low_mm", n.low_mm},
                             {"high_mm", n.high_mm},
                             {"component", n.component},
                             {"below", n.arcs_below},
                             {"above", n.arcs_above},
                             {"resolved", n.resolved}});
  json["arcs"] = Json::array();
  for (const ReebArc& a : t.arcs()) json["arcs"].push_back({{"lower", a.lower}, {"upper", a.upper}, {"hole", a.hole}});
  json["inconsistencies"] = t.inconsistencies();
  json["times_s"] = Json::object();
  for (const StageTime& time : inspection.times) json["times_s"][time.stage] = time.seconds;
  return json_text(json);
}

}  // namespace telefab::scan
