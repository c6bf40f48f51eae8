// SPDX-License-Identifier: GPL-3.0-or-later
#include <drm_fourcc.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <sys/mman.h>
#include <xf86drm.h>
#include <xf86drmMode.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <optional>
#include <telefab/base/open_file.hpp>
#include <telefab/fab/screen/edid.hpp>
#include <telefab/fab/screen/packing.hpp>
#include <vector>

#include "scanout.hpp"

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr int kMostCards = 16;
constexpr double kSameRefresh_hz = 0.1;
/// A flip that no refresh confirmed in so many frames, and never sooner than that, is a fault.
constexpr int kFlipFrames = 3;
constexpr Nanoseconds kFlipPatience = 150ms;

template <class T, void (*kFree)(T*)>
struct Freed {
  void operator()(T* p) const { kFree(p); }
};
using Resources = std::unique_ptr<drmModeRes, Freed<drmModeRes, drmModeFreeResources>>;
using Connector = std::unique_ptr<drmModeConnector, Freed<drmModeConnector, drmModeFreeConnector>>;
using Encoder = std::unique_ptr<drmModeEncoder, Freed<drmModeEncoder, drmModeFreeEncoder>>;
using Crtc = std::unique_ptr<drmModeCrtc, Freed<drmModeCrtc, drmModeFreeCrtc>>;
using Property = std::unique_ptr<drmModePropertyRes, Freed<drmModePropertyRes, drmModeFreeProperty>>;
using Blob = std::unique_ptr<drmModePropertyBlobRes, Freed<drmModePropertyBlobRes, drmModeFreePropertyBlob>>;

tl::unexpected<Error> failed(std::string_view what) {
  const ErrorCode code =
      errno == EACCES || errno == EPERM || errno == EBUSY ? ErrorCode::DeviceRefused : ErrorCode::DeviceLost;
  return fail(
      code, fmt::format("screen: {}: {}{}", what, std::strerror(errno),
                        code == ErrorCode::DeviceRefused ? "; does another program, a desktop, drive this card?" : ""));
}

double refresh_of(const drmModeModeInfo& mode) {
  return mode.htotal == 0 || mode.vtotal == 0 ? 0 : mode.clock * 1000.0 / (double(mode.htotal) * mode.vtotal);
}

std::string name_of(const drmModeConnector& connector) {
  const char* type = drmModeGetConnectorTypeName(connector.connector_type);
  return fmt::format("{}-{}", type != nullptr ? type : "Unknown", connector.connector_type_id);
}

/// A property of an object and its value.
struct Setting {
  Property property;
  std::uint64_t value = 0;
};

std::optional<Setting> find_setting(int card, const drmModeConnector& connector, std::string_view name) {
  for (int i = 0; i < connector.count_props; ++i) {
    Property property{drmModeGetProperty(card, connector.props[i])};
    if (property && property->name == name) return Setting{std::move(property), connector.prop_values[i]};
  }
  return std::nullopt;
}

/// As edid_identity, "none" where there is none, or why it cannot be read.
std::string identity_of(int card, const drmModeConnector& connector) {
  const auto setting = find_setting(card, connector, "EDID");
  if (!setting || setting->value == 0) return "none";
  const Blob blob{drmModeGetPropertyBlob(card, static_cast<std::uint32_t>(setting->value))};
  if (!blob) return "none";
  const auto identity = edid_identity({static_cast<const std::byte*>(blob->data), blob->length});
  return identity ? *identity : "damaged: " + identity.error().what;
}

struct FoundConnector {
  OpenFile card;
  std::string path;
  Connector connector;
  std::string identity;
};

std::vector<FoundConnector> find_connectors() {
  std::vector<FoundConnector> found;
  for (int i = 0; i < kMostCards; ++i) {
    const std::string path = fmt::format("/dev/dri/card{}", i);
    const OpenFile card{::open(path.c_str(), O_RDWR | O_CLOEXEC)};
    if (card.get() < 0) continue;
    const Resources resources{drmModeGetResources(card.get())};
    if (!resources) continue;
    for (int c = 0; c < resources->count_connectors; ++c) {
      Connector connector{drmModeGetConnector(card.get(), resources->connectors[c])};
      if (!connector) continue;
      std::string identity = identity_of(card.get(), *connector);
      // One open file of the card for the one that will be used; the first to open it drives it.
      found.push_back({OpenFile{}, path, std::move(connector), std::move(identity)});
    }
  }
  return found;
}

std::string describe(const FoundConnector& found) {
  std::string text = fmt::format("{} on {}: ", name_of(*found.connector), found.path);
  if (found.connector->connection != DRM_MODE_CONNECTED) return text + "nothing connected";
  text += fmt::format("edid = \"{}\"; modes", found.identity);
  for (int i = 0; i < found.connector->count_modes; ++i) {
    const drmModeModeInfo& mode = found.connector->modes[i];
    text += fmt::format("{} {} x {} at {:.2f}", i == 0 ? "" : ",", mode.hdisplay, mode.vdisplay, refresh_of(mode));
  }
  return text;
}

