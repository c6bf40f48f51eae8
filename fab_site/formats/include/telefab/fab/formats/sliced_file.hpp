// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <telefab/fab/print/layer_motion.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <vector>

namespace telefab::fab {

/// Files of masks and exposures that other slicers make.
enum class SlicedFormat : std::uint8_t { Sl1, NanoDlp, Goo };
/// "sl1", ...
[[nodiscard]] std::string_view name_of(SlicedFormat format);
/// Nothing where the bytes are none of them. Looks into archives.
[[nodiscard]] std::optional<SlicedFormat> sliced_format_of(std::span<const std::byte> bytes);

/// What a file left unsaid; whoever prints it takes the machine's own.
enum class SlicedValue : std::uint8_t {
  PixelPitch,
  Model,      ///< of the printer
  Mirroring,  ///< whether the pictures are mirrored for a display
  Exposure,   ///< all exposures are zero here
  Lift,       ///< how far, where it is 0 here; else how fast
  LowerSpeed,
  WaitBeforeExposure,  ///< rest, lowered
  WaitAfterExposure,
  WaitAfterLift,
  SlowTilts,       ///< how many layers tilt slowly, but not which
  PrinterProfile,  ///< of the printer's own, in a form that is not read
};
/// "pixel-pitch", ...
[[nodiscard]] std::string_view name_of(SlicedValue value);

/// One exposure of a foreign job.
struct SlicedLayer {
  double z_mm = 0;  ///< top of the layer above the platform
  std::chrono::microseconds exposure{0};
  LayerMotion motion;      ///< what is absent (SlicedJob::absent) is LayerMotion's own
  double light_share = 1;  ///< of full light
  bool pauses = false;     ///< the printer stops before it until somebody goes on
  friend bool operator==(const SlicedLayer&, const SlicedLayer&) = default;
};

/// All that a foreign file tells of a job, but for its pixels.
struct SlicedJob {
  SlicedFormat format = SlicedFormat::Sl1;
  std::string name;     ///< of the job; printable
  std::string model;    ///< of the printer
  std::string program;  ///< that made it
  std::string resin;
  PixelSize size;             ///< of every mask, turned as `mask` gives them
  double pixel_width_mm = 0;  ///< 0: absent
  double pixel_height_mm = 0;
  double thickness_mm = 0;  ///< of all layers but perhaps the first, whose z says it
  std::vector<SlicedLayer> layers;
  std::vector<SlicedValue> absent;  ///< in order, once each
  [[nodiscard]] bool lacks(SlicedValue value) const;
};

/// A foreign file as a source of masks: those of the layers seen from above, as a plan's are, for what the file says of
/// mirrored or turned pictures is undone. Threads: one caller at a time.
class SlicedFile : public MaskSource {
 public:
  [[nodiscard]] const SlicedJob& job() const { return job_; }

 protected:
  explicit SlicedFile(SlicedJob job) : job_{std::move(job)} {}
  SlicedJob job_;
};

/// Reads what the file says and where its pixels are; `bytes` must outlive what comes back. Exposures of SL1 archives
/// are those that the newest program of those printers makes of them. A mask is unpacked when it is asked for, which
/// fails with NotFound (no such layer), InvalidInput (damaged; names the layer) or TooLarge.
/// Fails: InvalidInput (none of the formats, damaged, a value that is missing or out of any range, with its name),
/// TooLarge (more than 2^27 pixels a layer or 99,999 layers; an archive that unpacks to far more than its size). Safe
/// on any bytes: sizes are checked before memory is taken.
[[nodiscard]] Result<std::unique_ptr<SlicedFile>> read_sliced_file(std::span<const std::byte> bytes);

}  // namespace telefab::fab
