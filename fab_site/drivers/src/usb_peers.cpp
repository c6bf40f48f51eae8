// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/drivers/usbip_session.hpp>

namespace telefab::fab {

namespace {

constexpr std::array<std::uint8_t, 18> kProjectorDevice{18,   1,    0x00, 0x02, 0,    0, 0, 64, 0x51,
                                                        0x04, 0x00, 0xC9, 0x00, 0x01, 1, 2, 3,  1};
constexpr std::array<std::uint8_t, 41> kProjectorConfiguration{
    9, 2,    41,   0,    1,  1, 0,    0x80, 50,  // configuration
    9, 4,    0,    0,    2,  3, 0,    0,    0,   // HID interface
    9, 0x21, 0x11, 0x01, 0,  1, 0x22, 32,   0,   // HID, report descriptor of 32 bytes
    7, 5,    0x01, 3,    64, 0, 1,    7,    5,  0x81, 3, 64, 0, 1};
// Vendor page, 64 bytes in, 64 bytes out, no report numbers.
constexpr std::array<std::uint8_t, 32> kReportDescriptor{
    0x06, 0x00, 0xFF, 0x09, 0x01, 0xA1, 0x01, 0x15, 0x00, 0x26, 0xFF, 0x00, 0x75, 0x08, 0x95, 0x40,
    0x09, 0x01, 0x81, 0x02, 0x95, 0x40, 0x09, 0x01, 0x91, 0x02, 0xC0, 0x00, 0x00, 0x00, 0x00, 0x00};
constexpr std::array<std::uint8_t, 18> kStageDevice{18,   1,    0x00, 0x02, 2,    0, 0, 64, 0x09,
                                                    0x12, 0x01, 0x00, 0x00, 0x01, 1, 2, 3,  1};
constexpr std::array<std::uint8_t, 67> kStageConfiguration{
    9, 2,    67,   0,    2,    1,    0,    0x80, 50,                                         // configuration
    9, 4,    0,    0,    1,    2,    2,    1,    0,                                          // communication interface
    5, 0x24, 0,    0x10, 0x01, 5,    0x24, 1,    0,  1,    4, 0x24, 2, 2, 5, 0x24, 6, 0, 1,  // CDC headers
    7, 5,    0x83, 3,    8,    0,    16,                                                     // notifications
    9, 4,    1,    0,    2,    0x0A, 0,    0,    0,                                          // data interface
    7, 5,    0x02, 2,    64,   0,    0,    7,    5,  0x82, 2, 64,   0, 0};
constexpr std::uint8_t kSetLineCoding = 0x20;
constexpr std::uint8_t kGetLineCoding = 0x21;
constexpr std::uint8_t kSetControlLineState = 0x22;
constexpr std::uint8_t kSendBreak = 0x23;

class ProjectorPeer final : public UsbPeer {
 public:
  ProjectorPeer(Dlpc900Model& model, std::string serial) : model_{model}, serial_{std::move(serial)} {}
  std::span<const std::uint8_t> device_descriptor() const override { return kProjectorDevice; }
  std::span<const std::uint8_t> configuration() const override { return kProjectorConfiguration; }
  std::string text(std::uint8_t index) const override {
    return index == 1 ? "Texas Instruments" : index == 2 ? "DLPC900" : index == 3 ? serial_ : "";
  }
  UsbOutcome class_request(std::span<const std::uint8_t, 8> setup, std::vector<std::byte>& data) override {
    if (setup[0] == 0x81 && setup[1] == 6 && setup[3] == 0x22) {  // the report descriptor, asked of the interface
      const auto bytes = std::as_bytes(std::span{kReportDescriptor});
      data.assign(bytes.begin(), bytes.end());
      return UsbOutcome::Ok;
    }
    return setup[0] == 0x21 && setup[1] == 0x0A ? UsbOutcome::Ok : UsbOutcome::Stall;  // idle rate
  }
  UsbOutcome out(std::uint8_t endpoint, std::span<const std::byte> bytes) override {
    return model_.out(endpoint, bytes);
  }
  UsbOutcome in(std::uint8_t endpoint, std::size_t, std::vector<std::byte>& bytes) override {
    return model_.in(endpoint, bytes);
  }
  void clear_halt(std::uint8_t endpoint) override { model_.clear_halt(endpoint); }
  void attached() override { model_.reopened(); }

 private:
  Dlpc900Model& model_;
  std::string serial_;
};

class StagePeer final : public UsbPeer {
 public:
  StagePeer(GrblModel& model, std::string serial) : model_{model}, serial_{std::move(serial)} {}
  std::span<const std::uint8_t> device_descriptor() const override { return kStageDevice; }
  std::span<const std::uint8_t> configuration() const override { return kStageConfiguration; }
  std::string text(std::uint8_t index) const override {
    return index == 1 ? "Telefab" : index == 2 ? "GRBL stage" : index == 3 ? serial_ : "";
  }
  UsbOutcome class_request(std::span<const std::uint8_t, 8> setup, std::vector<std::byte>& data) override {
    switch (setup[1]) {
      case kSetLineCoding:
        coding_ = data;
        return UsbOutcome::Ok;
      case kGetLineCoding:
        data = coding_;
        return UsbOutcome::Ok;
      case kSetControlLineState:
        if ((setup[2] & 1) != 0 && !ready_) model_.reopened();  // the terminal became ready: such boards restart
        ready_ = (setup[2] & 1) != 0;
        return UsbOutcome::Ok;
      case kSendBreak:
        return UsbOutcome::Ok;
      default:
        return UsbOutcome::Stall;
    }
  }
  UsbOutcome out(std::uint8_t, std::span<const std::byte> bytes) override {
    return model_.receive({reinterpret_cast<const char*>(bytes.data()), bytes.size()}) ? UsbOutcome::Ok
                                                                                       : UsbOutcome::Gone;
  }
  UsbOutcome in(std::uint8_t endpoint, std::size_t max_bytes, std::vector<std::byte>& bytes) override {
    if (endpoint == 0x83) return UsbOutcome::Nak;  // nothing to notify
    waiting_ += model_.transmit();
    if (waiting_.empty()) return UsbOutcome::Nak;
    const std::string part = waiting_.substr(0, max_bytes);
    waiting_.erase(0, part.size());
    const auto raw = std::as_bytes(std::span{part});
    bytes.assign(raw.begin(), raw.end());
    return UsbOutcome::Ok;
  }
  void clear_halt(std::uint8_t) override {}
  void attached() override {}

 private:
  GrblModel& model_;
  std::string serial_;
  std::string waiting_;
  bool ready_ = false;
  std::vector<std::byte> coding_ = std::vector<std::byte>(7);
};

}  // namespace

std::unique_ptr<UsbPeer> make_projector_peer(Dlpc900Model& model, std::string serial) {
  return std::make_unique<ProjectorPeer>(model, std::move(serial));
}

std::unique_ptr<UsbPeer> make_stage_peer(GrblModel& model, std::string serial) {
  return std::make_unique<StagePeer>(model, std::move(serial));
}

}  // namespace telefab::fab
