// SPDX-License-Identifier: GPL-3.0-or-later
#include <bit>
#include <charconv>
#include <telefab/base/text.hpp>
#include <telefab/fab/mask/orientation.hpp>

#include "goo_layout.hpp"
#include "goo_runs.hpp"
#include "sliced_readers.hpp"

namespace telefab::fab {
namespace {

constexpr double kMostLength_mm = 1000, kMostSpeed_mm_per_min = 100'000, kMostWait_s = 3600;

/// A 32-bit float as the decimal that somebody wrote: 0.1F is 0.1, not 0.10000000149.
double as_written(float value) {
  char text[32];
  const auto [end, error] = std::to_chars(text, text + sizeof text, value);
  double read = value;
  if (error == std::errc{}) (void)std::from_chars(text, end, read);
  return read;
}

/// Fields in the file's order. Past the end it gives zeros and remembers; values out of any range likewise.
class Fields {
 public:
  Fields(std::span<const std::byte> bytes, bool low_byte_first) : bytes_{bytes}, low_first_{low_byte_first} {}
  void skip(std::size_t count) { at_ += count; }
  std::uint32_t whole(std::size_t size) {
    std::uint32_t value = 0;
    if (at_ + size > bytes_.size()) {
      is_cut_ = true;
    } else {
      for (std::size_t i = 0; i < size; ++i)
        value = value << 8U | std::to_integer<std::uint32_t>(bytes_[at_ + (low_first_ ? size - 1 - i : i)]);
    }
    at_ += size;
    return value;
  }
  double number(std::string_view what, double most) {
    const float value = std::bit_cast<float>(whole(4));
    const bool fits = value >= 0 && value <= most;
    if (!fits && bad_.empty()) bad_ = fmt::format("{} is {}, not within 0 and {}", what, value, most);
    return fits ? as_written(value) : 0;
  }
  double speed(std::string_view what) { return std::round(number(what, kMostSpeed_mm_per_min) / 60 * 1e6) / 1e6; }
  std::string text(std::size_t size) {
    std::string value;
    for (std::size_t i = 0; i < size && at_ + i < bytes_.size() && bytes_[at_ + i] != std::byte{0}; ++i)
      value += static_cast<char>(bytes_[at_ + i]);
    at_ += size;
    return to_printable(value);
  }
  /// Two bytes, whatever the order of the others.
  void delimiter(std::string_view what) {
    expect(1, goo::kDelimiter >> 8U, what);
    expect(1, goo::kDelimiter & 0xFFU, what);
  }
  void expect(std::size_t size, std::uint32_t value, std::string_view what) {
    const std::uint32_t is = whole(size);
    if (is != value && bad_.empty()) bad_ = fmt::format("{} is {:#x}, where the format has {:#x}", what, is, value);
  }
  [[nodiscard]] std::size_t at() const { return at_; }
  [[nodiscard]] Result<void> check(std::string_view where) const {
    if (is_cut_) return fail(ErrorCode::InvalidInput, fmt::format("{} is cut off; copy the file again", where));
    if (!bad_.empty()) return fail(ErrorCode::InvalidInput, fmt::format("{}: {}", where, bad_));
    return {};
  }

