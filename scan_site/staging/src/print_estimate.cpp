// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/staging/print_estimate.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/machine/rough_print_time.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/slicing/standings.hpp>
#include <telefab/scan/slicing/surface_survey.hpp>

namespace telefab::scan {
namespace {

constexpr std::array<std::string_view, 4> kVerdicts{"pass", "warning", "held", "not-known"};
constexpr double kMm3PerMl = 1000;
/// A hollow that keeps more liquid than this is worth a word.
constexpr double kTrapped_mm3 = 50;
/// A vat is not emptied: so much of what it holds can be printed.
constexpr double kUsableShare = 0.9;

/// Where nobody asks for a size and the one it has is hardly meant.
std::optional<std::string> unit_warning(const PreparedScan& prepared, const SliceRequest& request) {
  const PlacementOptions& p = request.placement;
  if (p.height_mm || p.scale || p.fit) return std::nullopt;
  const double unit_mm = p.unit_mm.value_or(prepared.cloud.unit_mm.value_or(1));
  return scale_warning(Vec3{unit_mm * size_of(prepared.cloud)}, unit_mm);
}

std::vector<ForeseenItem> items_of(const PrintEstimate& e, const PreparedScan& prepared, const SliceRequest& request) {
  const MachineProfile& machine = request.machine;
  const StandingFigures& f = e.figures;
  std::vector<ForeseenItem> items;
  const auto add = [&](std::string name, Verdict verdict, std::string text) {
    items.push_back({std::move(name), verdict, std::move(text)});
  };
  add("size", Verdict::Pass,
      fmt::format("{:.1f} x {:.1f} x {:.1f} mm on a platform of {:g} x {:g} mm with {:g} mm of travel", f.size_mm.x(),
                  f.size_mm.y(), f.size_mm.z(), machine.platform.width_mm, machine.platform.depth_mm,
                  machine.platform.z_travel_mm));
  if (const auto warning = unit_warning(prepared, request)) add("unit", Verdict::Warning, *warning);
  if (f.is_lifted)
    add("supports", Verdict::Pass,
        fmt::format("{} anchors, about {:.0f} mm3; the part is lifted off the platform", f.anchors, f.support_mm3));
  else
    add("supports", Verdict::Pass,
        f.anchors > 0
            ? fmt::format("{} anchors, about {:.0f} mm3; it stands on a side of its own", f.anchors, f.support_mm3)
            : std::string{"none are needed: it stands on a side of its own"});
  if (!f.is_lifted && f.stability < 0)
    add("stability", Verdict::Warning, "its middle is outside of what it stands on: it would lean; turn it");
  if (f.trapped_mm3 > kTrapped_mm3)
    add("hollows", Verdict::Warning,
        fmt::format(
            "about {:.1f} ml of resin stays in cups and hollows while it grows; turned otherwise it may run out",
            f.trapped_mm3 / kMm3PerMl));
  if (const double vat_ml = machine.resin.vat_ml; vat_ml > 0)
    add("resin", e.resin_ml > kUsableShare * vat_ml ? Verdict::Warning : Verdict::Pass,
        fmt::format("about {:.1f} ml of the {:g} ml that the vat holds", e.resin_ml, vat_ml));
  else
    add("resin", Verdict::NotKnown,
        fmt::format("about {:.1f} ml; the profile does not state what the vat holds", e.resin_ml));
  const double pitch_mm = machine.projection.pixel_pitch_mm;
  const double least_mm = f.size_mm.minCoeff();
  add("thin features", least_mm < 2 * pitch_mm ? Verdict::Warning : Verdict::NotKnown,
      least_mm < 2 * pitch_mm
          ? fmt::format("the part is {:.3f} mm thin at most, less than two pixels of {:g} mm", least_mm, pitch_mm)
          : fmt::format("walls and pins thinner than two pixels ({:g} mm) are found when the masks are made",
                        2 * pitch_mm));
  if (!machine.assumed.empty())
    add("profile", Verdict::NotKnown,
        fmt::format("{} values of the profile are assumed, neither published nor measured", machine.assumed.size()));
  add("masks and light", Verdict::NotKnown,
      "islands, dose and what holds while it grows: the fab tells once it has planned");
  return items;
}

/// What of the surface is missing where it stands so; nothing where that is no word worth.
std::optional<ForeseenItem> surface_item(const StagedScan& scan, const SliceRequest& stood) {
  const double scale = print_scale(scan.prepared.cloud, stood);
  const Openness open{scale * scale * scan.open.seen_mm2, scale * scale * scan.open.missing_mm2};
  const StoodOpenness judged = judged_openness(open, stood, stood.placement.turn);
  if (judged.refusal) return ForeseenItem{"surface", Verdict::Held, "it would not be cut: " + *judged.refusal};
  if (judged.warning) return ForeseenItem{"surface", Verdict::Warning, *judged.warning};
  return std::nullopt;
}

}  // namespace

std::string_view name_of(Verdict verdict) { return kVerdicts[static_cast<std::size_t>(verdict) - 1]; }

Result<PrintEstimate> estimate_print(const StagedScan& scan, const SliceRequest& request, std::stop_token stop) {
  const PreparedScan& prepared = scan.prepared;
  // As slicing does: what nobody states is asked, and not guessed.
  if (const auto warning = unit_warning(prepared, request);
      warning && !request.placement.unit_mm && !prepared.cloud.unit_mm)
    return fail(ErrorCode::InvalidInput, *warning);
  PrintEstimate estimate;
  SliceRequest stood = request;
  if (const auto goal = request.placement.stand_for) {
    const auto chosen = chosen_standing(prepared.cloud, request, *goal, stop);
    if (!chosen) return tl::unexpected{chosen.error()};
    estimate.figures = chosen->standing.figures;
    stood.placement.turn = chosen->standing.turn;
  } else {
    const auto standing = standing_of(prepared.cloud, request, stop);
    if (!standing) return tl::unexpected{standing.error()};
    estimate.figures = standing->figures;
  }
  estimate.layer_mm = request.layer_mm.value_or(request.machine.layers.thickness_mm);
  estimate.resin_ml = (estimate.figures.part_mm3 + estimate.figures.support_mm3) / kMm3PerMl;
  estimate.print_time = rough_print_time(request.machine, estimate.figures.layers, estimate.layer_mm);
  estimate.items = items_of(estimate, prepared, request);
  if (auto surface = surface_item(scan, stood)) estimate.items.insert(estimate.items.begin(), std::move(*surface));
  return estimate;
}

std::string to_json(const PrintEstimate& estimate) {
  nlohmann::ordered_json json{{"figures", json_or_discarded(to_json(estimate.figures))},
                              {"layer_mm", estimate.layer_mm},
                              {"resin_ml", estimate.resin_ml},
                              {"seconds", estimate.print_time.count()}};
  json["cost"] = nullptr;
  if (const auto& price = estimate.price)
    json["cost"] = {
        {"amount", price->of_ml(estimate.resin_ml)}, {"currency", price->currency}, {"per_litre", price->per_litre}};
  json["items"] = nlohmann::ordered_json::array();
  for (const ForeseenItem& item : estimate.items)
    json["items"].push_back({{"name", item.name}, {"verdict", name_of(item.verdict)}, {"text", item.text}});
  return json_text(json);
}

}  // namespace telefab::scan
