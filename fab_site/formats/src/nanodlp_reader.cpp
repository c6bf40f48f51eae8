// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/text.hpp>
#include <telefab/fab/mask/orientation.hpp>

#include "sliced_readers.hpp"

namespace telefab::fab {
namespace {

using Json = nlohmann::ordered_json;

/// One of the archive's texts; an empty object where it is not there.
class Facts {
 public:
  static Result<Facts> read(ZipReader& archive, const std::string& name) {
    if (!archive.has(name)) return Facts{Json::object(), name, false};
    auto text = archive.entry(name, ZipReader::kMostText);
    if (!text) return tl::unexpected{text.error()};
    Json json = json_or_discarded(*text);
    if (!json.is_object()) return fail(ErrorCode::InvalidInput, fmt::format("{} is not a JSON object", name));
    return Facts{std::move(json), name, true};
  }
  [[nodiscard]] bool is_there() const { return is_there_; }
  /// Nothing where it is not there; InvalidInput where it is not a number within the range.
  [[nodiscard]] Result<std::optional<double>> number(const char* key, double least, double most) const {
    const auto found = json_.find(key);
    if (found == json_.end() || found->is_null()) return std::optional<double>{};
    const double value = found->is_number() ? found->get<double>() : std::nan("");
    if (!(value >= least && value <= most))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("{}: {} is not a number within {} and {}", name_, key, least, most));
    return std::optional<double>{value};
  }
  [[nodiscard]] std::string text(const char* key) const {
    const auto found = json_.find(key);
    return found != json_.end() && found->is_string() ? to_printable(found->get<std::string>()) : std::string{};
  }
  [[nodiscard]] bool says_anything() const { return !json_.empty(); }

 private:
  Facts(Json json, std::string name, bool is_there)
      : json_(std::move(json)), name_{std::move(name)}, is_there_{is_there} {}
  Json json_;
  std::string name_;
  bool is_there_;
};

class NanoDlpFile final : public SlicedFile {
 public:
  NanoDlpFile(SlicedJob job, Orientation optics, ZipReader archive)
      : SlicedFile{std::move(job)}, optics_{optics}, archive_{std::move(archive)} {}
  Result<Mask> mask(LayerIndex layer) override {
    if (layer.count() >= job_.layers.size())
      return fail(ErrorCode::NotFound, fmt::format("there is no layer {}", layer.count()));
    const std::string name = fmt::format("{}.png", layer.count() + 1);
    const auto png = archive_.entry(name);
    if (!png) return tl::unexpected{png.error()};
    auto mask = grey_mask(*png, job_.size, name);
    if (!mask || optics_ == Orientation{}) return mask;
    return turned_for_optics(mask->view(), optics_);
  }

 private:
  Orientation optics_;
  ZipReader archive_;
};

/// The numbers of one text, or the first failure among them.
class Numbers {
 public:
  explicit Numbers(const Facts& facts) : facts_{facts} {}
  std::optional<double> get(const char* key, double most, double least = 0) {
    auto value = facts_.number(key, least, most);
    if (!value) {
      if (!failure_) failure_ = std::move(value.error());
      return std::nullopt;
    }
    return *value;
  }
  [[nodiscard]] const std::optional<Error>& failure() const { return failure_; }

