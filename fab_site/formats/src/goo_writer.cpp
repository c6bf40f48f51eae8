// SPDX-License-Identifier: GPL-3.0-or-later
#include "goo_writer.hpp"

#include <fmt/format.h>

#include <bit>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/fab/device/projector.hpp>

#include "goo_layout.hpp"
#include "goo_runs.hpp"

namespace telefab::fab {
namespace {

constexpr std::uint32_t kLightSteps = 255;

class Fields {
 public:
  void u8(std::uint8_t value) { bytes_.push_back(static_cast<std::byte>(value)); }
  void u16(std::uint16_t value) {
    u8(static_cast<std::uint8_t>(value >> 8U));
    u8(static_cast<std::uint8_t>(value));
  }
  void u32(std::uint32_t value) {
    u16(static_cast<std::uint16_t>(value >> 16U));
    u16(static_cast<std::uint16_t>(value));
  }
  void f32(double value) { u32(std::bit_cast<std::uint32_t>(static_cast<float>(value))); }
  /// Zero-padded, and cut so that one zero stays.
  void text(std::string_view value, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i)
      u8(i + 1 < size && i < value.size() ? static_cast<std::uint8_t>(value[i]) : 0);
  }
  void magic() {
    for (const std::uint8_t b : goo::kMagic) u8(b);
  }
  void picture(const Image& image) {
    for (std::size_t i = 0; i + 2 < image.pixels.size(); i += 3)
      u16(static_cast<std::uint16_t>((image.pixels[i] >> 3U) << 11U | (image.pixels[i + 1] >> 2U) << 5U |
                                     image.pixels[i + 2] >> 3U));
  }
  [[nodiscard]] const std::vector<std::byte>& bytes() const { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
};

/// A lift or a lowering in the format's two parts, mm and mm/min.
struct TwoStage {
  double first_mm, first_speed, second_mm, second_speed;
};
TwoStage lift_of(const LayerMotion& m) {
  if (m.peel_mm <= 0) return {m.lift_mm, m.lift_speed_mm_per_s * 60, 0, m.lift_speed_mm_per_s * 60};
  return {m.peel_mm, m.peel_speed_mm_per_s * 60, m.lift_mm - m.peel_mm, m.lift_speed_mm_per_s * 60};
}
TwoStage lowering_of(const LayerMotion& m) {
  if (m.approach_mm <= 0) return {m.lift_mm, m.lower_speed_mm_per_s * 60, 0, m.lower_speed_mm_per_s * 60};
  const double approach_mm = std::min(m.approach_mm, m.lift_mm);
  return {m.lift_mm - approach_mm, m.lower_speed_mm_per_s * 60, approach_mm, m.approach_speed_mm_per_s * 60};
}

std::vector<std::byte> header_of(const PrintPlan& plan, const ArchiveFacts& f, const GooSummary& s) {
  const MachineProfile& m = *f.machine;
  const auto pwm_of = [&](bool is_bottom) {
    for (const PlannedLayer& layer : plan.layers)
      if ((layer.index.count() < f.bottom_layers) == is_bottom && layer.exposure.count() > 0)
        return static_cast<std::uint16_t>(std::lround(layer.light_share * kLightSteps));
    return static_cast<std::uint16_t>(kLightSteps);
  };
  Fields h;
  for (const char c : goo::kVersion) h.u8(static_cast<std::uint8_t>(c));
  h.magic();
  h.text("Telefab", 32);
  h.text("1", 24);
  h.text("1980-01-01 00:00:00", 24);  // same plan, same bytes
  h.text(f.model, goo::kModelBytes);
  h.text("LCD", 32);
  h.text(m.resin.name, 32);
  h.u16(8);  // levels of anti-alias, grey and blur; readers ignore them
  h.u16(0);
  h.u16(0);
  h.picture(s.small_preview);
  h.u16(goo::kDelimiter);
  h.picture(s.big_preview);
  h.u16(goo::kDelimiter);
  h.u32(f.layers);
  h.u16(static_cast<std::uint16_t>(f.size.width_px));
  h.u16(static_cast<std::uint16_t>(f.size.height_px));
  h.u8(f.optics.mirrors_x ? 1 : 0);
  h.u8(f.optics.mirrors_y ? 1 : 0);
  h.f32(f.size.width_px * m.projection.pixel_pitch_mm);
  h.f32(f.size.height_px * m.projection.pixel_pitch_mm);
  h.f32(m.platform.z_travel_mm);
  h.f32(m.layers.thickness_mm);
  h.f32(f.exposure_s);
  h.u8(1);   // waits as stated
  h.f32(0);  // turn-off time, of the other way to wait
  for (const LayerMotion* motion : {&f.bottom_motion, &f.motion}) {
    h.f32(motion->wait_after_exposure_s);
    h.f32(motion->wait_after_lift_s);
    h.f32(motion->settle_s);
  }
  h.f32(f.bottom_exposure_s);
  h.u32(f.bottom_layers);
  const TwoStage lifts[] = {lift_of(f.bottom_motion), lift_of(f.motion)};
  const TwoStage lowerings[] = {lowering_of(f.bottom_motion), lowering_of(f.motion)};
  for (const auto& stages : {lifts, lowerings})
    for (int i = 0; i < 2; ++i) h.f32(stages[i].first_mm), h.f32(stages[i].first_speed);
  for (const auto& stages : {lifts, lowerings})
    for (int i = 0; i < 2; ++i) h.f32(stages[i].second_mm), h.f32(stages[i].second_speed);
  h.u16(pwm_of(true));
  h.u16(pwm_of(false));
  h.u8(1);  // every layer states its own values
  h.u32(static_cast<std::uint32_t>(std::lround(std::min(f.print_s, 4e9))));
  h.f32(s.solid_mm3);
  h.f32(s.solid_mm3 / 1000 * m.resin.density_g_per_ml);
  h.f32(0);
  h.text("", 8);
  h.u32(goo::kHeaderBytes);
  h.u8(1);   // greys from 0 to 255
  h.u16(0);  // no transition: the layers say it
  return h.bytes();
}

std::vector<std::byte> definition_of(const PlannedLayer& layer, std::size_t packed_bytes) {
  const LayerMotion& m = layer.motion;
  const TwoStage lift = lift_of(m), lowering = lowering_of(m);
  Fields d;
  d.u16(0);  // no pause
  d.f32(0);
  d.f32(layer.z_mm);
  d.f32(std::chrono::duration<double>(layer.exposure).count());
  d.f32(0);
  d.f32(m.wait_after_exposure_s);
  d.f32(m.wait_after_lift_s);
  d.f32(m.settle_s);
  for (const TwoStage& s : {lift, lowering})
    for (const double value : {s.first_mm, s.first_speed, s.second_mm, s.second_speed}) d.f32(value);
  d.u16(static_cast<std::uint16_t>(std::lround(layer.light_share * kLightSteps)));
  d.u16(goo::kDelimiter);
  d.u32(static_cast<std::uint32_t>(packed_bytes));
  return d.bytes();
}

/// A file beside its place, removed unless it is finished.
class NewFile {
 public:
  static Result<std::unique_ptr<NewFile>> create(const std::filesystem::path& path) {
    auto temporary = make_temporary_beside(path);
    if (!temporary) return tl::unexpected{temporary.error()};
    std::unique_ptr<NewFile> made{new NewFile{path, *temporary}};
    if (made->file_ == nullptr) return fail_system("write", path, errno);
    return made;
  }
  NewFile(const NewFile&) = delete;
  NewFile& operator=(const NewFile&) = delete;
  ~NewFile() {
    if (file_ != nullptr) (void)std::fclose(file_);
    std::error_code ignored;  // a file beside the place; there is nobody left to tell
    if (!temporary_.empty()) std::filesystem::remove(temporary_, ignored);
  }
  Result<void> write(std::span<const std::byte> bytes) {
    if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) return fail_system("write", path_, errno);
    return {};
  }
  Result<void> rewind() {
    if (std::fseek(file_, 0, SEEK_SET) != 0) return fail_system("write", path_, errno);
    return {};
  }
  Result<void> finish() {
    const bool closed = std::fclose(std::exchange(file_, nullptr)) == 0;
    if (!closed) return fail_system("write", path_, errno);
    return put_in_place(std::exchange(temporary_, {}), path_);
  }

