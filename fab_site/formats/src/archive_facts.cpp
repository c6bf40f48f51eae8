// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <telefab/fab/print/print_time.hpp>
#include <utility>

#include "mask_archives.hpp"
#include "sl1_fade.hpp"

namespace telefab::fab {
namespace {

constexpr std::size_t kMostLayers = 99'999;  // names hold five digits

/// A name that file systems and firmware take, and that no reader mistakes for a preview.
std::string safe_name(const std::string& job) {
  std::string name;
  for (const char c : job) {
    const bool plain =
        (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
    name += plain ? c : '_';
  }
  if (name.empty() || name.front() == '.') name.insert(0, "job");
  if (name.size() > 64) name.resize(64);
  std::string lower = name;
  std::transform(lower.begin(), lower.end(), lower.begin(), [](char c) { return c >= 'A' && c <= 'Z' ? c + 32 : c; });
  return lower.find("thumbnail") == std::string::npos ? name : "job";
}

/// Whether so many layers from `from` on have the exposures in even steps from one to the other.
bool is_even_fade(const PrintPlan& plan, std::size_t from, std::uint32_t count, std::chrono::microseconds first,
                  std::chrono::microseconds normal) {
  for (std::uint32_t k = 0; k < count; ++k) {
    const double share = (k + 1.0) / (count + 1.0);
    const double even_us =
        static_cast<double>(first.count()) * (1 - share) + static_cast<double>(normal.count()) * share;
    if (std::abs(static_cast<double>(plan.layers[from + k].exposure.count()) - even_us) > 1000) return false;
  }
  return true;
}

/// Bottom layers are the first ones for as long as they have the first exposure (empty ones pass); the normal exposure
/// is the most frequent one of the rest.
void read_exposures(const PrintPlan& plan, ArchiveFacts& facts) {
  using std::chrono::microseconds;
  const auto is_lit = [](const PlannedLayer& layer) { return layer.exposure.count() > 0; };
  const auto first = std::find_if(plan.layers.begin(), plan.layers.end(), is_lit);
  if (first == plan.layers.end()) return;
  const auto rest = std::find_if(first, plan.layers.end(), [&](const PlannedLayer& layer) {
    return is_lit(layer) && layer.exposure != first->exposure;
  });
  std::map<microseconds, std::uint32_t> counts;
  for (auto layer = rest; layer != plan.layers.end(); ++layer)
    if (is_lit(*layer)) ++counts[layer->exposure];
  microseconds normal = first->exposure;
  std::uint32_t most = 0;
  for (const auto& [exposure, count] : counts)
    if (count > most) most = count, normal = exposure;
  if (!counts.empty()) facts.bottom_layers = static_cast<std::uint32_t>(rest - plan.layers.begin());
  const auto fading = static_cast<std::uint32_t>(
      std::find_if(rest, plan.layers.end(), [&](const auto& l) { return is_lit(l) && l.exposure == normal; }) - rest);
  if (is_even_fade(plan, static_cast<std::size_t>(rest - plan.layers.begin()), fading, first->exposure, normal))
    facts.transition_layers = fading;
  facts.exposure_s = std::chrono::duration<double>(normal).count();
  facts.bottom_exposure_s = std::chrono::duration<double>(first->exposure).count();
}

/// The motion of the first lit layer is that of the bottom; the normal one is the most frequent of those behind them.
void read_motions(const PrintPlan& plan, ArchiveFacts& facts, MaskExportReport& report) {
  std::vector<std::pair<LayerMotion, std::uint32_t>> counts;
  bool is_first = true;
  for (const PlannedLayer& layer : plan.layers) {
    if (layer.exposure.count() == 0) continue;
    if (std::exchange(is_first, false)) facts.motion = facts.bottom_motion = layer.motion;
    const double tilt_s = layer.motion.tilt_s;
    if (tilt_s > 0 && (facts.fast_tilt_s == 0 || tilt_s < facts.fast_tilt_s)) facts.fast_tilt_s = tilt_s;
    facts.slow_tilt_s = std::max(facts.slow_tilt_s, tilt_s);
    if (layer.index.count() < facts.bottom_layers) continue;
    const auto known =
        std::find_if(counts.begin(), counts.end(), [&](const auto& c) { return c.first == layer.motion; });
    if (known == counts.end())
      counts.emplace_back(layer.motion, 1);
    else
      ++known->second;
  }
  const auto most =
      std::max_element(counts.begin(), counts.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most != counts.end()) facts.motion = most->first;
  for (const PlannedLayer& layer : plan.layers) {
    if (layer.exposure.count() == 0) continue;
    if (layer.motion.tilt_s > facts.fast_tilt_s) ++facts.slow_layers;
    LayerMotion stated = layer.index.count() < facts.bottom_layers ? facts.bottom_motion : facts.motion;
    stated.tilt_s = layer.motion.tilt_s;
    if (layer.motion != stated) ++report.other_motions;
  }
}

/// The same for every way to read the exposures of an archive but GOO's, which states them all.
double read_exposure_s(const ArchiveFacts& f, std::uint32_t layer) {
  if (layer < f.bottom_layers) return f.bottom_exposure_s;
  const std::uint32_t behind = layer - f.bottom_layers;
  if (behind >= f.transition_layers) return f.exposure_s;
  const double share = (behind + 1.0) / (f.transition_layers + 1.0);
  return f.bottom_exposure_s * (1 - share) + f.exposure_s * share;
}

void compare_exposures(const PrintPlan& plan, const ArchiveFacts& facts, MaskExportReport& report) {
  report.other_exposures = 0;
  for (const PlannedLayer& layer : plan.layers) {
    const double planned_s = std::chrono::duration<double>(layer.exposure).count();
    if (planned_s <= 0) continue;
    const double error = std::abs(read_exposure_s(facts, layer.index.count()) - planned_s) / planned_s;
    report.most_exposure_error = std::max(report.most_exposure_error, error);
    if (error > 1e-3) ++report.other_exposures;
  }
}

/// An SL1 printer's name as its display or the file's ending says, where the profile does not.
Result<std::string> sl1_model(const MachineProfile& machine, const std::filesystem::path& path) {
  struct Model {
    std::string_view name, ending;
    std::uint32_t short_px, long_px;
    double pitch_mm;
  };
  constexpr Model kModels[] = {
      {"SL1", ".sl1", 1440, 2560, 0.04725}, {"SL1S", ".sl1s", 1620, 2560, 0.05}, {"M1", ".m1", 1620, 2560, 0.05}};
  const std::string ending = path.extension().string();
  const PixelSize size = machine.mask_size();
  std::string name = machine.file.model;
  if (name.empty())
    for (const Model& model : kModels)
      if (std::min(size.width_px, size.height_px) == model.short_px &&
          std::max(size.width_px, size.height_px) == model.long_px &&
          std::abs(machine.projection.pixel_pitch_mm / model.pitch_mm - 1) < 0.01 &&
          (name.empty() || ending == model.ending))
        name = model.name;
  if (name.empty()) name = machine.name;  // no printer of Prusa's takes it for its own
  const auto own = std::find_if(std::begin(kModels), std::end(kModels), [&](const Model& m) { return m.name == name; });
  const bool is_others = own != std::end(kModels) &&
                         std::any_of(std::begin(kModels), std::end(kModels),
                                     [&](const Model& m) { return m.ending == ending && m.ending != own->ending; });
  if (is_others)
    return fail(ErrorCode::InvalidInput, fmt::format("an {} takes files that end in {}; name {} so, or state another "
                                                     "file.model in the profile",
                                                     name, own->ending, path.filename().string()));
  return name;
}

/// What the firmware of SL1 printers refuses or alters.
Result<void> check_sl1(const ArchiveFacts& f) {
  constexpr double kLeast_s = 0.1, kMost_s = 60, kMostFirst_s = 120;
  const auto refuse = [&](std::string_view what, double value_s, double most_s, std::string_view key) {
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} of {:.3f} s; SL1 printers take {} to {} s. Plan with another layers.{}", what, value_s,
                            kLeast_s, most_s, key));
  };
  if (f.exposure_s < kLeast_s || f.exposure_s > kMost_s)
    return refuse("the plan has a normal exposure", f.exposure_s, kMost_s, "exposure_s");
  if (f.bottom_exposure_s < kLeast_s || f.bottom_exposure_s > kMostFirst_s)
    return refuse("the plan has a first exposure", f.bottom_exposure_s, kMostFirst_s, "bottom_exposure_s");
  return {};
}

