// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/planning/preflight.hpp>

#include "preflight_carry.hpp"
#include "preflight_contours.hpp"

namespace telefab::fab {
namespace {

using Verdict = PreflightItem::Verdict;

PreflightItem size_of(const LayerStack& stack, const MachineProfile& machine, const PlanSummary& summary) {
  const Bounds2 all = bounds_of(stack.layers());
  const double height_mm = static_cast<double>(summary.plan.layers.size()) * stack.header().layer_thickness_mm;
  PreflightItem item{"size", Verdict::Passed, {}, height_mm, "mm", {}, {}};
  item.text = fmt::format("{:.1f} x {:.1f} mm, {:.1f} mm high with its supports, fits {} x {} x {} mm",
                          std::max(0.0, all.width_mm()), std::max(0.0, all.depth_mm()), height_mm,
                          machine.platform.width_mm, machine.platform.depth_mm, machine.platform.z_travel_mm);
  return item;
}

/// How well the views of the scan lie on each other. Half a pixel is what masks can still show.
PreflightItem registration_of(const LayerStack& stack, const PlanSummary& summary) {
  const double error_mm = summary.registration_rms_mm;
  const double most_mm = stack.header().pixel_pitch_mm / 2;
  const bool is_fine = error_mm <= most_mm;
  return {"registration",
          is_fine ? Verdict::Passed : Verdict::Warning,
          fmt::format("the scan's views lie on each other within {:.3f} mm as printed, {} half a pixel ({:.3f} mm)",
                      error_mm, is_fine ? "within" : "more than", most_mm),
          error_mm,
          "mm",
          {},
          {}};
}

/// Findings of some kinds as one item.
PreflightItem findings_of(std::string name, Verdict verdict, std::initializer_list<Finding::Kind> kinds,
                          const SupportReport& check, std::string_view none) {
  PreflightItem item{std::move(name), Verdict::Passed, std::string{none}, 0.0, "findings", {}, {}};
  const Finding* first = nullptr;
  std::size_t count = 0;
  for (const Finding& finding : check.findings)
    if (std::ranges::find(kinds, finding.kind) != kinds.end()) {
      ++count;
      if (!first) first = &finding;
    }
  if (!first) return item;
  item.verdict = verdict;
  item.value = static_cast<double>(count);
  item.layer = first->layer;
  item.place = first->place;
  item.text =
      fmt::format("{} found; the first: {} in layer {} at ({:.1f}, {:.1f}) mm, {:.2f} mm2", count, name_of(first->kind),
                  first->layer.count(), first->place.x_mm, first->place.y_mm, first->size_mm2);
  return item;
}

/// A figure against a limit of the profile, where 0 stands for a limit that nobody stated.
PreflightItem against(std::string name, double value, std::string unit, double limit, std::string text,
                      std::string_view key) {
  PreflightItem item{std::move(name), Verdict::Passed, std::move(text), value, std::move(unit), {}, {}};
  if (limit <= 0) {
    item.verdict = Verdict::NotKnown;
    item.text += fmt::format("; {} of the profile says no limit", key);
  } else if (value > limit) {
    item.verdict = Verdict::Held;
    item.text += fmt::format("; the limit is {:.1f} {} ({})", limit, item.unit, key);
  } else {
    item.text += fmt::format(", of {:.1f} {}", limit, item.unit);
  }
  return item;
}

/// A layer that a full exposure does not cure through sticks to nothing, whatever the masks are.
PreflightItem dose_of(const LayerStack& stack, const PlanSummary& summary) {
  constexpr double kSafeLayers = 1.2;
  const double layer_mm = stack.header().layer_thickness_mm;
  PreflightItem item{"dose", Verdict::Passed, {}, summary.cure_depth_mm, "mm", {}, {}};
  item.text = fmt::format("{:.1f} mJ/cm2 cure {:.3f} mm deep, layers are {} mm", summary.white_dose_mj_per_cm2,
                          std::max(0.0, summary.cure_depth_mm), layer_mm);
  if (const auto& band = summary.calibration)
    item.text += fmt::format(" ({:.3f} to {:.3f} by the calibration, 95 %)", band->least_depth_mm, band->most_depth_mm);
  if (summary.cure_depth_mm < layer_mm) {
    item.verdict = Verdict::Held;
    item.text += ": they would not stick together. Expose longer, or calibrate resin and irradiance";
  } else if (summary.calibration && summary.calibration->least_depth_mm < layer_mm) {
    item.verdict = Verdict::Held;
    item.text +=
        ": at the lower end they would not stick together. Expose longer, or measure more depths and fit again";
  } else if (summary.cure_depth_mm < kSafeLayers * layer_mm) {
    item.verdict = Verdict::Warning;
    item.text += fmt::format(": less than {} layers leave no room for error", kSafeLayers);
  }
  return item;
}

std::string place_of(const ThinFeature& feature, std::string_view kind) {
  return fmt::format("a {} of {:.3f} mm in layer {} at ({:.1f}, {:.1f}) mm", kind, feature.place.width_mm,
                     feature.layer.count(), feature.place.middle.x_mm, feature.place.middle.y_mm);
}

/// Of a wall and a gap the one that is worse, with its name.
template <class Worse>
std::pair<const ThinFeature*, std::string_view> worse_of(const std::optional<ThinFeature>& wall,
                                                         const std::optional<ThinFeature>& gap, Worse is_worse) {
  if (wall && (!gap || is_worse(*wall, *gap))) return {&*wall, "wall"};
  return {gap ? &*gap : nullptr, "gap"};
}

/// Walls and gaps that the pixels are too coarse for.
PreflightItem features_of(const LayerStack& stack, const ThinReport& thin) {
  const double finest_mm = kFinestFeature_px * stack.header().pixel_pitch_mm;
  PreflightItem item{"features", Verdict::Passed, {}, {}, "mm", {}, {}};
  const auto [narrowest, kind] =
      worse_of(thin.walls.narrowest, thin.gaps.narrowest,
               [](const ThinFeature& a, const ThinFeature& b) { return a.place.width_mm < b.place.width_mm; });
  if (thin.walls.fine_layers + thin.gaps.fine_layers == 0) {
    item.text = fmt::format("no wall or gap is narrower than a pixel, {:.3f} mm", finest_mm);
    return item;
  }
  item.verdict = Verdict::Warning;
  item.value = narrowest->place.width_mm;
  item.layer = narrowest->layer;
  item.place = narrowest->place.middle;
  item.text = fmt::format(
      "{} layers have walls and {} layers gaps narrower than a pixel, {:.3f} mm; the narrowest: {}. Scale the part up, "
      "or print it with finer pixels",
      thin.walls.fine_layers, thin.gaps.fine_layers, finest_mm, place_of(*narrowest, kind));
  return item;
}

std::string borne(double percent) {
  return percent < 0 ? std::string{"is lost as planned"} : fmt::format("bears {:.1f} %", percent);
}

/// Walls and gaps that a small error of the dose loses, or one as large as the calibration leaves possible.
PreflightItem latitude_of(const ThinReport& thin, const std::optional<CalibrationBand>& calibration) {
  constexpr double kPercent = 100;
  PreflightItem item{"latitude", Verdict::Passed, {}, {}, "%", {}, {}};
  if (!thin.dose_known) {
    item.verdict = Verdict::NotKnown;
    item.text = "the profile has no figures for light and resin, so nobody knows what thin features bear";
    return item;
  }
  const auto [weakest, kind] =
      worse_of(thin.walls.weakest, thin.gaps.weakest,
               [](const ThinFeature& a, const ThinFeature& b) { return *a.latitude < *b.latitude; });
  if (!weakest) {
    item.text = "no wall or gap is so thin that it depends on the dose";
    return item;
  }
  item.value = kPercent * *weakest->latitude;
  item.layer = weakest->layer;
  item.place = weakest->place.middle;
  const std::string which = place_of(*weakest, kind);
  // What is lost in any case is said below; this is what the calibration leaves open.
  if (calibration && *weakest->latitude >= 0 && *weakest->latitude < calibration->dose_share) {
    item.verdict = Verdict::Held;
    item.text = fmt::format(
        "the calibration knows the dose to {:.1f} % (95 %), and less loses thin features; the weakest: {}, {}. Measure "
        "more depths and fit again, or scale the part up",
        kPercent * calibration->dose_share, which, borne(*item.value));
    return item;
  }
  if (*weakest->latitude >= kDoseTolerance) {
    item.text = fmt::format("the dose may be wrong by {:.0f} % before thin features are lost; the first: {}",
                            *item.value, which);
    return item;
  }
  item.verdict = Verdict::Warning;
  item.text =
      fmt::format("{:.0f} % less dose loses walls in {} layers, {:.0f} % more closes gaps in {}; the weakest: {}, {}",
                  kPercent * kDoseTolerance, thin.walls.weak_layers, kPercent * kDoseTolerance, thin.gaps.weak_layers,
                  which, borne(*item.value));
  return item;
}

/// How the masks were made, and whether time was enough.
/// What of the profile nobody vouches for.
PreflightItem profile_of(const MachineProfile& machine) {
  return {
      "profile",
      Verdict::NotKnown,
      fmt::format("assumed, neither published nor measured: {}; calibrate, state what you found and take it off the "
                  "profile's list `assumed`",
                  fmt::join(machine.assumed, ", ")),
      static_cast<double>(machine.assumed.size()),
      "keys",
      {},
      {}};
}

PreflightItem masks_of(const PlanSummary& summary) {
  const BlendFigures& figures = summary.mask_figures;
  PreflightItem item{"masks", Verdict::Passed, {}, figures.residual_px(), "px", {}, {}};
  item.text = fmt::format("by {}", name_of(summary.masks));
  if (!summary.origin.empty()) {
    item.value.reset();
    item.text =
        "as they came, judged as if half of white and more were solid: what is held up by the light of later layers "
        "alone "
        "counts as floating";
  } else if (summary.masks == MaskMethod::Cover) {
    item.value.reset();
    item.text += ": the share of each pixel that the part covers, no dose is computed";
  } else {
    item.text +=
        fmt::format(": {:.0f} px of contour solved to {:.4f} px rms", figures.length_px, figures.residual_px());
  }
  if (summary.pattern.kind != InnerPattern::Kind::Solid)
    item.text +=
        fmt::format(", {} inside of a shell of {} mm", name_of(summary.pattern.kind), summary.pattern.shell_mm);
  if (figures.unsolved > 0) {
    item.verdict = Verdict::Warning;
    item.text += fmt::format("; time was out for {} of {} tiles, which keep the cover of their pixels",
                             figures.unsolved, figures.unsolved + figures.tiles);
  }
  return item;
}

std::string duration(double seconds) {
  const auto minutes = static_cast<long>(seconds / 60 + 0.5);
  return minutes < 60 ? fmt::format("{} min", minutes) : fmt::format("{} h {} min", minutes / 60, minutes % 60);
}

}  // namespace

std::string_view name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::Passed:
      return "passed";
    case Verdict::Warning:
      return "warning";
    case Verdict::Held:
      return "held";
    case Verdict::NotKnown:
      return "not-known";
  }
  return "not-known";
}

