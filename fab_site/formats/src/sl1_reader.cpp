// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <map>
#include <telefab/base/text.hpp>

#include "number_reader.hpp"
#include "sl1_fade.hpp"
#include "sliced_readers.hpp"

namespace telefab::fab {
namespace {

/// "key = value" lines; of two with one key the last one holds, as in the printers.
class Settings {
 public:
  Settings(std::string_view text, std::string_view file) : file_{file} {
    while (!text.empty()) {
      const auto end = text.find('\n');
      add(text.substr(0, end));
      text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    }
  }
  [[nodiscard]] std::optional<std::string_view> word(std::string_view key) const {
    const auto found = values_.find(key);
    if (found == values_.end() || found->second.empty()) return std::nullopt;
    return found->second;
  }
  /// Nothing where it is not there; InvalidInput where it is not a number within the range.
  [[nodiscard]] Result<std::optional<double>> number(std::string_view key, double least, double most) const {
    const auto text = word(key);
    if (!text) return std::optional<double>{};
    const auto value = whole_number_text(*text);
    if (!value || !(*value >= least && *value <= most))
      return fail(ErrorCode::InvalidInput, fmt::format("{}: {} is \"{}\", not a number within {} and {}", file_, key,
                                                       to_printable(*text), least, most));
    return std::optional<double>{*value};
  }
  [[nodiscard]] Result<double> needed(std::string_view key, double least, double most) const {
    const auto value = number(key, least, most);
    if (!value) return tl::unexpected{value.error()};
    if (!*value) return fail(ErrorCode::InvalidInput, fmt::format("{} has no {}", file_, key));
    return **value;
  }

 private:
  static std::string_view trimmed(std::string_view text) {
    skip_space(text);
    while (!text.empty() && is_space(text.back())) text.remove_suffix(1);
    return text;
  }
  void add(std::string_view line) {
    const auto equals = line.find('=');
    if (equals == std::string_view::npos) return;
    values_[std::string{trimmed(line.substr(0, equals))}] = trimmed(line.substr(equals + 1));
  }
  std::string_view file_;
  std::map<std::string, std::string, std::less<>> values_;
};

/// How the slicer laid the platform into the picture: PrusaSlicer's raster, found by its own archives.
struct Raster {
  bool is_portrait = false;  ///< columns along y, rows along x
  bool mirror_x = false;
  bool mirror_y = false;
};

Mask upright(Mask picture, const Raster& raster) {
  const auto [width, height] = picture.size;
  if (!raster.is_portrait && !raster.mirror_x && !raster.mirror_y) return picture;
  Mask mask{raster.is_portrait ? PixelSize{height, width} : picture.size, {}};
  mask.rows.resize(picture.rows.size());
  for (std::uint32_t row = 0; row < height; ++row)
    for (std::uint32_t column = 0; column < width; ++column) {
      std::uint32_t x = raster.mirror_x ? width - 1 - column : column;
      std::uint32_t down = raster.mirror_y ? height - 1 - row : row;
      if (raster.is_portrait) {
        const std::uint32_t y = raster.mirror_x ? column : width - 1 - column;
        x = raster.mirror_y ? row : height - 1 - row;
        down = width - 1 - y;
      }
      mask.rows[std::size_t{down} * mask.size.width_px + x] = picture.rows[std::size_t{row} * width + column];
    }
  return mask;
}

class Sl1File final : public SlicedFile {
 public:
  Sl1File(SlicedJob job, Raster raster, ZipReader archive, std::vector<std::string> names)
      : SlicedFile{std::move(job)}, raster_{raster}, archive_{std::move(archive)}, names_{std::move(names)} {}
  Result<Mask> mask(LayerIndex layer) override {
    if (layer.count() >= names_.size())
      return fail(ErrorCode::NotFound, fmt::format("there is no layer {}", layer.count()));
    const std::string& name = names_[layer.count()];
    const auto png = archive_.entry(name);
    if (!png) return tl::unexpected{png.error()};
    const PixelSize picture = raster_.is_portrait ? PixelSize{job_.size.height_px, job_.size.width_px} : job_.size;
    auto mask = grey_mask(*png, picture, name);
    if (!mask) return tl::unexpected{mask.error()};
    return upright(std::move(*mask), raster_);
  }

