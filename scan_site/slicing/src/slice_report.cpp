// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>
#include <telefab/base/json_text.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

LayerCosts layer_costs(const SliceReport& report) {
  std::vector<std::uint64_t> sorted = report.layer_evaluations;
  if (sorted.empty()) return {};
  std::sort(sorted.begin(), sorted.end());
  return {std::accumulate(sorted.begin(), sorted.end(), std::uint64_t{0}), sorted[sorted.size() / 2], sorted.back()};
}

std::string to_json(const SliceReport& report) {
  using nlohmann::ordered_json;
  const StackHeader& h = report.header;
  ordered_json rows = ordered_json::array();
  for (std::size_t r = 0; r < 4; ++r)
    rows.push_back(
        {h.scan_to_build[4 * r], h.scan_to_build[4 * r + 1], h.scan_to_build[4 * r + 2], h.scan_to_build[4 * r + 3]});
  ordered_json flagged = ordered_json::array();
  for (const FlaggedLayer& f : report.flagged) {
    ordered_json entry{{"layer", f.layer.count()}, {"z_mm", f.z_mm}};
    if (const auto& doubt = f.certificate.doubt) {
      entry["reason"] = name_of(doubt->reason);
      entry["text"] = sentence_of(f.certificate);
      if (doubt->place) entry["place_mm"] = {doubt->place->x_mm, doubt->place->y_mm};
      entry["doubtful_share"] = f.doubtful_share;
    }
    flagged.push_back(std::move(entry));
  }
  ordered_json gaps = ordered_json::array();
  for (const LayerGap& g : report.gaps)
    gaps.push_back({{"layer", g.layer.count()},
                    {"z_mm", g.z_mm},
                    {"place_mm", {g.place.x_mm, g.place.y_mm}},
                    {"size_mm", g.size_mm},
                    {"bridged", g.bridged}});
  ordered_json speck_layers = ordered_json::array();
  for (const LayerIndex layer : report.specks.layers) speck_layers.push_back(layer.count());
  ordered_json times = ordered_json::object();
  for (const StageTime& t : report.times) times[t.stage] = t.seconds;
  const auto parsed = [](const std::string& text) {
    ordered_json value = json_or_discarded(text);
    return value.is_discarded() ? ordered_json(nullptr) : value;
  };
  const LayerCosts costs = layer_costs(report);
  const ordered_json root{
      {"scan", h.scan_name},
      {"machine", h.machine},
      {"points", report.points},
      {"size_mm", report.size_mm},
      {"placing", parsed(to_json(report.placement))},
      {"chosen_standing", report.chosen ? parsed(to_json(*report.chosen)) : ordered_json(nullptr)},
      {"scan_to_build", rows},
      {"layer_mm", h.layer_thickness_mm},
      {"layers", h.layer_count},
      {"layers_cut", report.layers_cut},
      {"surface", report.surface},
      {"method", report.method},
      {"kernel",
       {{"spacing_mm", report.kernel.spacing_mm},
        {"unevenness", report.kernel.unevenness},
        {"noise_mm", report.kernel.noise_mm},
        {"width_mm", report.kernel.kernel_mm},
        {"adaptive", report.kernel.adaptive},
        {"dropped_samples", report.kernel.dropped_samples}}},
      {"pick", parsed(to_json(report.pick))},
      {"normals", parsed(report.normals_json)},
      {"certified", report.certified},
      {"certified_by_march", report.certified_by_march},
      {"completed", report.completed},
      {"flagged", report.flagged.size()},
      {"flagged_layers", flagged},
      {"surface_mm",
       {{"measured", report.shares.measured_mm},
        {"completed", report.shares.completed_mm},
        {"doubtful", report.shares.doubtful_mm},
        {"largest_gap", report.shares.largest_gap_mm},
        {"largest_error", report.shares.largest_error_mm}}},
      {"gaps", gaps},
      {"open",
       {{"seen_mm2", report.open.seen_mm2},
        {"missing_mm2", {report.open.missing_mm2.x(), report.open.missing_mm2.y(), report.open.missing_mm2.z()}},
        {"share", report.open.share()}}},
      {"completion",
       {{"rim_samples", report.completion.rim_samples},
        {"virtual_samples", report.completion.virtual_samples},
        {"largest_gap_mm", report.completion.largest_gap_mm},
        {"largest_error_mm", report.completion.largest_error_mm}}},
      {"specks",
       {{"below_mm2", report.specks.least_mm2},
        {"rings", report.specks.rings},
        {"largest_mm2", report.specks.largest_mm2},
        {"layers", speck_layers}}},
      {"warnings", report.warnings},
      {"contours", report.contours},
      {"vertices", report.vertices},
      {"evaluations", costs.all},
      {"median_layer_evaluations", costs.median},
      {"most_layer_evaluations", costs.most},
      {"critical_points", report.critical_points},
      {"surface_euler", report.surface_euler ? ordered_json(*report.surface_euler) : ordered_json(nullptr)},
      {"inconsistencies", report.inconsistencies},
      {"seconds", times}};
  return json_text(root);
}

}  // namespace telefab::scan
