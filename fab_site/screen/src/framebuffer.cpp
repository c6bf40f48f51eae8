// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <linux/fb.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <telefab/base/open_file.hpp>
#include <telefab/fab/screen/packing.hpp>
#include <vector>

#include "scanout.hpp"

namespace telefab::fab {

namespace {

constexpr Nanoseconds kAssumedFrame{16'666'667};

/// A framebuffer, which shows what is written to it; or a file in its place, of as many rows without gaps.
class FramebufferScanout final : public Scanout {
 public:
  FramebufferScanout(OpenFile file, std::string path, const ScreenSettings& settings)
      : file_{std::move(file)}, path_{std::move(path)}, words_{settings.words}, packing_{settings.packing} {
    row_bytes_ = pitch_bytes_ = std::size_t{words_.width_px} * bytes_per_word(packing_);
  }

  Result<void> identify() {
    fb_var_screeninfo var{};
    fb_fix_screeninfo fix{};
    if (::ioctl(file_.get(), FBIOGET_VSCREENINFO, &var) == 0 && ::ioctl(file_.get(), FBIOGET_FSCREENINFO, &fix) == 0)
      return take_device(var, fix);
    struct stat status {};
    if (::fstat(file_.get(), &status) != 0 || !S_ISREG(status.st_mode))
      return fail(ErrorCode::DeviceRefused, fmt::format("screen: {} is neither a framebuffer nor a plain file", path_));
    const auto whole = static_cast<off_t>(pitch_bytes_ * words_.height_px);
    if (status.st_size != 0 && status.st_size != whole)
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("screen: the file {} has {} bytes, a frame of {} x {} words has {}", path_,
                              status.st_size, words_.width_px, words_.height_px, whole));
    name_ = fmt::format("{} {} x {}, a file", path_, words_.width_px, words_.height_px);
    return {};
  }

  const std::string& name() const override { return name_; }
  Nanoseconds frame() const override { return kAssumedFrame; }
  bool confirms() const override { return waits_; }
  Result<void> prepare(std::span<const std::byte> frame) override {
    prepared_.assign(frame.begin(), frame.end());
    return {};
  }
  Result<void> show() override { return write_frame(prepared_); }
  Result<void> black() override { return write_frame(std::vector<std::byte>(row_bytes_ * words_.height_px)); }

 private:
  Result<void> take_device(const fb_var_screeninfo& var, const fb_fix_screeninfo& fix) {
    const bool is_24 = var.bits_per_pixel == 32 && var.red.offset == 16 && var.red.length == 8 &&
                       var.green.offset == 8 && var.green.length == 8 && var.blue.offset == 0 && var.blue.length == 8;
    const std::uint32_t middle_bits = packing_ == PixelPacking::Bits565 ? 6 : 5;
    const bool is_16 = var.bits_per_pixel == 16 && var.blue.offset == 0 && var.green.offset == 5 &&
                       var.green.length == middle_bits && var.red.offset == 5 + middle_bits;
    const bool wants_24 = bytes_per_word(packing_) == 4;
    if (var.xres != words_.width_px || var.yres != words_.height_px)
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("screen: {} shows {} x {}, the profile says {} x {}; correct screen.width_px and "
                              "height_px, or set its mode (video= on the kernel's command line)",
                              path_, var.xres, var.yres, words_.width_px, words_.height_px));
    if (!(wants_24 ? is_24 : is_16) || fix.visual != FB_VISUAL_TRUECOLOR)
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("screen: {} has {} bits a word, red at {}, green at {}, blue at {}; its packing needs {}",
                              path_, var.bits_per_pixel, var.red.offset, var.green.offset, var.blue.offset,
                              wants_24 ? "32, 16, 8 and 0" : "16, blue at 0, green at 5"));
    if (var.xoffset != 0 || var.yoffset != 0)
      return fail(ErrorCode::DeviceRefused, fmt::format("screen: {} is panned by somebody else", path_));
    pitch_bytes_ = fix.line_length;
    std::uint32_t crtc = 0;
    waits_ = ::ioctl(file_.get(), FBIO_WAITFORVSYNC, &crtc) == 0;
    name_ = fmt::format("{} {} x {} ({:.16})", path_, var.xres, var.yres, fix.id);
    return {};
  }

  Result<void> write_frame(std::span<const std::byte> rows) {
    if (rows.size() != row_bytes_ * words_.height_px)
      return fail(ErrorCode::Internal, "screen: nothing was prepared to be shown");
    const bool has_gaps = pitch_bytes_ != row_bytes_;
    const std::size_t pieces = has_gaps ? words_.height_px : 1, piece_bytes = has_gaps ? row_bytes_ : rows.size();
    for (std::size_t i = 0; i < pieces; ++i)
      if (const auto ok = write_at(rows.subspan(i * piece_bytes, piece_bytes), i * pitch_bytes_); !ok) return ok;
    std::uint32_t crtc = 0;
    if (waits_ && ::ioctl(file_.get(), FBIO_WAITFORVSYNC, &crtc) != 0)
      return fail(ErrorCode::DeviceLost,
                  fmt::format("screen: {} does not say when it shows: {}", path_, std::strerror(errno)));
    return {};
  }

  Result<void> write_at(std::span<const std::byte> bytes, std::size_t offset) {
    while (!bytes.empty()) {
      const ssize_t n = ::pwrite(file_.get(), bytes.data(), bytes.size(), static_cast<off_t>(offset));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0)
        return fail(ErrorCode::DeviceLost, fmt::format("screen: cannot write to {}: {}", path_, std::strerror(errno)));
      bytes = bytes.subspan(static_cast<std::size_t>(n));
      offset += static_cast<std::size_t>(n);
    }
    return {};
  }

  OpenFile file_;
  std::string path_, name_;
  PixelSize words_;
  PixelPacking packing_;
  std::size_t row_bytes_ = 0, pitch_bytes_ = 0;
  bool waits_ = false;
  std::vector<std::byte> prepared_;
};

}  // namespace

Result<std::unique_ptr<Scanout>> open_framebuffer(const ScreenSettings& settings) {
  OpenFile file{::open(settings.connector.c_str(), O_RDWR | O_CLOEXEC)};
  if (file.get() < 0)
    return fail(ErrorCode::DeviceLost,
                fmt::format("screen: cannot open {}: {}{}", settings.connector, std::strerror(errno),
                            errno == EACCES ? "; join the group video" : ""));
  auto scanout = std::make_unique<FramebufferScanout>(std::move(file), settings.connector, settings);
  if (const auto ok = scanout->identify(); !ok) return tl::unexpected{ok.error()};
  if (const auto ok = scanout->black(); !ok) return tl::unexpected{ok.error()};
  return scanout;
}

}  // namespace telefab::fab
