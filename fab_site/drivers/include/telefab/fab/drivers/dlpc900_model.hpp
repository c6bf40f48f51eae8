// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <optional>
#include <telefab/base/clock.hpp>
#include <telefab/fab/device/machine_log.hpp>
#include <telefab/fab/device/projector.hpp>
#include <telefab/fab/drivers/dlpc900_protocol.hpp>
#include <vector>

namespace telefab::fab {

/// What a device model answers to one USB transfer.
enum class UsbOutcome : std::uint8_t { Ok, Nak, Stall, Error, Gone };

/// Ways a DLPC900 and its cable can fail. Each strikes at the n-th OUT transfer after it was planned.
enum class ProjectorFault : std::uint8_t {
  Stall,           ///< the endpoint halts until clear_halt
  ErrorOnce,       ///< one broken transfer
  ErrorForEver,    ///< every transfer breaks until the device is reopened
  Nak,             ///< takes nothing for two seconds
  ShortReply,      ///< the next reply lacks its end
  ForeignReply,    ///< the next reply carries another sequence number
  ErrorBit,        ///< the command is refused with error 2
  LostReply,       ///< carried out, but the reply never comes
  Unplug,          ///< gone until reopened; a running exposure ends by itself
  Reset,           ///< the controller restarts: dark, mode and images lost
  SequencerAbort,  ///< the sequence ends and the abort bit stays until a reset
  ParkedStuck,     ///< the parked bit comes on and stays
  LedStuck,        ///< the LEDs stay enabled whatever is sent, until a reset
  SlowBus,         ///< a quarter of the speed from now on
};
inline constexpr std::size_t kProjectorFaults = 14;
[[nodiscard]] std::string_view name_of(ProjectorFault fault);

/// How the board around the controller drives its LEDs.
struct LedBoard {
  bool inverted_pwm = false;        ///< more current is more light under polarity 1 only
  bool enable_reaches_leds = true;  ///< false: the LEDs glow at their current whatever the enable lines say
  bool forgets_current = false;     ///< a broken one: keeps its currents whatever is sent
};

/// A DLPC900 with its mirrors, as bytes on its endpoints: refuses what the real one refuses, decodes what it is sent
/// and adds up the light each mirror gave. Knows nothing of who carries the bytes. Threads: one caller at a time.
class Dlpc900Model {
 public:
  /// The clock and the log must outlive the model; the log may be null.
  Dlpc900Model(std::uint8_t dmd_type, std::uint8_t firmware_major, const Clock& clock, MachineLog* log,
               LedBoard board = {});

  // ---- the bus ----
  [[nodiscard]] UsbOutcome out(std::uint8_t endpoint, std::span<const std::byte> bytes);
  /// Ok fills `reply`; Nak: nothing to say yet.
  [[nodiscard]] UsbOutcome in(std::uint8_t endpoint, std::vector<std::byte>& reply);
  void clear_halt(std::uint8_t endpoint);
  /// Closed and opened again by the host; plugs an unplugged one back in.
  void reopened();
  /// Milliseconds a 64-byte report takes on the bus.
  [[nodiscard]] std::uint32_t ms_per_report() const { return slow_ ? 4 : 1; }
  [[nodiscard]] bool present() const { return !gone_; }

  // ---- the recorder ----
  /// Lets time pass: ends what is over by now.
  void tick();
  [[nodiscard]] bool lit() const { return running_ && glow() > 0; }
  /// Writes down into that log when its mirrors showed what, whatever its LEDs did; it must outlive the model.
  void record_shows(MachineLog& log) { shows_ = &log; }
  /// The brightest LED as share of 255, whatever the mirrors do.
  [[nodiscard]] std::uint8_t glow() const;
  /// Adding up costs a pass over all mirrors an exposure; on unless switched off.
  void add_up_dose(bool wanted) { add_up_ = wanted; }
  /// Seconds of full light per mirror so far, row-major.
  [[nodiscard]] std::vector<float> dose_s();
  /// A fresh part begins: dose_s() counts from zero.
  void forget_dose() { dose_s_.clear(); }
  [[nodiscard]] PixelSize mirrors() const { return dmd_.size; }
  /// Orders that would have shown a pattern for ever; must stay zero.
  [[nodiscard]] std::uint32_t endless_orders() const { return endless_; }
  [[nodiscard]] std::uint64_t transfers() const { return transfers_; }
  [[nodiscard]] std::uint32_t refusals() const { return refusals_; }
  /// The last mask it decoded, both halves.
  [[nodiscard]] const Mask& image() const { return image_; }

  // ---- injected faults ----
  void plan_fault(ProjectorFault fault, std::uint64_t transfers_from_now);
  /// A LedStuck, ParkedStuck or SequencerAbort is repaired by a restart.
  void power_cycle();

 private:
  [[nodiscard]] UsbOutcome strike(ProjectorFault fault);
  void execute();
  [[nodiscard]] std::uint8_t carry_out(dlpc900::Command command, bool read, std::span<const std::byte> data,
                                       std::vector<std::byte>& answer);
  [[nodiscard]] std::uint8_t begin_image(std::size_t half, std::span<const std::byte> data);
  [[nodiscard]] std::uint8_t take_block(std::size_t half, std::span<const std::byte> data);
  [[nodiscard]] std::uint8_t start();
  void reset();
  void end_light(Nanoseconds at);
  void end_run(Nanoseconds at);
  /// Changes what the LEDs do, and keeps the account of light.
  template <class Change>
  void change_leds(Change change);

  dlpc900::DmdFacts dmd_;
  std::uint8_t major_;
  const Clock& clock_;
  MachineLog* log_;
  LedBoard board_;

  std::vector<std::byte> command_;  ///< bytes of the command coming in
  std::optional<std::vector<std::byte>> reply_;
  std::optional<std::pair<ProjectorFault, std::uint64_t>> fault_;
  std::uint64_t transfers_ = 0;
  std::uint32_t refusals_ = 0;
  std::uint32_t endless_ = 0;
  bool halted_ = false, broken_ = false, gone_ = false, slow_ = false;
  bool parked_stuck_ = false, led_stuck_ = false, error_bit_ = false;
  std::optional<ProjectorFault> spoil_reply_;
  Nanoseconds deaf_until_{};

  std::uint8_t mode_ = 0, leds_ = 0x07, last_error_ = 0, hardware_ = 0, polarity_ = 0;
  bool parked_ = false, running_ = false, definition_ = false, configured_ = false, configured_since_image_ = false;
  std::vector<std::byte> current_ = {std::byte{0x97}, std::byte{0x78}, std::byte{0x7D}};
  std::uint32_t exposure_us_ = 0;
  std::vector<std::byte> upload_[2];
  std::size_t expected_[2] = {0, 0};
  std::optional<Mask> half_[2];
  Mask image_;
  Nanoseconds run_from_{}, run_until_{}, lit_from_{};
  std::vector<float> dose_s_;
  bool add_up_ = true;
  MachineLog* shows_ = nullptr;
};

}  // namespace telefab::fab