bool Preflight::holds() const {
  return std::ranges::any_of(items, [](const PreflightItem& item) { return item.verdict == Verdict::Held; });
}

std::string Preflight::why_held() const {
  std::string why;
  for (const PreflightItem& item : items)
    if (item.verdict == Verdict::Held) why += fmt::format("{}{}: {}", why.empty() ? "" : "; ", item.name, item.text);
  return why;
}

Preflight preflight_of(const LayerStack& stack, const MachineProfile& machine, const PlanSummary& summary) {
  Preflight preflight;
  auto& items = preflight.items;
  items.push_back(size_of(stack, machine, summary));
  if (!summary.origin.empty()) items.push_back({"file", Verdict::Passed, summary.origin, {}, "", {}, {}});
  items.push_back(certificates_of(stack, summary));
  items.push_back(empty_layers_of(stack, summary));
  items.push_back(surface_of(stack, summary));
  if (summary.registration_rms_mm > 0) items.push_back(registration_of(stack, summary));
  items.push_back(dose_of(stack, summary));
  items.push_back(masks_of(summary));
  items.push_back(features_of(stack, summary.thin));
  items.push_back(latitude_of(summary.thin, summary.calibration));
  using Kind = Finding::Kind;
  items.push_back(
      findings_of("islands", Verdict::Held, {Kind::Island, Kind::OutOfReach}, summary.check, "nothing floats"));
  items.push_back(findings_of("supports", Verdict::Held, {Kind::FreePin, Kind::TrappedSupport}, summary.check,
                              "no support is loose or trapped"));
  if (summary.figures.unreached > 0)
    items.push_back({"unreached",
                     Verdict::Held,
                     fmt::format("{} places that need support got none: no pin reaches them from the platform, and "
                                 "supports.ground keeps pins off the part",
                                 summary.figures.unreached),
                     static_cast<double>(summary.figures.unreached),
                     {},
                     {},
                     {}});
  items.push_back(findings_of("hollows", Verdict::Warning, {Kind::SuctionCup, Kind::ResinTrap}, summary.check,
                              "no hollow holds a vacuum or liquid resin"));
  items.push_back(carry_of(machine, summary));
  const double resin_ml = summary.resin_ml();
  items.push_back(against("resin", resin_ml, "ml", machine.resin.vat_ml,
                          fmt::format("{:.1f} ml of resin, supports included", resin_ml), "resin.vat_ml"));
  if (!machine.assumed.empty()) items.push_back(profile_of(machine));
  // What the pull asks of the print is known; what it asks of the lift only where the profile says it.
  if (machine.platform.most_peel_mm2 > 0) {
    PreflightItem pull =
        against("peel", summary.peel.most_mm2, "mm2", machine.platform.most_peel_mm2,
                fmt::format("layer {} is the largest, {:.0f} mm2", summary.peel.layer.count(), summary.peel.most_mm2),
                "platform.most_peel_mm2");
    pull.layer = summary.peel.layer;
    items.push_back(std::move(pull));
  }
  items.push_back(
      {"time",
       Verdict::Passed,
       fmt::format("{} of print, of that {} of light", duration(summary.print_s), duration(summary.exposure_s)),
       summary.print_s,
       "s",
       {},
       {}});
  return preflight;
}