 private:
  std::span<const std::byte> bytes_;
  bool low_first_;
  std::size_t at_ = 0;
  bool is_cut_ = false;
  std::string bad_;
};

struct Waits {
  double before_lift_s, after_lift_s, after_retract_s;
};
struct Stages {
  double first_mm, first_speed, second_mm, second_speed;
};

struct Header {
  std::string program, model, resin;
  std::uint32_t layers = 0;
  PixelSize size;
  Orientation optics;
  double width_mm = 0, height_mm = 0, thickness_mm = 0;
  double exposure_s = 0, bottom_exposure_s = 0;
  bool has_waits = false;
  Waits waits[2]{};  ///< bottom, normal
  std::uint32_t bottom_layers = 0;
  Stages lift[2]{}, retract[2]{};
  std::uint32_t light[2]{};
  bool layers_state_theirs = false;
  bool is_fine = false;  ///< greys from 0 to 255, else to 15
  std::uint32_t transition_layers = 0;
};

/// Members in the order of the braces are read in that order.
Waits waits_of(Fields& f) {
  return {f.number("wait before the lift", kMostWait_s), f.number("wait after the lift", kMostWait_s),
          f.number("wait after the lowering", kMostWait_s)};
}

Result<Header> header_of(std::span<const std::byte> bytes, bool low_byte_first) {
  Header h;
  Fields f{bytes.first(std::min(bytes.size(), goo::kHeaderBytes)), low_byte_first};
  f.skip(goo::kVersion.size());
  for (const std::uint8_t b : goo::kMagic) f.expect(1, b, "its magic number");
  h.program = f.text(32);
  f.skip(24 + 24);  // version of the program, time
  h.model = f.text(goo::kModelBytes);
  f.skip(32);
  h.resin = f.text(32);
  f.skip(3 * 2);
  for (const std::uint32_t side : {goo::kSmallPreview_px, goo::kBigPreview_px}) {
    f.skip(std::size_t{2} * side * side);
    f.delimiter("the end of a preview");
  }
  h.layers = f.whole(4);
  h.size = {f.whole(2), 0};
  h.size.height_px = f.whole(2);
  h.optics = {f.whole(1) != 0, false};
  h.optics.mirrors_y = f.whole(1) != 0;
  h.width_mm = f.number("the display's width", kMostLength_mm * 2);
  h.height_mm = f.number("the display's height", kMostLength_mm * 2);
  f.skip(4);
  h.thickness_mm = f.number("the layers' height", 1);
  h.exposure_s = f.number("the exposure", kMostExposure_s);
  h.has_waits = f.whole(1) == 1;
  f.skip(4);
  for (Waits& waits : h.waits) waits = waits_of(f);
  h.bottom_exposure_s = f.number("the bottom exposure", kMostExposure_s);
  h.bottom_layers = f.whole(4);
  for (auto* stages : {h.lift, h.retract})
    for (int i = 0; i < 2; ++i) {
      stages[i].first_mm = f.number("a lift", kMostLength_mm);
      stages[i].first_speed = f.speed("the speed of a lift");
    }
  for (auto* stages : {h.lift, h.retract})
    for (int i = 0; i < 2; ++i) {
      stages[i].second_mm = f.number("a second lift", kMostLength_mm);
      stages[i].second_speed = f.speed("the speed of a second lift");
    }
  for (std::uint32_t& light : h.light) light = f.whole(2);
  h.layers_state_theirs = f.whole(1) == 1;
  f.skip(4 + 3 * 4 + 8);
  f.expect(4, goo::kHeaderBytes, "the place of its layers");
  h.is_fine = f.whole(1) == 1;
  h.transition_layers = f.whole(2);
  if (auto ok = f.check("the header"); !ok) return tl::unexpected{ok.error()};
  if (h.thickness_mm <= 0) return fail(ErrorCode::InvalidInput, "the header: the layers' height is 0");
  const std::uint64_t pixels = std::uint64_t{h.size.width_px} * h.size.height_px;
  if (pixels == 0) return fail(ErrorCode::InvalidInput, "the header: a layer has no pixels");
  if (pixels > kMostSlicedPixels || h.layers > kMostSlicedLayers)
    return fail(ErrorCode::TooLarge,
                fmt::format("{} layers of {} x {} pixels; at most {} layers and {} pixels are read", h.layers,
                            h.size.width_px, h.size.height_px, kMostSlicedLayers, kMostSlicedPixels));
  if (h.layers == 0) return fail(ErrorCode::InvalidInput, "the header: the file has no layers");
  return h;
}

LayerMotion motion_of(const Stages& lift, const Stages& retract, const Waits& waits) {
  LayerMotion m;
  m.wait_after_exposure_s = waits.before_lift_s;
  m.wait_after_lift_s = waits.after_lift_s;
  m.settle_s = waits.after_retract_s;
  m.lift_mm = lift.first_mm + lift.second_mm;
  m.lift_speed_mm_per_s = lift.first_speed;
  if (lift.second_mm > 0 && lift.first_mm > 0) {
    m.peel_mm = lift.first_mm;
    m.peel_speed_mm_per_s = lift.first_speed;
  }
  if (lift.second_mm > 0) m.lift_speed_mm_per_s = lift.second_speed;
  m.lower_speed_mm_per_s = retract.first_mm > 0 || retract.second_mm <= 0 ? retract.first_speed : retract.second_speed;
  if (retract.second_mm > 0 && retract.first_mm > 0) {
    m.approach_mm = retract.second_mm;
    m.approach_speed_mm_per_s = retract.second_speed;
  }
  return m;
}

class GooFile final : public SlicedFile {
 public:
  GooFile(SlicedJob job, bool is_fine, Orientation optics, std::vector<std::span<const std::byte>> packed)
      : SlicedFile{std::move(job)}, is_fine_{is_fine}, optics_{optics}, packed_{std::move(packed)} {}
  Result<Mask> mask(LayerIndex layer) override {
    if (layer.count() >= packed_.size())
      return fail(ErrorCode::NotFound, fmt::format("there is no layer {}", layer.count()));
    const std::size_t count = std::size_t{job_.size.width_px} * job_.size.height_px;
    auto pixels = goo::unpack(packed_[layer.count()], count);
    if (!pixels) return fail_in(fmt::format("layer {}", layer.count()), pixels.error());
    if (!is_fine_)
      for (std::uint8_t& grey : *pixels) {
        if (grey > 15)
          return fail(ErrorCode::InvalidInput,
                      fmt::format("layer {}: a grey of {} in a file of 16 greys", layer.count(), grey));
        grey = static_cast<std::uint8_t>(grey * 17);
      }
    Mask mask{job_.size, std::move(*pixels)};
    return optics_ == Orientation{} ? mask : turned_for_optics(mask.view(), optics_);
  }