std::string all_of(const std::vector<FoundConnector>& found) {
  std::string text;
  for (const FoundConnector& one : found) text += "\n  " + describe(one);
  return text.empty() ? " none" : text;
}

/// Memory that the card scans out.
struct DumbBuffer {
  std::uint32_t handle = 0, pitch_bytes = 0, id = 0;
  std::size_t bytes = 0;
  std::byte* rows = nullptr;
};

Result<DumbBuffer> make_buffer(int card, PixelSize words, PixelPacking packing) {
  drm_mode_create_dumb create{};
  create.width = words.width_px;
  create.height = words.height_px;
  create.bpp = bytes_per_word(packing) * 8;
  if (drmIoctl(card, DRM_IOCTL_MODE_CREATE_DUMB, &create) != 0) return failed("cannot make a frame");
  DumbBuffer buffer{create.handle, create.pitch, 0, create.size, nullptr};
  const std::uint32_t handles[4] = {create.handle}, pitches[4] = {create.pitch}, offsets[4] = {};
  const std::uint32_t format = packing == PixelPacking::Bits565   ? DRM_FORMAT_RGB565
                               : packing == PixelPacking::Bits555 ? DRM_FORMAT_XRGB1555
                                                                  : DRM_FORMAT_XRGB8888;
  if (drmModeAddFB2(card, words.width_px, words.height_px, format, handles, pitches, offsets, &buffer.id, 0) != 0)
    return failed("the card takes no frame of this format");
  drm_mode_map_dumb map{};
  map.handle = create.handle;
  if (drmIoctl(card, DRM_IOCTL_MODE_MAP_DUMB, &map) != 0) return failed("cannot reach a frame");
  void* rows = ::mmap(nullptr, buffer.bytes, PROT_READ | PROT_WRITE, MAP_SHARED, card, static_cast<off_t>(map.offset));
  if (rows == MAP_FAILED) return failed("cannot reach a frame");
  buffer.rows = static_cast<std::byte*>(rows);
  std::memset(buffer.rows, 0, buffer.bytes);
  return buffer;
}

/// A connector of a card that shows one of three frames: two by turns, and one that stays black.
class KmsScanout final : public Scanout {
 public:
  KmsScanout(const ScreenSettings& settings, Clock& clock) : settings_{settings}, clock_{clock} {}
  ~KmsScanout() override {
    if (card_.get() >= 0 && crtc_ != 0) (void)black();
  }

  Result<void> open() {
    if (const auto ok = choose(); !ok) return ok;
    if (const auto ok = check_card(); !ok) return ok;
    if (const auto ok = choose_mode(); !ok) return ok;
    if (const auto ok = choose_crtc(); !ok) return ok;
    for (DumbBuffer& buffer : buffers_) {
      auto made = make_buffer(card_.get(), settings_.words, settings_.packing);
      if (!made) return tl::unexpected{made.error()};
      buffer = *made;
    }
    if (const auto ok = pass_values_unchanged(); !ok) return ok;
    if (const auto ok = black(); !ok) return ok;
    name_ = fmt::format("{} {} x {} at {:.2f} Hz ({})", settings_.connector, mode_.hdisplay, mode_.vdisplay,
                        refresh_of(mode_), settings_.edid);
    return {};
  }

  const std::string& name() const override { return name_; }
  Nanoseconds frame() const override { return Nanoseconds{static_cast<Nanoseconds::rep>(1e9 / refresh_of(mode_))}; }
  bool confirms() const override { return true; }
  int shared_file() const override { return card_.get(); }
  BlackMeans black_means() const override {
    BlackMeans means{connector_id_, crtc_, buffers_[kBlack].id, {}};
    static_assert(sizeof mode_ <= sizeof means.mode);
    std::memcpy(means.mode, &mode_, sizeof mode_);
    return means;
  }

  Result<void> prepare(std::span<const std::byte> frame) override {
    DumbBuffer& buffer = buffers_[hidden_];
    const std::size_t row_bytes = std::size_t{settings_.words.width_px} * bytes_per_word(settings_.packing);
    for (std::uint32_t y = 0; y < settings_.words.height_px; ++y)
      std::memcpy(buffer.rows + std::size_t{y} * buffer.pitch_bytes, frame.data() + y * row_bytes, row_bytes);
    return {};
  }