 private:
  NewFile(std::filesystem::path path, std::filesystem::path temporary)
      : path_{std::move(path)}, temporary_{std::move(temporary)}, file_{std::fopen(temporary_.c_str(), "wbe")} {}
  std::filesystem::path path_;
  std::filesystem::path temporary_;
  std::FILE* file_;
};

Result<void> check_goo(const PrintPlan& plan, const ArchiveFacts& f) {
  if (f.model.size() >= goo::kModelBytes)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the printer's name \"{}\" (file.model) has more than the {} bytes that a GOO file holds",
                            f.model, goo::kModelBytes - 1));
  if (f.model == goo::kLittleEndianModel)
    return fail(ErrorCode::InvalidInput,
                fmt::format("files for an {} have another order of bytes, which is not written here", f.model));
  for (const PlannedLayer& layer : plan.layers)
    if (auto step = light_step(layer.light_share, kLightSteps); !step)
      return fail_in(fmt::format("layer {}", layer.index.count()), step.error());
  return {};
}

}  // namespace

Result<void> write_goo(const std::filesystem::path& path, const PrintPlan& plan, const ArchiveFacts& facts,
                       const std::function<Result<Mask>(std::uint32_t layer)>& mask,
                       const std::function<GooSummary()>& summary, const ProgressSink& progress,
                       const std::stop_token& stop) {
  if (auto ok = check_goo(plan, facts); !ok) return ok;
  auto file = NewFile::create(path);
  if (!file) return tl::unexpected{file.error()};
  NewFile& out = **file;
  Fields delimiter;
  delimiter.u16(goo::kDelimiter);
  if (auto ok = out.write(std::vector<std::byte>(goo::kHeaderBytes)); !ok) return ok;
  for (std::uint32_t i = 0; i < facts.layers; ++i) {
    if (stop.stop_requested())
      return fail(ErrorCode::Cancelled, fmt::format("writing {} was cancelled; nothing was written", path.string()));
    const auto picture = mask(i);
    if (!picture) return tl::unexpected{picture.error()};
    const std::vector<std::byte> packed = goo::pack(picture->rows);
    for (const auto& bytes : {definition_of(plan.layers[i], packed.size()), packed, delimiter.bytes()})
      if (auto ok = out.write(bytes); !ok) return ok;
    report(progress, WorkStage::WritingMasks, (i + 1.0) / facts.layers);
  }
  Fields end;
  for (int i = 0; i < 3; ++i) end.u8(0);
  end.magic();
  if (auto ok = out.write(end.bytes()); !ok) return ok;
  if (auto ok = out.rewind(); !ok) return ok;
  const auto header = header_of(plan, facts, summary());
  if (header.size() != goo::kHeaderBytes) return fail(ErrorCode::Internal, "the header of a GOO file has another size");
  if (auto ok = out.write(header); !ok) return ok;
  return out.finish();
}

}  // namespace telefab::fab
