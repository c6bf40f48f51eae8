// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/mask/orientation.hpp>
#include <telefab/fab/planning/plan_job.hpp>
#include <telefab/fab/print/print_time.hpp>
#include <utility>

#include "mask_archives.hpp"
#include "zip_writer.hpp"

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
void read_exposures(const PrintPlan& plan, ArchiveFacts& facts, MaskExportReport& report) {
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
  std::uint32_t lit = 0;
  for (const auto& [exposure, count] : counts) {
    lit += count;
    if (count > most) most = count, normal = exposure;
  }
  if (!counts.empty()) facts.bottom_layers = static_cast<std::uint32_t>(rest - plan.layers.begin());
  const auto fading = static_cast<std::uint32_t>(
      std::find_if(rest, plan.layers.end(), [&](const auto& l) { return is_lit(l) && l.exposure == normal; }) - rest);
  if (is_even_fade(plan, static_cast<std::size_t>(rest - plan.layers.begin()), fading, first->exposure, normal))
    facts.transition_layers = fading;
  report.other_exposures = lit - most - facts.transition_layers;
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

/// Layers whose time on an SL1 printer, as its newest program reads the archive, is more than 1 % off.
std::uint32_t misread_by_sl1(const PrintPlan& plan, const ArchiveFacts& facts) {
  const double fade = sl1_fade(facts);
  std::uint32_t count = 0;
  for (const PlannedLayer& layer : plan.layers) {
    const double share = std::min(1.0, layer.index.count() / (fade - 1));
    const double read_s = facts.bottom_exposure_s + (facts.exposure_s - facts.bottom_exposure_s) * share;
    const double planned_s = std::chrono::duration<double>(layer.exposure).count();
    if (planned_s > 0 && std::abs(read_s - planned_s) > planned_s / 100) ++count;
  }
  return count;
}

Result<void> check(const PrintPlan& plan, const MachineProfile& machine) {
  if (auto ok = plan.validate(); !ok) return ok;
  if (std::any_of(plan.layers.begin(), plan.layers.end(), [](const auto& l) { return l.light_share != 1; }))
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

EntryMaker text_maker(std::function<std::string()> make) {
  return [make = std::move(make)]() -> Result<std::vector<std::byte>> {
    const std::string text = make();
    const auto bytes = std::as_bytes(std::span{text});
    return std::vector<std::byte>(bytes.begin(), bytes.end());
  };
}

/// Looks at every mask as it passes into the archive; what tells of all of them stands behind them.
class MaskStream {
 public:
  MaskStream(MaskSource& masks, Orientation optics, std::uint32_t layers)
      : masks_{masks}, optics_{optics}, surveys_(layers), seen_(layers, 0) {}

  void show_in(ViewFromAbove* view) { views_.push_back(view); }
  [[nodiscard]] const std::vector<LayerSurvey>& surveys() const { return surveys_; }
  [[nodiscard]] double solid_px() const {
    double sum = 0;
    for (const LayerSurvey& s : surveys_) sum += s.solid_px;
    return sum;
  }

  Result<std::vector<std::byte>> png(std::uint32_t layer) {
    auto mask = masks_.mask(LayerIndex{layer});
    if (!mask) return tl::unexpected{mask.error()};
    if (!seen_[layer])
      for (ViewFromAbove* view : views_) view->add(mask->view(), layer);
    if (optics_ != Orientation{}) *mask = turned_for_optics(mask->view(), optics_);
    if (!seen_[layer]) surveys_[layer] = survey(mask->view());
    seen_[layer] = 1;
    return encode_png_grey(mask->size.width_px, mask->size.height_px, mask->rows);
  }

 private:
  MaskSource& masks_;
  Orientation optics_;
  std::vector<LayerSurvey> surveys_;
  std::vector<char> seen_;
  std::vector<ViewFromAbove*> views_;
};

}  // namespace

Result<MaskExportReport> export_masks(MaskFormat format, const PrintPlan& plan, MaskSource& masks,
                                      const MachineProfile& machine, const std::filesystem::path& path,
                                      const ProgressSink& progress, std::stop_token stop) {
  if (auto ok = check(plan, machine); !ok) return tl::unexpected{ok.error()};
  const Orientation optics = orientation_of(machine.projection.orientation);
  MaskExportReport report;
  report.layers = static_cast<std::uint32_t>(plan.layers.size());
  ArchiveFacts facts;
  facts.job = safe_name(plan.job);
  facts.size = plan.mask_size;
  facts.optics = optics;
  facts.machine = &machine;
  facts.layers = report.layers;
  read_exposures(plan, facts, report);
  read_motions(plan, facts, report);
  if (format == MaskFormat::Sl1 && facts.transition_layers > 0) report.other_exposures = misread_by_sl1(plan, facts);
  facts.print_s = std::chrono::duration<double>(print_time(plan, {}, stage_pace(machine), {})).count();
  const double pixel_mm3 =
      machine.projection.pixel_pitch_mm * machine.projection.pixel_pitch_mm * machine.layers.thickness_mm;

  auto zip = ZipWriter::create(path);
  if (!zip) return tl::unexpected{zip.error()};
  MaskStream stream{masks, optics, facts.layers};
  std::vector<ViewFromAbove> views;
  const auto add = [&](const std::string& name, EntryMaker maker) { return zip->add(name, std::move(maker)); };
  const auto add_layers = [&](const auto& name_of_layer) -> Result<void> {
    for (std::uint32_t i = 0; i < facts.layers; ++i)
      if (auto ok = add(name_of_layer(i), [&stream, i] { return stream.png(i); }); !ok) return ok;
    return {};
  };
  const auto picture = [&](std::size_t view) -> EntryMaker {
    return [&views, &facts, view] { return encode_png(views[view].image(facts.layers)); };
  };
  std::vector<Result<void>> done;
  if (format == MaskFormat::Sl1) {
    views = {{facts.size, 400, 400}, {facts.size, 800, 480}};
    done.push_back(add_layers([&](std::uint32_t i) { return fmt::format("{}{:05}.png", facts.job, i); }));
    done.push_back(add("config.ini", text_maker([&] { return sl1_config(facts, stream.solid_px() * pixel_mm3); })));
    done.push_back(add("prusaslicer.ini", text_maker([&] { return sl1_profile(facts); })));
    done.push_back(add("thumbnail/thumbnail400x400.png", picture(0)));
    done.push_back(add("thumbnail/thumbnail800x480.png", picture(1)));
  } else {
    views = {{facts.size, 200, 100}};
    done.push_back(zip->add("meta.json", nanodlp_meta()));
    done.push_back(add_layers([](std::uint32_t i) { return fmt::format("{}.png", i + 1); }));
    done.push_back(add("plate.json", text_maker([&] { return nanodlp_plate(facts, stream.surveys()); })));
    done.push_back(add("info.json", text_maker([&] { return nanodlp_info(facts, stream.surveys()); })));
    done.push_back(zip->add("profile.json", nanodlp_profile(facts)));
    done.push_back(zip->add("slicer.json", nanodlp_slicer(facts)));
    done.push_back(zip->add("options.json", nanodlp_slicer(facts)));
    done.push_back(add("3d.png", picture(0)));
  }
  for (const auto& ok : done)
    if (!ok) return tl::unexpected{ok.error()};
  for (ViewFromAbove& view : views) stream.show_in(&view);
  if (auto ok = zip->finish(WorkStage::WritingMasks, progress, std::move(stop)); !ok) return tl::unexpected{ok.error()};
  report.solid_mm3 = stream.solid_px() * pixel_mm3;
  return report;
}

}  // namespace telefab::fab