  /// The card goes on scanning out, and takes frames, whether anything is connected or not.
  Result<void> check() override {
    const Connector connector{drmModeGetConnectorCurrent(card_.get(), connector_id_)};
    if (!connector) return failed("its connector is gone");
    if (connector->connection != DRM_MODE_CONNECTED)
      return fail(ErrorCode::DeviceLost,
                  fmt::format("screen: it was disconnected from {}; look at its cable and power", settings_.connector));
    return {};
  }

  Result<void> show() override {
    if (const auto ok = check(); !ok) return ok;
    if (const auto ok = flip(buffers_[hidden_].id); !ok) return ok;
    hidden_ = 1 - hidden_;
    return {};
  }

  Result<void> black() override {
    // Setting the mode is slower than a flip and works from any state.
    if (!is_set_ || !flip(buffers_[kBlack].id)) {
      if (const auto ok = blacken_kms(card_.get(), black_means()); !ok) return ok;
      is_set_ = true;
    }
    return {};
  }

 private:
  Result<void> choose() {
    auto found = find_connectors();
    FoundConnector* chosen = nullptr;
    int many = 0;
    for (FoundConnector& one : found) {
      if (name_of(*one.connector) != settings_.connector) continue;
      if (settings_.edid.empty() || one.identity == settings_.edid || many == 0) chosen = &one;
      many += one.identity == settings_.edid || many == 0 ? 1 : 0;
    }
    if (chosen == nullptr)
      return fail(ErrorCode::DeviceLost,
                  fmt::format("screen: there is no connector \"{}\"; screen.connector must be one of:{}",
                              settings_.connector, all_of(found)));
    if (chosen->connector->connection != DRM_MODE_CONNECTED)
      return fail(ErrorCode::DeviceLost,
                  fmt::format("screen: nothing is connected to {}; look at its cable and power", settings_.connector));
    if (settings_.edid.empty())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("screen: state who it is, or any other screen would get the masks: screen.edid = \"{}\"",
                              chosen->identity));
    if (chosen->identity != settings_.edid)
      return fail(ErrorCode::DeviceRefused, fmt::format("screen: {} is \"{}\", the profile says screen.edid = \"{}\"",
                                                        settings_.connector, chosen->identity, settings_.edid));
    connector_id_ = chosen->connector->connector_id;
    const std::string path = chosen->path;
    card_ = OpenFile{::open(path.c_str(), O_RDWR | O_CLOEXEC)};
    if (card_.get() < 0) return failed("cannot open " + path);
    // The first that opens a card drives it; where another one did before, this fails and nothing is shown.
    if (drmSetMaster(card_.get()) != 0 && drmIsMaster(card_.get()) == 0)
      return failed("cannot drive " + path + ", of which one machine at a time has all connectors");
    return {};
  }

  Result<void> check_card() {
    std::uint64_t dumb = 0, monotonic = 0;
    if (drmGetCap(card_.get(), DRM_CAP_DUMB_BUFFER, &dumb) != 0 || dumb == 0)
      return fail(ErrorCode::DeviceRefused, "screen: its card has no frames that a program can write to");
    if (drmGetCap(card_.get(), DRM_CAP_TIMESTAMP_MONOTONIC, &monotonic) != 0 || monotonic == 0)
      return fail(ErrorCode::DeviceRefused, "screen: its card does not date what it shows");
    return {};
  }

  Result<void> choose_mode() {
    const Connector connector{drmModeGetConnector(card_.get(), connector_id_)};
    if (!connector) return failed("its connector is gone");
    for (int i = 0; i < connector->count_modes; ++i) {
      const drmModeModeInfo& mode = connector->modes[i];
      if (mode.hdisplay != settings_.words.width_px || mode.vdisplay != settings_.words.height_px ||
          (mode.flags & DRM_MODE_FLAG_INTERLACE) != 0 ||
          std::abs(refresh_of(mode) - settings_.refresh_hz) > kSameRefresh_hz)
        continue;
      mode_ = mode;
      return {};
    }
    std::string modes;
    for (int i = 0; i < connector->count_modes; ++i)
      modes += fmt::format("\n  {} x {} at {:.2f}", connector->modes[i].hdisplay, connector->modes[i].vdisplay,
                           refresh_of(connector->modes[i]));
    return fail(
        ErrorCode::DeviceRefused,
        fmt::format("screen: {} has no mode of {} x {} at {} Hz, and masks are not scaled; state one of its own "
                    "as screen.width_px, height_px and refresh_hz:{}",
                    settings_.connector, settings_.words.width_px, settings_.words.height_px, settings_.refresh_hz,
                    modes));
  }

  Result<void> choose_crtc() {
    const Resources resources{drmModeGetResources(card_.get())};
    const Connector connector{drmModeGetConnector(card_.get(), connector_id_)};
    if (!resources || !connector) return failed("its connector is gone");
    for (int e = 0; e < connector->count_encoders; ++e) {
      const Encoder encoder{drmModeGetEncoder(card_.get(), connector->encoders[e])};
      if (!encoder) continue;
      for (int c = 0; c < resources->count_crtcs; ++c)
        if ((encoder->possible_crtcs & 1u << c) != 0) {
          crtc_ = resources->crtcs[c];
          return {};
        }
    }
    return fail(ErrorCode::DeviceRefused, "screen: its card has nothing that drives this connector");
  }

  /// What is written is what is sent: no limited range, no table between.
  Result<void> pass_values_unchanged() {
    const Connector connector{drmModeGetConnector(card_.get(), connector_id_)};
    if (!connector) return failed("its connector is gone");
    if (const auto range = find_setting(card_.get(), *connector, "Broadcast RGB")) {
      std::optional<std::uint64_t> full;
      for (int i = 0; i < range->property->count_enums; ++i)
        if (std::string_view{range->property->enums[i].name} == "Full") full = range->property->enums[i].value;
      if (!full || drmModeConnectorSetProperty(card_.get(), connector_id_, range->property->prop_id, *full) != 0)
        return fail(
            ErrorCode::DeviceRefused,
            "screen: its card may send a limited range of greys, and cannot be told to send all (Broadcast RGB)");
    }
    const Crtc crtc{drmModeGetCrtc(card_.get(), crtc_)};
    if (!crtc) return failed("its card does not say what it drives");
    if (const auto size = static_cast<std::uint32_t>(std::max(crtc->gamma_size, 0)); size > 1) {
      std::vector<std::uint16_t> straight(size);
      for (std::uint32_t i = 0; i < size; ++i) straight[i] = static_cast<std::uint16_t>(i * 65535u / (size - 1));
      if (drmModeCrtcSetGamma(card_.get(), crtc_, size, straight.data(), straight.data(), straight.data()) != 0)
        return failed("its card keeps a table of greys of its own");
    }
    return {};
  }

  Result<void> flip(std::uint32_t buffer) {
    // Each flip has a place of its own: an event that comes too late must not pass for another's.
    bool& is_done = done_[flips_++ % done_.size()];
    is_done = false;
    if (drmModePageFlip(card_.get(), crtc_, buffer, DRM_MODE_PAGE_FLIP_EVENT, &is_done) != 0)
      return failed("it takes no frame");
    drmEventContext events{};
    events.version = 2;
    events.page_flip_handler = [](int, unsigned, unsigned, unsigned, void* done) { *static_cast<bool*>(done) = true; };
    const Nanoseconds until = clock_.now() + std::max(kFlipPatience, kFlipFrames * frame());
    while (!is_done) {
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(until - clock_.now()).count();
      pollfd waited{card_.get(), POLLIN, 0};
      if (left <= 0 || ::poll(&waited, 1, static_cast<int>(left)) == 0)
        return fail(ErrorCode::DeviceTimeout, "screen: no refresh confirms the frame");
      if ((waited.revents & POLLIN) != 0 && drmHandleEvent(card_.get(), &events) != 0)
        return failed("it does not say what it shows");
    }
    return {};
  }

  static constexpr std::size_t kBlack = 2;
  ScreenSettings settings_;
  Clock& clock_;
  OpenFile card_;
  std::string name_;
  std::uint32_t connector_id_ = 0, crtc_ = 0;
  drmModeModeInfo mode_{};
  std::array<DumbBuffer, 3> buffers_{};
  std::size_t hidden_ = 0;
  bool is_set_ = false;
  std::array<bool, 16> done_{};
  std::size_t flips_ = 0;
};

}  // namespace

Result<void> blacken_kms(int shared_file, const BlackMeans& means) {
  drmModeModeInfo mode{};
  std::memcpy(&mode, means.mode, sizeof mode);
  std::uint32_t connector = means.connector;
  if (drmModeSetCrtc(shared_file, means.crtc, means.buffer, 0, 0, &connector, 1, &mode) != 0)
    return failed("it does not become black");
  const Crtc now{drmModeGetCrtc(shared_file, means.crtc)};
  if (!now || now->buffer_id != means.buffer || now->mode_valid == 0 || now->mode.hdisplay != mode.hdisplay ||
      now->mode.vdisplay != mode.vdisplay)
    return fail(ErrorCode::DeviceRefused, "screen: it keeps another mode or frame than it was given");
  return {};
}

Result<std::unique_ptr<Scanout>> open_kms(const ScreenSettings& settings, Clock& clock) {
  auto scanout = std::make_unique<KmsScanout>(settings, clock);
  if (const auto ok = scanout->open(); !ok) return tl::unexpected{ok.error()};
  return scanout;
}

std::string describe_screens() { return "connectors:" + all_of(find_connectors()) + "\n"; }

}  // namespace telefab::fab