std::string to_json(const Preflight& preflight) {
  using nlohmann::ordered_json;
  ordered_json items = ordered_json::array();
  for (const PreflightItem& item : preflight.items) {
    ordered_json value{{"name", item.name}, {"verdict", name_of(item.verdict)}, {"text", item.text}};
    value["value"] = item.value ? ordered_json(*item.value) : ordered_json{};
    value["unit"] = item.unit;
    if (item.layer) value["layer"] = item.layer->count();
    if (item.place) value["place"] = {item.place->x_mm, item.place->y_mm};
    items.push_back(std::move(value));
  }
  return json_text({{"verdict", preflight.holds() ? "held" : "passed"}, {"items", items}}, 1) + "\n";
}

std::string to_text(const Preflight& preflight) {
  std::string text;
  for (const PreflightItem& item : preflight.items)
    text += fmt::format("  {:<9} {:<13} {}\n", name_of(item.verdict), item.name, item.text);
  return text;
}

Result<Preflight> preflight_from_json(std::string_view text) {
  try {
    Preflight preflight;
    const auto all = parsed_json(text);
    for (const auto& value : all.at("items")) {
      PreflightItem item;
      item.name = value.at("name").get<std::string>();
      item.text = value.at("text").get<std::string>();
      item.unit = value.value("unit", "");
      if (value.contains("value") && value["value"].is_number()) item.value = value["value"].get<double>();
      if (value.contains("layer")) item.layer = LayerIndex{whole_number<std::uint32_t>(value["layer"])};
      if (value.contains("place"))
        item.place = Point2{value["place"].at(0).get<double>(), value["place"].at(1).get<double>()};
      const auto verdict = value.at("verdict").get<std::string>();
      // What is not understood holds.
      item.verdict = Verdict::Held;
      for (const Verdict known : {Verdict::Passed, Verdict::Warning, Verdict::NotKnown})
        if (name_of(known) == verdict) item.verdict = known;
      preflight.items.push_back(std::move(item));
    }
    if (all.at("verdict") != "passed" && !preflight.holds())
      return fail(ErrorCode::InvalidInput, "preflight: it is held, but no item of it is");
    return preflight;
  } catch (const nlohmann::ordered_json::exception& e) {
    return fail(ErrorCode::InvalidInput, std::string{"preflight: not as expected: "} + e.what());
  }
}