 private:
  bool is_fine_;
  Orientation optics_;
  std::vector<std::span<const std::byte>> packed_;
};

/// What a layer's definition states of its own.
struct Definition {
  SlicedLayer layer;
  Stages lift{}, retract{};
  std::size_t packed_bytes = 0;
};

Result<Definition> definition_of(std::span<const std::byte> bytes, bool low_byte_first, std::uint32_t index) {
  Fields f{bytes.first(std::min(bytes.size(), goo::kLayerBytes)), low_byte_first};
  Definition d;
  d.layer.pauses = f.whole(2) != 0;
  f.skip(4);
  d.layer.z_mm = f.number("its height", 2 * kMostLength_mm);
  d.layer.exposure = exposure_of(f.number("its exposure", kMostExposure_s));
  f.skip(4);
  const Waits waits = waits_of(f);
  for (Stages* s : {&d.lift, &d.retract}) {
    s->first_mm = f.number("a lift", kMostLength_mm);
    s->first_speed = f.speed("the speed of a lift");
    s->second_mm = f.number("a second lift", kMostLength_mm);
    s->second_speed = f.speed("the speed of a second lift");
  }
  d.layer.motion = motion_of(d.lift, d.retract, waits);
  const std::uint32_t light = f.whole(2);
  d.layer.light_share = light / 255.0;
  f.delimiter("the end of its definition");
  d.packed_bytes = f.whole(4);
  const std::string where = fmt::format("layer {}", index);
  if (auto ok = f.check(where); !ok) return tl::unexpected{ok.error()};
  if (light > 255) return fail(ErrorCode::InvalidInput, fmt::format("{}: its light is {}, above 255", where, light));
  return d;
}

/// What the header says of a layer where layers do not state their own.
void take_from_header(const Header& h, std::uint32_t index, SlicedLayer& layer) {
  const int which = index < h.bottom_layers ? 0 : 1;
  layer.exposure =
      exposure_of(stepped_exposure_s(index, h.bottom_layers, h.transition_layers, h.bottom_exposure_s, h.exposure_s));
  layer.motion = motion_of(h.lift[which], h.retract[which], h.waits[which]);
  layer.light_share = std::min(h.light[which], 255U) / 255.0;
}

}  // namespace

Result<std::unique_ptr<SlicedFile>> read_goo(std::span<const std::byte> bytes) {
  std::string model;
  for (std::size_t i = goo::kModelAt; i < goo::kModelAt + goo::kModelBytes && i < bytes.size(); ++i)
    if (bytes[i] != std::byte{0}) model += static_cast<char>(bytes[i]);
  const bool low_byte_first = model == goo::kLittleEndianModel;
  auto header = header_of(bytes, low_byte_first);
  if (!header) return tl::unexpected{header.error()};
  Header& h = *header;

  SlicedJob job;
  job.format = SlicedFormat::Goo;
  job.model = std::move(h.model);
  job.program = std::move(h.program);
  job.resin = std::move(h.resin);
  job.size = h.size;
  job.pixel_width_mm = h.width_mm / h.size.width_px;
  job.pixel_height_mm = h.height_mm / h.size.height_px;
  job.thickness_mm = h.thickness_mm;
  std::vector<std::span<const std::byte>> packed;
  auto rest = bytes.subspan(goo::kHeaderBytes);
  bool lifts = true;
  double below_mm = 0;
  for (std::uint32_t i = 0; i < h.layers; ++i) {
    auto definition = definition_of(rest, low_byte_first, i);
    if (!definition) return tl::unexpected{definition.error()};
    SlicedLayer& layer = definition->layer;
    rest = rest.subspan(goo::kLayerBytes);
    if (rest.size() < 2 || definition->packed_bytes > rest.size() - 2)
      return fail(ErrorCode::InvalidInput, fmt::format("layer {} is cut off; copy the file again", i));
    packed.push_back(rest.first(definition->packed_bytes));
    Fields end{rest.subspan(definition->packed_bytes, 2), low_byte_first};
    end.delimiter("the end of its pixels");
    if (auto ok = end.check(fmt::format("layer {}", i)); !ok) return tl::unexpected{ok.error()};
    rest = rest.subspan(definition->packed_bytes + 2);
    if (!h.layers_state_theirs) take_from_header(h, i, layer);
    if (layer.z_mm <= below_mm)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("layer {} lies at {} mm, not above {} mm, where the one below it "
                              "does",
                              i, layer.z_mm, below_mm));
    if (layer.exposure.count() > 0 && layer.light_share <= 0)
      return fail(ErrorCode::InvalidInput, fmt::format("layer {} has an exposure, but no light", i));
    below_mm = layer.z_mm;
    lifts = lifts && layer.motion.lift_mm > 0 && layer.motion.lift_speed_mm_per_s > 0 &&
            (layer.motion.peel_mm == 0 || layer.motion.peel_speed_mm_per_s > 0);
    job.layers.push_back(layer);
  }
  Fields end{rest, low_byte_first};
  for (int i = 0; i < 3; ++i) end.expect(1, 0, "its ending");
  for (const std::uint8_t b : goo::kMagic) end.expect(1, b, "its ending");
  if (auto ok = end.check("the end of the file"); !ok) return tl::unexpected{ok.error()};
  if (rest.size() != goo::kEndBytes)
    return fail(ErrorCode::InvalidInput, fmt::format("{} bytes stand behind the end", rest.size() - goo::kEndBytes));
  if (job.pixel_width_mm <= 0 || job.pixel_height_mm <= 0) job.absent.push_back(SlicedValue::PixelPitch);
  if (job.model.empty()) job.absent.push_back(SlicedValue::Model);
  if (!lifts) job.absent.push_back(SlicedValue::Lift);
  if (!h.has_waits)
    for (const auto wait :
         {SlicedValue::WaitBeforeExposure, SlicedValue::WaitAfterExposure, SlicedValue::WaitAfterLift})
      job.absent.push_back(wait);
  return std::make_unique<GooFile>(std::move(job), h.is_fine, h.optics, std::move(packed));
}

}  // namespace telefab::fab
