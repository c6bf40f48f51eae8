// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <telefab/fab/formats/foreign_print.hpp>
#include <utility>

namespace telefab::fab {
namespace {

constexpr double kPitchShare = 0.01;  ///< what publishers of pixel pitches round away

/// Masks of a file together with its bytes.
class KeptMasks final : public MaskSource {
 public:
  KeptMasks(FileBytes bytes, std::unique_ptr<SlicedFile> file) : bytes_{std::move(bytes)}, file_{std::move(file)} {}
  [[nodiscard]] Result<Mask> mask(LayerIndex layer) override { return file_->mask(layer); }

 private:
  FileBytes bytes_;  ///< outlives the file that looks into it
  std::unique_ptr<SlicedFile> file_;
};

Result<void> check_pixels(const SlicedJob& job, const MachineProfile& machine) {
  const PixelSize size = machine.mask_size();
  if (!(job.size == size))
    return fail(ErrorCode::InvalidInput,
                fmt::format("the masks have {} x {} pixels; {} has {} x {}. Slice it for this machine",
                            job.size.width_px, job.size.height_px, machine.name, size.width_px, size.height_px));
  const double pitch_mm = machine.projection.pixel_pitch_mm;
  for (const double stated_mm : {job.pixel_width_mm, job.pixel_height_mm})
    if (stated_mm > 0 && std::abs(stated_mm - pitch_mm) > kPitchShare * pitch_mm)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the pixels are {:.5g} x {:.5g} mm large; those of {} are {:.5g} mm. Slice it for this "
                              "machine",
                              job.pixel_width_mm, job.pixel_height_mm, machine.name, pitch_mm));
  return {};
}

Result<void> check_layers(const SlicedJob& job, const MachineProfile& machine) {
  const auto& platform = machine.platform;
  const double t = job.thickness_mm;
  if ((platform.least_layer_mm > 0 && t < platform.least_layer_mm * (1 - kPitchShare)) ||
      (platform.most_layer_mm > 0 && t > platform.most_layer_mm * (1 + kPitchShare)))
    return fail(ErrorCode::InvalidInput, fmt::format("the layers are {} mm thick; {} makes layers of {} to {} mm", t,
                                                     machine.name, platform.least_layer_mm, platform.most_layer_mm));
  if (!job.layers.empty() && job.layers.back().z_mm > platform.z_travel_mm)
    return fail(ErrorCode::InvalidInput, fmt::format("the print is {:.2f} mm high; {} travels {} mm",
                                                     job.layers.back().z_mm, machine.name, platform.z_travel_mm));
  // Before any pixel is unpacked: many thin layers would cost much.
  for (std::size_t i = 1; i < job.layers.size(); ++i)
    if (const double own = job.layers[i].z_mm - job.layers[i - 1].z_mm; std::abs(own - t) > 0.05 * t + 1e-3)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("layer {} is {:.4f} mm thick and the file states {}; layers of different thickness are "
                              "not read",
                              i, own, t));
  for (std::size_t i = 0; i < job.layers.size(); ++i)
    if (job.layers[i].pauses)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("the printer is to stop before layer {}, which is not possible here: take the stop out "
                              "of the file",
                              i));
  return {};
}

/// What the file leaves unsaid of a layer's motion, from the machine's.
LayerMotion completed(LayerMotion stated, const SlicedJob& job, const LayerMotion& own) {
  if (job.lacks(SlicedValue::Lift)) {
    if (stated.lift_mm <= 0 && stated.tilt_s <= 0) {
      stated.lift_mm = own.lift_mm;
      stated.peel_mm = own.peel_mm;
      stated.peel_speed_mm_per_s = own.peel_speed_mm_per_s;
      stated.tilt_s = own.tilt_s;
    }
    stated.lift_speed_mm_per_s = own.lift_speed_mm_per_s;
  }
  if (job.lacks(SlicedValue::LowerSpeed)) stated.lower_speed_mm_per_s = own.lower_speed_mm_per_s;
  if (job.lacks(SlicedValue::WaitBeforeExposure)) stated.settle_s = own.settle_s;
  if (job.lacks(SlicedValue::WaitAfterExposure)) stated.wait_after_exposure_s = own.wait_after_exposure_s;
  if (job.lacks(SlicedValue::WaitAfterLift)) stated.wait_after_lift_s = own.wait_after_lift_s;
  return stated;
}

