// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/mask/orientation.hpp>
#include <utility>

#include "goo_layout.hpp"
#include "goo_writer.hpp"
#include "mask_archives.hpp"
#include "zip_writer.hpp"

namespace telefab::fab {
namespace {

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

  /// As the panel must show it.
  Result<Mask> picture(std::uint32_t layer) {
    auto mask = masks_.mask(LayerIndex{layer});
    if (!mask) return tl::unexpected{mask.error()};
    if (!seen_[layer])
      for (ViewFromAbove* view : views_) view->add(mask->view(), layer);
    if (optics_ != Orientation{}) *mask = turned_for_optics(mask->view(), optics_);
    if (!seen_[layer]) surveys_[layer] = survey(mask->view());
    seen_[layer] = 1;
    return mask;
  }
  Result<std::vector<std::byte>> png(std::uint32_t layer) {
    const auto mask = picture(layer);
    if (!mask) return tl::unexpected{mask.error()};
    return encode_png_grey(mask->size.width_px, mask->size.height_px, mask->rows);
  }

 private:
  MaskSource& masks_;
  Orientation optics_;
  std::vector<LayerSurvey> surveys_;
  std::vector<char> seen_;
  std::vector<ViewFromAbove*> views_;
};

/// GOO is one stream; the others are archives.
Result<void> export_goo(const PrintPlan& plan, const ArchiveFacts& facts, MaskStream& stream, double pixel_mm3,
                        const std::filesystem::path& path, const ProgressSink& progress, const std::stop_token& stop) {
  std::vector<ViewFromAbove> views{{facts.size, goo::kSmallPreview_px, goo::kSmallPreview_px},
                                   {facts.size, goo::kBigPreview_px, goo::kBigPreview_px}};
  for (ViewFromAbove& view : views) stream.show_in(&view);
  return write_goo(
      path, plan, facts, [&](std::uint32_t layer) { return stream.picture(layer); },
      [&] {
        return GooSummary{views[0].image(facts.layers), views[1].image(facts.layers), stream.solid_px() * pixel_mm3};
      },
      progress, stop);
}

Result<void> export_zip(MaskFormat format, const ArchiveFacts& facts, MaskStream& stream, double pixel_mm3,
                        const std::filesystem::path& path, const ProgressSink& progress, std::stop_token stop) {
  auto zip = ZipWriter::create(path);
  if (!zip) return tl::unexpected{zip.error()};
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
    if (!ok) return ok;
  for (ViewFromAbove& view : views) stream.show_in(&view);
  return zip->finish(WorkStage::WritingMasks, progress, std::move(stop));
}

}  // namespace

Result<MaskExportReport> export_masks(MaskFormat format, const PrintPlan& plan, MaskSource& masks,
                                      const MachineProfile& machine, const std::filesystem::path& path,
                                      const ProgressSink& progress, std::stop_token stop) {
  MaskExportReport report;
  const auto facts = archive_facts(format, plan, machine, path, report);
  if (!facts) return tl::unexpected{facts.error()};
  const double pixel_mm3 =
      machine.projection.pixel_pitch_mm * machine.projection.pixel_pitch_mm * machine.layers.thickness_mm;
  MaskStream stream{masks, facts->optics, facts->layers};
  const auto done = format == MaskFormat::Goo ? export_goo(plan, *facts, stream, pixel_mm3, path, progress, stop)
                                              : export_zip(format, *facts, stream, pixel_mm3, path, progress, stop);
  if (!done) return tl::unexpected{done.error()};
  report.solid_mm3 = stream.solid_px() * pixel_mm3;
  return report;
}

}  // namespace telefab::fab