 private:
  const Facts& facts_;
  std::optional<Error> failure_;
};

Result<void> read_slicer(const Facts& slicer, SlicedJob& job, Orientation& optics) {
  Numbers n{slicer};
  job.size = {static_cast<std::uint32_t>(n.get("PWidth", 65535).value_or(0)),
              static_cast<std::uint32_t>(n.get("PHeight", 65535).value_or(0))};
  job.pixel_width_mm = n.get("XPixelSize", 10).value_or(0);
  job.pixel_height_mm = n.get("YPixelSize", 10).value_or(job.pixel_width_mm);
  job.thickness_mm = n.get("Thickness", 1000).value_or(0) / 1000;
  const auto mirror = n.get("ImageMirror", 3);
  const double turn = n.get("ImageRotate", 360, -360).value_or(0);
  if (n.failure()) return tl::unexpected{*n.failure()};
  if (turn != 0)
    return fail(ErrorCode::InvalidInput,
                fmt::format("its pictures are turned by {} (ImageRotate), which is not read; slice without", turn));
  const auto code = static_cast<unsigned>(mirror.value_or(0));
  optics = {(code & 1U) != 0, (code & 2U) != 0};
  if (!mirror) job.absent.push_back(SlicedValue::Mirroring);
  if (job.pixel_width_mm <= 0 || job.pixel_height_mm <= 0) job.absent.push_back(SlicedValue::PixelPitch);
  return {};
}

Result<void> read_profile(const Facts& profile, SlicedJob& job, std::uint32_t layers) {
  constexpr double kMostWait_s = 3600, kMostLift_mm = 1000;
  Numbers n{profile};
  if (job.thickness_mm <= 0) job.thickness_mm = n.get("Depth", 1000).value_or(0) / 1000;
  const auto normal_s = n.get("CureTime", kMostExposure_s);
  const auto bottom_s = n.get("SupportCureTime", kMostExposure_s);
  const auto bottoms = static_cast<std::uint32_t>(n.get("SupportLayerNumber", 1e5).value_or(0));
  const auto steps = static_cast<std::uint32_t>(n.get("TransitionalLayer", 1e5).value_or(0));
  const auto lacks = [&](SlicedValue value) { job.absent.push_back(value); };
  const auto motion_of = [&](const char* lift, const char* before, const char* after, const char* top,
                             LayerMotion otherwise) {
    otherwise.lift_mm = n.get(lift, kMostLift_mm).value_or(otherwise.lift_mm);
    otherwise.settle_s = n.get(before, kMostWait_s).value_or(otherwise.settle_s);
    otherwise.wait_after_exposure_s = n.get(after, kMostWait_s).value_or(otherwise.wait_after_exposure_s);
    otherwise.wait_after_lift_s = n.get(top, kMostWait_s).value_or(otherwise.wait_after_lift_s);
    return otherwise;
  };
  const LayerMotion motion = motion_of("WaitHeight", "WaitBeforePrint", "WaitAfterPrint", "TopWait", {});
  const LayerMotion bottom =
      motion_of("SupportWaitHeight", "SupportWaitBeforePrint", "SupportWaitAfterPrint", "SupportTopWait", motion);
  lacks(SlicedValue::LowerSpeed);  // and the lift's speed: the machine's own
  lacks(SlicedValue::Lift);
  if (!n.get("WaitBeforePrint", kMostWait_s)) lacks(SlicedValue::WaitBeforeExposure);
  if (!n.get("WaitAfterPrint", kMostWait_s)) lacks(SlicedValue::WaitAfterExposure);
  if (!n.get("TopWait", kMostWait_s)) lacks(SlicedValue::WaitAfterLift);
  if (!normal_s) lacks(SlicedValue::Exposure);
  if (n.failure()) return tl::unexpected{*n.failure()};
  for (std::uint32_t i = 0; i < layers; ++i)
    job.layers.push_back(
        {.z_mm = (i + 1) * job.thickness_mm,
         .exposure = exposure_of(
             normal_s ? stepped_exposure_s(i, bottoms, steps, bottom_s.value_or(*normal_s), *normal_s) : 0.0),
         .motion = i < bottoms ? bottom : motion});
  return {};
}

}  // namespace

Result<std::unique_ptr<SlicedFile>> read_nanodlp(ZipReader archive) {
  const auto meta = Facts::read(archive, "meta.json");
  const auto plate = Facts::read(archive, "plate.json");
  const auto profile = Facts::read(archive, "profile.json");
  const auto overrides = Facts::read(archive, "override.json");
  // NanoDLP's name for it, and UVtools' one.
  const auto slicer = Facts::read(archive, archive.has("options.json") ? "options.json" : "slicer.json");
  for (const auto* facts : {&meta, &plate, &profile, &overrides, &slicer})
    if (!*facts) return tl::unexpected{facts->error()};
  Numbers of_meta{*meta}, of_plate{*plate};
  const double version = of_meta.get("FormatVersion", 1e6).value_or(0);
  const auto layers = of_plate.get("LayersCount", static_cast<double>(kMostSlicedLayers), 1);
  for (const auto* numbers : {&of_meta, &of_plate})
    if (numbers->failure()) return tl::unexpected{*numbers->failure()};
  if (version != 1 && version != 2)
    return fail(ErrorCode::InvalidInput, fmt::format("meta.json states FormatVersion {}; 1 and 2 are read", version));
  if (!layers) return fail(ErrorCode::InvalidInput, "plate.json has no LayersCount");
  if (overrides->says_anything())
    return fail(ErrorCode::InvalidInput,
                "override.json gives layers values of their own, which are not read; slice without overrides");

  SlicedJob job;
  job.format = SlicedFormat::NanoDlp;
  job.name = plate->text("Path");
  job.program = meta->text("Program");
  job.resin = profile->text("Desc");
  job.model = profile->text("Title");
  if (job.model.empty()) job.absent.push_back(SlicedValue::Model);
  Orientation optics;
  if (auto ok = read_slicer(*slicer, job, optics); !ok) return tl::unexpected{ok.error()};
  const auto count = static_cast<std::uint32_t>(*layers);
  for (std::uint32_t i = 1; i <= count; ++i)
    if (const std::string name = fmt::format("{}.png", i); !archive.has(name))
      return fail(ErrorCode::InvalidInput, fmt::format("plate.json counts {} layers, but {} is missing", count, name));
  if (auto ok = read_profile(*profile, job, count); !ok) return tl::unexpected{ok.error()};
  if (job.thickness_mm <= 0)
    return fail(ErrorCode::InvalidInput, "neither Thickness nor Depth states the height of a layer");
  const auto png = archive.entry("1.png");
  if (!png) return tl::unexpected{png.error()};
  const auto stated = job.size.width_px > 0 ? std::optional{job.size} : std::nullopt;
  const auto first = grey_mask(*png, stated, "1.png");
  if (!first) return tl::unexpected{first.error()};
  job.size = first->size;
  return std::make_unique<NanoDlpFile>(std::move(job), optics, std::move(archive));
}

}  // namespace telefab::fab