Result<Preflight> preflight_in(const std::filesystem::path& folder) {
  constexpr std::uint64_t kLargestPreflight = 64U << 20U;
  const auto path = folder / "preflight.json";
  const auto bytes = read_file(path, kLargestPreflight);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto preflight = preflight_from_json({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
  if (!preflight) return fail_in(path.string(), preflight.error());
  return preflight;
}

Result<std::string> let_through(const Preflight& preflight, std::string_view names) {
  std::set<std::string, std::less<>> named;
  for (std::string_view rest = names; !rest.empty();) {
    const std::size_t end = std::min(rest.find(','), rest.size());
    const std::string_view name = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    const bool is_known = std::any_of(preflight.items.begin(), preflight.items.end(),
                                      [&](const PreflightItem& item) { return item.name == name; });
    if (!is_known)
      return fail(ErrorCode::InvalidInput, fmt::format("--although {}: nothing that is asked of a job before printing "
                                                       "has this name",
                                                       name));
    named.emplace(name);
  }
  std::vector<std::string> reasons, unnamed;
  std::set<std::string> missing;
  for (const PreflightItem& item : preflight.items) {
    if (item.verdict != PreflightItem::Verdict::Held) continue;
    const std::string reason = fmt::format("{}: {}", item.name, item.text);
    if (named.contains(item.name)) {
      reasons.push_back(reason);
    } else {
      unnamed.push_back(reason);
      missing.insert(item.name);
    }
  }
  if (!unnamed.empty())
    return fail(ErrorCode::NotPermitted,
                fmt::format("the job is held: {}. To let it through all the same: --although {}",
                            fmt::join(unnamed, "; "), fmt::join(missing, ",")));
  return reasons.empty() ? std::string{} : fmt::format("although {}", fmt::join(reasons, "; "));
}

}  // namespace telefab::fab
