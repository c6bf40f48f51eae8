// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/fab/drivers/dlpc900_model.hpp>
#include <telefab/fab/drivers/line_model.hpp>
#include <telefab/fab/usb/line_transport.hpp>
#include <telefab/fab/usb/usb_transport.hpp>

namespace telefab::fab {

/// A model as a USB interface in this process. Transfers take the time they take on a full-speed bus: one report a
/// millisecond of the clock. The model and the clock must outlive it.
class ModelUsb final : public UsbTransport {
 public:
  ModelUsb(Dlpc900Model& model, Clock& clock) : model_{model}, clock_{clock} {}
  [[nodiscard]] Result<void> write(std::uint8_t endpoint, std::span<const std::byte> bytes,
                                   Milliseconds timeout) override;
  [[nodiscard]] Result<std::vector<std::byte>> read(std::uint8_t endpoint, std::size_t max_bytes,
                                                    Milliseconds timeout) override;
  [[nodiscard]] Result<void> clear_halt(std::uint8_t endpoint) override;
  [[nodiscard]] Result<void> reopen() override;
  [[nodiscard]] std::string describe() const override { return "DLPC900 model in this process\n"; }

 private:
  Dlpc900Model& model_;
  Clock& clock_;
};

/// A model as a serial line in this process. The model and the clock must outlive it.
class ModelLine final : public LineTransport {
 public:
  ModelLine(LineModel& model, Clock& clock) : model_{model}, clock_{clock} {}
  [[nodiscard]] Result<void> write(std::string_view bytes, Milliseconds timeout) override;
  [[nodiscard]] Result<std::optional<std::string>> read_line(Milliseconds timeout) override;
  [[nodiscard]] Result<void> reopen() override;
  [[nodiscard]] std::string describe() const override { return "board model in this process\n"; }

 private:
  LineModel& model_;
  Clock& clock_;
  std::string buffer_;
};

}  // namespace telefab::fab