std::string origin_of(const SlicedJob& job, const MachineProfile& machine) {
  std::string text = fmt::format("masks, times and motion are those of a file ({}", name_of(job.format));
  if (!job.program.empty()) text += " of " + job.program;
  if (!job.model.empty()) text += " for " + job.model;
  if (!job.resin.empty()) text += ", resin " + job.resin;
  text += ')';
  std::vector<std::string_view> own;
  for (const SlicedValue value : job.absent) own.push_back(name_of(value));
  if (!own.empty())
    text += fmt::format("; it does not say {}, for which {}'s are taken", fmt::join(own, ", "), machine.name);
  return text;
}

struct Read {
  SlicedJob job;
  ReadyPrint print;
};

Result<Read> read_for(const FileBytes& bytes, const MachineProfile& machine) {
  auto file = read_sliced_file(*bytes);
  if (!file) return tl::unexpected{file.error()};
  Read read{(*file)->job(), {}};
  const SlicedJob& job = read.job;
  if (auto ok = check_pixels(job, machine); !ok) return tl::unexpected{ok.error()};
  if (auto ok = check_layers(job, machine); !ok) return tl::unexpected{ok.error()};
  read.print.thickness_mm = job.thickness_mm;
  for (std::uint32_t i = 0; i < job.layers.size(); ++i) {
    const SlicedLayer& stated = job.layers[i];
    ReadyPrint::Layer layer{stated.z_mm, stated.exposure, {}, stated.light_share};
    if (job.lacks(SlicedValue::Exposure)) {
      layer.exposure = std::chrono::microseconds{std::llround(machine.exposure_of_layer_s(i) * 1e6)};
      layer.light_share = machine.light_share_of_layer(i);
    }
    layer.motion = completed(stated.motion, job, motion_of(machine.motion, i < machine.layers.bottom_count, 0));
    if (auto ok = layer.motion.validate(); !ok) return fail_in(fmt::format("layer {}", i), ok.error());
    read.print.layers.push_back(layer);
  }
  read.print.origin = origin_of(job, machine);
  read.print.masks = std::make_shared<KeptMasks>(bytes, std::move(*file));
  return read;
}

}  // namespace

bool is_foreign_print(std::span<const std::byte> bytes) {
  return sliced_format_of(bytes).has_value() || import_format_of(bytes).has_value();
}

Result<ReadyPrint> ready_for(const FileBytes& bytes, const MachineProfile& machine) {
  auto read = read_for(bytes, machine);
  if (!read) return tl::unexpected{read.error()};
  return std::move(read->print);
}

Result<ForeignPrint> read_foreign_print(const FileBytes& bytes, const MachineProfile& machine, std::string_view name,
                                        const ProgressSink& progress, const std::stop_token& stop) {
  // Archives of masks first: a 3MF file is a zip too.
  if (const auto sliced = sliced_format_of(*bytes)) {
    auto read = read_for(bytes, machine);
    if (!read) return tl::unexpected{read.error()};
    auto stack = outlines_of(read->print, machine, name, progress, stop);
    if (!stack) return tl::unexpected{stack.error()};
    return ForeignPrint{name_of(*sliced), std::move(*stack), std::make_shared<const ReadyPrint>(std::move(read->print)),
                        std::nullopt, std::move(read->job)};
  }
  if (const auto contours = import_format_of(*bytes)) {
    ImportOptions options;
    options.name = name;
    auto import = import_contours(*bytes, machine, options, progress, stop);
    if (!import) return tl::unexpected{import.error()};
    return ForeignPrint{name_of(*contours), std::move(import->stack), nullptr, std::move(import->report), std::nullopt};
  }
  return fail(
      ErrorCode::InvalidInput,
      "none of the formats that can be read: .tfc of a scan site, SL1, NanoDLP and GOO with masks, CLI, SVG with "
      "slic3r:z, 3MF with slices and JSON lines with contours are");
}

}  // namespace telefab::fab