Result<void> check(MaskFormat format, const PrintPlan& plan, const MachineProfile& machine) {
  if (auto ok = plan.validate(); !ok) return ok;
  if (format != MaskFormat::Goo &&
      std::any_of(plan.layers.begin(), plan.layers.end(), [](const auto& l) { return l.light_share != 1; }))
    return fail(ErrorCode::InvalidInput,
                "the plan dims the light (layers.light_share, layers.bottom_light_share); such an archive leaves the "
                "power to the printer. Set the shares to 1 and the exposures to what gives the same dose");
  if (plan.machine != machine.name || plan.mask_size != machine.mask_size())
    return fail(ErrorCode::InvalidInput,
                fmt::format("the plan is of {} with {} x {} pixels, not of {} with {} x {}; plan the job again",
                            plan.machine, plan.mask_size.width_px, plan.mask_size.height_px, machine.name,
                            machine.mask_size().width_px, machine.mask_size().height_px));
  if (plan.layers.empty() || plan.layers.size() > kMostLayers)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the plan has {} layers; such an archive holds 1 to {}", plan.layers.size(), kMostLayers));
  return {};
}

}  // namespace

Result<ArchiveFacts> archive_facts(MaskFormat format, const PrintPlan& plan, const MachineProfile& machine,
                                   const std::filesystem::path& path, MaskExportReport& report) {
  if (auto ok = check(format, plan, machine); !ok) return tl::unexpected{ok.error()};
  ArchiveFacts facts;
  facts.job = safe_name(plan.job);
  facts.size = plan.mask_size;
  facts.optics = orientation_of(machine.projection.orientation);
  facts.machine = &machine;
  facts.model = machine.file.model.empty() ? machine.name : machine.file.model;
  facts.layers = report.layers = static_cast<std::uint32_t>(plan.layers.size());
  read_exposures(plan, facts);
  read_motions(plan, facts, report);
  facts.print_s = std::chrono::duration<double>(print_time(plan, {}, stage_pace(machine), {})).count();
  if (format == MaskFormat::NanoDlp) compare_exposures(plan, facts, report);
  if (format == MaskFormat::Goo) {
    const auto tilts = [](const PlannedLayer& l) { return l.exposure.count() > 0 && l.motion.tilt_s > 0; };
    report.other_motions = static_cast<std::uint32_t>(std::count_if(plan.layers.begin(), plan.layers.end(), tilts));
  }
  if (format != MaskFormat::Sl1) return facts;
  if (auto ok = check_sl1(facts); !ok) return tl::unexpected{ok.error()};
  auto model = sl1_model(machine, path);
  if (!model) return tl::unexpected{model.error()};
  facts.model = std::move(*model);
  facts.fade = fitted_fade(machine.file.fade, plan, facts.bottom_exposure_s, facts.exposure_s);
  report.fade = facts.fade;
  report.fades = faded_layers(plan, facts.bottom_exposure_s, facts.exposure_s, facts.fade);
  for (const FadedLayers& fade : report.fades)
    if (fade.reader == machine.file.fade) {
      report.most_exposure_error = fade.most_error;
      report.other_exposures = static_cast<std::uint32_t>(fade.layers.size());
    }
  return facts;
}

Result<MaskExportReport> survey_export(MaskFormat format, const PrintPlan& plan, const MachineProfile& machine,
                                       const std::filesystem::path& path) {
  MaskExportReport report;
  if (auto facts = archive_facts(format, plan, machine, path, report); !facts) return tl::unexpected{facts.error()};
  return report;
}

}  // namespace telefab::fab