 private:
  Raster raster_;
  ZipReader archive_;
  std::vector<std::string> names_;
};

/// Words as UVtools leaves them in printer_notes: "LiftHeight_5\nLiftSpeed_120", the line ends escaped.
std::map<std::string, double, std::less<>> noted(std::string_view notes) {
  std::map<std::string, double, std::less<>> values;
  while (!notes.empty()) {
    const auto end = notes.find("\\n");
    const std::string_view word = notes.substr(0, end);
    notes.remove_prefix(end == std::string_view::npos ? notes.size() : end + 2);
    const auto line = word.rfind('_');
    if (line == std::string_view::npos) continue;
    const auto value = whole_number_text(word.substr(line + 1));
    if (value && *value >= 0 && *value <= 1e5) values.emplace(word.substr(0, line), *value);
  }
  return values;
}

double per_second(double mm_per_min) { return std::round(mm_per_min / 60 * 1e6) / 1e6; }

/// Motion by those words; what they leave unsaid goes to `absent`.
LayerMotion motion_of(const std::map<std::string, double, std::less<>>& words, const std::string& who,
                      LayerMotion motion, std::vector<SlicedValue>* absent) {
  const auto word = [&](std::string_view name) -> std::optional<double> {
    const auto found = words.find(who + std::string{name});
    return found == words.end() ? std::nullopt : std::optional{found->second};
  };
  const auto lacks = [&](SlicedValue value) {
    if (absent != nullptr) absent->push_back(value);
  };
  const auto first_mm = word("LiftHeight"), first_speed = word("LiftSpeed");
  if (first_mm && first_speed && *first_speed > 0) {
    const double second_mm = word("LiftHeight2").value_or(0), second_speed = word("LiftSpeed2").value_or(*first_speed);
    motion.lift_mm = *first_mm + second_mm;
    motion.peel_mm = second_mm > 0 ? *first_mm : 0;
    motion.peel_speed_mm_per_s = second_mm > 0 ? per_second(*first_speed) : 0;
    motion.lift_speed_mm_per_s = per_second(second_mm > 0 ? second_speed : *first_speed);
  } else {
    lacks(SlicedValue::Lift);
  }
  if (const auto speed = word("RetractSpeed"); speed && *speed > 0) {
    motion.lower_speed_mm_per_s = per_second(*speed);
    motion.approach_mm = word("RetractHeight2").value_or(0);
    motion.approach_speed_mm_per_s = motion.approach_mm > 0 ? per_second(word("RetractSpeed2").value_or(*speed)) : 0;
  } else {
    lacks(SlicedValue::LowerSpeed);
  }
  if (const auto wait = word("WaitTimeBeforeCure"))
    motion.settle_s = *wait;
  else
    lacks(SlicedValue::WaitBeforeExposure);
  // Beside the others these two are 0 where they are not said.
  const bool says_waits = word("WaitTimeBeforeCure").has_value();
  motion.wait_after_exposure_s = word("WaitTimeAfterCure").value_or(0);
  motion.wait_after_lift_s = word("WaitTimeAfterLift").value_or(0);
  if (!says_waits && !word("WaitTimeAfterCure")) lacks(SlicedValue::WaitAfterExposure);
  if (!says_waits && !word("WaitTimeAfterLift")) lacks(SlicedValue::WaitAfterLift);
  return motion;
}

/// All of config.ini that a print goes by.
struct Config {
  std::string prefix;
  double first_s = 0, normal_s = 0, thickness_mm = 0, first_mm = 0;
  std::uint32_t fade = kLeastFade;
  std::uint32_t slow_layers = 0;
};

Result<Config> config_of(const Settings& config, const Settings& profile) {
  Config c;
  const auto prefix = config.word("jobDir");
  if (!prefix) return fail(ErrorCode::InvalidInput, "config.ini has no jobDir, the name its layers begin with");
  c.prefix = *prefix;
  // An exposure is never nothing here: a layer without light is a black picture.
  constexpr double kLeast_s = 1e-3;
  for (const auto& [value, key, least, most] : {std::tuple{&c.first_s, "expTimeFirst", kLeast_s, kMostExposure_s},
                                                {&c.normal_s, "expTime", kLeast_s, kMostExposure_s},
                                                {&c.thickness_mm, "layerHeight", 0.001, 1.0}}) {
    const auto number = config.needed(key, least, most);
    if (!number) return tl::unexpected{number.error()};
    *value = *number;
  }
  for (const auto& [value, key, most] :
       {std::tuple{&c.fade, "numFade", 100'000.0}, {&c.slow_layers, "numSlow", double(kMostSlicedLayers)}}) {
    const auto number = config.number(key, 0, most);
    if (!number) return tl::unexpected{number.error()};
    if (*number) *value = static_cast<std::uint32_t>(**number);
  }
  c.fade = std::max(c.fade, kLeastFade);  // of 0 or 1 the first layer alone has the first exposure
  const auto first = profile.number("initial_layer_height", 0.001, 1);
  if (!first) return tl::unexpected{first.error()};
  c.first_mm = first->value_or(c.thickness_mm);
  return c;
}

Result<void> read_raster(const Settings& profile, SlicedJob& job, Raster& raster) {
  if (!profile.word("display_orientation") || !profile.word("display_mirror_x"))
    job.absent.push_back(SlicedValue::Mirroring);
  raster.is_portrait = profile.word("display_orientation") == "portrait";
  raster.mirror_x = profile.word("display_mirror_x") == "1";
  raster.mirror_y = profile.word("display_mirror_y") == "1";
  double size_mm[2], pixels[2];
  const std::pair<double*, std::pair<std::string_view, double>> wanted[] = {{&size_mm[0], {"display_width", 2000}},
                                                                            {&size_mm[1], {"display_height", 2000}},
                                                                            {&pixels[0], {"display_pixels_x", 65535}},
                                                                            {&pixels[1], {"display_pixels_y", 65535}}};
  for (const auto& [value, key] : wanted) {
    const auto number = profile.number(key.first, 0, key.second);
    if (!number) return tl::unexpected{number.error()};
    *value = number->value_or(0);
  }
  if (size_mm[0] > 0 && size_mm[1] > 0 && pixels[0] > 0 && pixels[1] > 0) {
    job.pixel_width_mm = size_mm[0] / pixels[0];
    job.pixel_height_mm = size_mm[1] / pixels[1];
  } else if (job.model == "SL1") {
    job.pixel_width_mm = job.pixel_height_mm = 0.04725;
  } else if (job.model == "SL1S" || job.model == "M1") {
    job.pixel_width_mm = job.pixel_height_mm = 0.05;
  } else {
    job.absent.push_back(SlicedValue::PixelPitch);
  }
  return {};
}

/// Tilts of the printer, where the profile states them, and motion by the words for other printers.
Result<void> read_motions(const Settings& profile, const Config& c, SlicedJob& job) {
  const auto fast = profile.number("fast_tilt_time", 0, 120), slow = profile.number("slow_tilt_time", 0, 120);
  if (!fast) return tl::unexpected{fast.error()};
  if (!slow) return tl::unexpected{slow.error()};
  const auto words = noted(profile.word("printer_notes").value_or(""));
  LayerMotion plain;
  plain.tilt_s = fast->value_or(0);
  if (c.slow_layers > 0 && slow->value_or(plain.tilt_s) != plain.tilt_s) job.absent.push_back(SlicedValue::SlowTilts);
  const LayerMotion motion = motion_of(words, "", plain, &job.absent);
  const bool has_bottom = words.contains("BottomLiftHeight");
  const LayerMotion bottom = has_bottom ? motion_of(words, "Bottom", plain, nullptr) : motion;
  const auto stated = words.find("BottomLayerCount");
  const double bottom_layers = stated == words.end() ? c.fade : stated->second;
  for (std::size_t i = 0; i < job.layers.size(); ++i)
    job.layers[i].motion = static_cast<double>(i) < bottom_layers ? bottom : motion;
  return {};
}

}  // namespace

Result<std::unique_ptr<SlicedFile>> read_sl1(ZipReader archive) {
  const auto config_text = archive.entry("config.ini", ZipReader::kMostText);
  if (!config_text) return tl::unexpected{config_text.error()};
  const Settings config{*config_text, "config.ini"};
  std::string profile_text;
  if (archive.has("prusaslicer.ini")) {
    auto text = archive.entry("prusaslicer.ini", ZipReader::kMostText);
    if (!text) return tl::unexpected{text.error()};
    profile_text = std::move(*text);
  }
  const Settings profile{profile_text, "prusaslicer.ini"};
  const auto c = config_of(config, profile);
  if (!c) return tl::unexpected{c.error()};

  SlicedJob job;
  job.format = SlicedFormat::Sl1;
  const auto printable = [&](std::string_view key) { return to_printable(config.word(key).value_or("")); };
  job.name = to_printable(c->prefix);
  job.model = printable("printerModel");
  job.program = printable("prusaSlicerVersion");
  job.resin = printable("materialName");
  job.thickness_mm = c->thickness_mm;
  Raster raster;
  if (auto ok = read_raster(profile, job, raster); !ok) return tl::unexpected{ok.error()};
  if (job.model.empty()) job.absent.push_back(SlicedValue::Model);
  if (archive.has("config.json")) job.absent.push_back(SlicedValue::PrinterProfile);

  std::vector<std::string> names = archive.names();
  std::erase_if(names,
                [&](const std::string& name) { return !name.starts_with(c->prefix) || !name.ends_with(".png"); });
  std::sort(names.begin(), names.end());
  if (names.empty())
    return fail(ErrorCode::InvalidInput, fmt::format("no picture in the archive begins with \"{}\"", job.name));
  if (names.size() > kMostSlicedLayers)
    return fail(ErrorCode::TooLarge, fmt::format("{} layers; at most {} are read", names.size(), kMostSlicedLayers));
  if (std::adjacent_find(names.begin(), names.end()) != names.end())
    return fail(ErrorCode::InvalidInput, "two pictures of the archive have one name");
  for (std::uint32_t i = 0; i < names.size(); ++i)
    job.layers.push_back(
        {.z_mm = c->first_mm + i * c->thickness_mm,
         .exposure = exposure_of(faded_exposure_s(FadeReader::Slafw, c->first_s, c->normal_s, c->fade, i))});
  if (auto ok = read_motions(profile, *c, job); !ok) return tl::unexpected{ok.error()};
  const auto first = archive.entry(names.front());
  if (!first) return tl::unexpected{first.error()};
  const auto picture = grey_mask(*first, std::nullopt, names.front());
  if (!picture) return tl::unexpected{picture.error()};
  job.size = raster.is_portrait ? PixelSize{picture->size.height_px, picture->size.width_px} : picture->size;
  return std::make_unique<Sl1File>(std::move(job), raster, std::move(archive), std::move(names));
}

}  // namespace telefab::fab
