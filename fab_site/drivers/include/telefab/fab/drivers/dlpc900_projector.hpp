// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <deque>
#include <memory>
#include <optional>
#include <telefab/fab/device/projector.hpp>
#include <telefab/fab/drivers/dlpc900_protocol.hpp>
#include <telefab/fab/usb/usb_transport.hpp>

namespace telefab::fab {

/// Commands and replies on one DLPC900, one in flight. Retries what may be repeated: halted endpoints are cleared,
/// a broken connection is opened again, lost and foreign replies are asked for again, three times at most.
class Dlpc900Link {
 public:
  explicit Dlpc900Link(std::unique_ptr<UsbTransport> usb) : usb_{std::move(usb)} {}

  [[nodiscard]] Result<std::vector<std::byte>> query(dlpc900::Command command, std::size_t at_least_bytes);
  [[nodiscard]] Result<std::uint8_t> query_byte(dlpc900::Command command);
  [[nodiscard]] Result<void> set(dlpc900::Command command, std::span<const std::byte> data);
  [[nodiscard]] Result<void> set_byte(dlpc900::Command command, std::uint8_t value);
  /// Once, without a retry: for what must not happen twice.
  [[nodiscard]] Result<void> set_once(dlpc900::Command command, std::span<const std::byte> data, Milliseconds timeout);
  /// Sends a ready frame that is not answered.
  [[nodiscard]] Result<void> send(std::span<const std::byte> frame);
  [[nodiscard]] Result<void> clear_halts();
  [[nodiscard]] Result<void> reopen();
  [[nodiscard]] std::string describe() const { return usb_->describe(); }
  /// Retries since the last call.
  [[nodiscard]] std::uint32_t take_retries();

 private:
  [[nodiscard]] Result<std::vector<std::byte>> once(std::uint8_t flags, dlpc900::Command command,
                                                    std::span<const std::byte> data, std::size_t at_least_bytes,
                                                    Milliseconds timeout);
  [[nodiscard]] Result<std::vector<std::byte>> patiently(std::uint8_t flags, dlpc900::Command command,
                                                         std::span<const std::byte> data, std::size_t at_least_bytes);
  std::unique_ptr<UsbTransport> usb_;
  std::uint8_t sequence_ = 0;
  std::uint32_t retries_ = 0;
};

/// What a DLPC900 says about itself; `telefab-fab probe` prints it.
struct Dlpc900Identity {
  dlpc900::DmdFacts dmd{};
  std::uint8_t major = 0, minor = 0;
  std::uint16_t patch = 0;
  std::uint8_t hardware_status = 0, system_status = 0, main_status = 0;
};

struct Dlpc900Options {
  PixelSize mask;  ///< centred on the mirrors, dark around; at most their number
  OpticsTurn orientation = OpticsTurn::Normal;
  MirrorControllers controllers = MirrorControllers::Auto;
  dlpc900::Led led = dlpc900::Led::Blue;
  std::uint8_t led_current = 0;        ///< 0..255; nothing above it is ever sent
  bool inverted_led_polarity = false;  ///< of the board, stated by its maker; never guessed
  /// The board's LEDs glow whatever their enable lines say: off is these lines and a current of zero.
  bool off_needs_zero_current = false;
};

/// The mask as the mirrors must show it: turned for the optics, centred, dark around. The mask fits.
[[nodiscard]] Mask place_on_mirrors(const MaskView& mask, PixelSize mirrors, OpticsTurn orientation);

/// A projector with a DLPC900 in on-the-fly pattern mode: each mask is uploaded while dark and shown once, for a time
/// the controller itself counts. LEDs are hard off except between expose() and its end.
class Dlpc900Projector final : public Projector {
 public:
  /// Goes dark, identifies, checks every status bit, sets mode, current and colour, measures the upload rate.
  /// Fails: DeviceLost, DeviceTimeout, DeviceRefused (self-test; says which bit), InvalidInput (mask too large).
  [[nodiscard]] static Result<std::unique_ptr<Dlpc900Projector>> open(std::unique_ptr<UsbTransport> usb,
                                                                      const Dlpc900Options& options, Clock& clock);
  ~Dlpc900Projector() override;

  [[nodiscard]] const ProjectorFacts& facts() const override { return facts_; }
  [[nodiscard]] Result<void> load(const MaskView& mask, const LightOrder& light) override;
  [[nodiscard]] Result<void> expose() override;
  [[nodiscard]] Result<ProjectorStatus> poll() override;
  [[nodiscard]] Result<void> dark() override;
  [[nodiscard]] Nanoseconds load_time(const MaskView& mask) const override;

  [[nodiscard]] const Dlpc900Identity& identity() const { return identity_; }
  [[nodiscard]] std::string describe() const { return link_.describe(); }

 private:
  Dlpc900Projector(std::unique_ptr<UsbTransport> usb, const Dlpc900Options& options, Clock& clock)
      : options_{options}, clock_{clock}, link_{std::move(usb)} {}
  [[nodiscard]] Result<void> leds_off();
  [[nodiscard]] Result<void> set_current(std::uint8_t current);
  [[nodiscard]] Result<void> identify();
  [[nodiscard]] Result<void> prepare();
  [[nodiscard]] Result<void> check_status();
  [[nodiscard]] Result<void> measure_rate();
  [[nodiscard]] std::vector<std::vector<std::byte>> frames_of(const Mask& mirrors, std::uint32_t exposure_us) const;
  [[nodiscard]] Result<void> pump();
  [[nodiscard]] Result<void> start_part();
  [[nodiscard]] Result<bool> part_is_over();
  [[nodiscard]] Result<void> rescue();

  Dlpc900Options options_;
  Clock& clock_;
  Dlpc900Link link_;
  Dlpc900Identity identity_;
  ProjectorFacts facts_;
  LightState state_ = LightState::Empty;
  std::vector<std::vector<std::byte>> frames_;  ///< of the mask being loaded
  std::size_t sent_ = 0;
  std::uint32_t restarts_ = 0;
  std::uint32_t part_us_ = 0;
  std::uint32_t parts_ = 1;
  std::uint32_t parts_left_ = 0;
  std::optional<std::uint8_t> current_;  ///< that the LEDs have; empty: not sure
  std::uint8_t wanted_current_ = 0;      ///< for the loaded mask
  Nanoseconds part_from_{};
  Nanoseconds lit_for_{};
  ExposureReport report_;
};

}  // namespace telefab::fab
