// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <libusb.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <telefab/base/clock.hpp>
#include <telefab/fab/usb/libusb_transport.hpp>
#include <vector>

namespace telefab::fab {

namespace {

constexpr int kInterface = 0;
constexpr Nanoseconds kArrivalWait = std::chrono::milliseconds{200};
constexpr Nanoseconds kPollEvery = std::chrono::milliseconds{20};

struct FreeUsb {
  void operator()(libusb_context* p) const { libusb_exit(p); }
  void operator()(libusb_device_handle* p) const {
    libusb_release_interface(p, kInterface);
    libusb_close(p);
  }
  void operator()(libusb_transfer* p) const { libusb_free_transfer(p); }
};
using Context = std::unique_ptr<libusb_context, FreeUsb>;
using Handle = std::unique_ptr<libusb_device_handle, FreeUsb>;
using Transfer = std::unique_ptr<libusb_transfer, FreeUsb>;

/// libusb's codes end here.
Error error_of(int code, std::string_view operation) {
  const auto error = [&](ErrorCode e) {
    return Error{e, fmt::format("USB, {}: {}", operation, libusb_strerror(static_cast<libusb_error>(code)))};
  };
  switch (code) {
    case LIBUSB_ERROR_TIMEOUT:
      return error(ErrorCode::DeviceTimeout);
    case LIBUSB_ERROR_PIPE:
      return error(ErrorCode::DeviceRefused);
    case LIBUSB_ERROR_ACCESS:
      return {ErrorCode::DeviceLost,
              fmt::format("USB, {}: no permission; install deploy/udev/70-telefab.rules and replug", operation)};
    case LIBUSB_ERROR_BUSY:
      return {ErrorCode::DeviceLost, fmt::format("USB, {}: another program holds the device", operation)};
    case LIBUSB_ERROR_NO_MEM:
      return error(ErrorCode::Internal);
    default:
      return error(ErrorCode::DeviceLost);
  }
}

int error_of_status(libusb_transfer_status status) {
  switch (status) {
    case LIBUSB_TRANSFER_COMPLETED:
      return LIBUSB_SUCCESS;
    case LIBUSB_TRANSFER_STALL:
      return LIBUSB_ERROR_PIPE;
    case LIBUSB_TRANSFER_CANCELLED:
    case LIBUSB_TRANSFER_TIMED_OUT:
      return LIBUSB_ERROR_TIMEOUT;
    case LIBUSB_TRANSFER_NO_DEVICE:
      return LIBUSB_ERROR_NO_DEVICE;
    case LIBUSB_TRANSFER_OVERFLOW:
      return LIBUSB_ERROR_OVERFLOW;
    case LIBUSB_TRANSFER_ERROR:
      break;
  }
  return LIBUSB_ERROR_IO;
}

std::string text_of(libusb_device_handle* handle, std::uint8_t index) {
  std::array<unsigned char, 128> text{};
  if (index == 0) return {};
  const int n = libusb_get_string_descriptor_ascii(handle, index, text.data(), static_cast<int>(text.size()));
  return n > 0 ? std::string{text.begin(), text.begin() + n} : std::string{};
}

class LibusbTransport final : public UsbTransport {
 public:
  LibusbTransport(Context context, UsbIdentity identity, UsbArrival arrival)
      : context_{std::move(context)}, identity_{std::move(identity)} {
    if (arrival == UsbArrival::Callback && libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) != 0)
      has_hotplug_ = libusb_hotplug_register_callback(
                         context_.get(), LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT,
                         LIBUSB_HOTPLUG_NO_FLAGS, identity_.vendor, identity_.product, LIBUSB_HOTPLUG_MATCH_ANY,
                         &LibusbTransport::plugged, this, &callback_) == LIBUSB_SUCCESS;
  }
  ~LibusbTransport() override {
    if (has_hotplug_) libusb_hotplug_deregister_callback(context_.get(), callback_);
  }

  Result<void> write(std::uint8_t endpoint, std::span<const std::byte> bytes, Milliseconds timeout) override {
    buffer_.assign(bytes.begin(), bytes.end());
    const auto sent = transfer(endpoint, timeout, "writing");
    if (!sent) return tl::unexpected{sent.error()};
    if (*sent != bytes.size()) return fail(ErrorCode::DeviceLost, "USB, writing: the device took only a part");
    return {};
  }

  Result<std::vector<std::byte>> read(std::uint8_t endpoint, std::size_t max_bytes, Milliseconds timeout) override {
    buffer_.assign(max_bytes, std::byte{});
    const auto got = transfer(endpoint, timeout, "reading");
    if (!got) return tl::unexpected{got.error()};
    return std::vector<std::byte>{buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(*got)};
  }

  Result<void> clear_halt(std::uint8_t endpoint) override {
    if (!handle_) return fail(ErrorCode::DeviceLost, "USB: the device is not open");
    if (const int code = libusb_clear_halt(handle_.get(), endpoint); code != 0)
      return tl::unexpected{error_of(code, "clearing a halt")};
    return {};
  }

  Result<void> reopen() override {
    handle_.reset();
    has_left_ = false;
    const Nanoseconds until = clock_.now() + kArrivalWait;
    while (true) {
      poll_events(Nanoseconds{0});  // what was plugged and unplugged meanwhile
      has_arrived_ = 0;
      Result<void> opened = open_listed();
      const Nanoseconds left = until - clock_.now();
      if (opened || !is_absent_ || left <= Nanoseconds{0}) return opened;
      poll_events(has_hotplug_ ? left : std::min(left, kPollEvery));
    }
  }

  std::string describe() const override { return description_; }

 private:
  static int LIBUSB_CALL plugged(libusb_context*, libusb_device* device, libusb_hotplug_event event, void* self) {
    auto& transport = *static_cast<LibusbTransport*>(self);
    if (event == LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED)
      transport.has_arrived_ = 1;
    else if (transport.handle_ && libusb_get_device(transport.handle_.get()) == device)
      transport.has_left_ = true;
    return 0;
  }

  /// Lets libusb work for a time; until a device arrives where it tells of arrivals.
  void poll_events(Nanoseconds time) {
    timeval tv{0, static_cast<suseconds_t>(time.count() / 1000)};
    if (time.count() > 0 && !has_hotplug_) {
      // Without news to wait for, the wait must not end early.
      const Nanoseconds until = clock_.now() + time;
      while (clock_.now() < until) (void)libusb_handle_events_timeout_completed(context_.get(), &tv, nullptr);
      return;
    }
    (void)libusb_handle_events_timeout_completed(context_.get(), &tv, time.count() > 0 ? &has_arrived_ : nullptr);
  }

  Result<void> open_listed() {
    libusb_device** list = nullptr;
    const ssize_t n = libusb_get_device_list(context_.get(), &list);
    if (n < 0) return tl::unexpected{error_of(static_cast<int>(n), "listing devices")};
    Result<void> opened = open_from({list, static_cast<std::size_t>(n)});
    libusb_free_device_list(list, 1);
    return opened;
  }

  Result<void> open_from(std::span<libusb_device* const> devices) {
    std::vector<Handle> found;
    std::string serials;  // of those found
    int refused = 0;      // why one could not be opened that is there
    for (libusb_device* device : devices) {
      libusb_device_descriptor d{};
      if (libusb_get_device_descriptor(device, &d) != 0 || d.idVendor != identity_.vendor ||
          d.idProduct != identity_.product)
        continue;
      libusb_device_handle* raw = nullptr;
      if (const int code = libusb_open(device, &raw); code != 0) {
        if (code != LIBUSB_ERROR_NO_DEVICE) refused = code;
        continue;
      }
      Handle handle{raw};
      const std::string serial = text_of(raw, d.iSerialNumber);
      if (!identity_.serial.empty() && serial != identity_.serial) continue;
      describe_device(raw, d, serial);
      serials += fmt::format("{}{}", serials.empty() ? "" : ", ", serial.empty() ? "none" : serial);
      found.push_back(std::move(handle));
    }
    const std::string name = fmt::format("{:04x}:{:04x}", identity_.vendor, identity_.product);
    is_absent_ = found.empty() && refused == 0;
    // Without a serial the one that cannot be opened may as well be the one that is meant.
    if (refused != 0 && (found.empty() || identity_.serial.empty()))
      return tl::unexpected{error_of(refused, "opening " + name)};
    if (found.empty())
      return fail(ErrorCode::DeviceLost,
                  fmt::format("no USB device {}{}; look at its cable and power", name,
                              identity_.serial.empty() ? "" : " with serial " + identity_.serial));
    if (found.size() > 1)
      return fail(ErrorCode::DeviceLost,
                  fmt::format("{} USB devices {} (serial numbers: {}): {}", found.size(), name, serials,
                              identity_.serial.empty() ? "name the one to use in devices.projector_serial"
                                                       : "they cannot be told apart; leave one connected"));
    (void)libusb_set_auto_detach_kernel_driver(found[0].get(), 1);
    if (const int code = libusb_claim_interface(found[0].get(), kInterface); code != 0)
      return tl::unexpected{error_of(code, "claiming " + name)};
    handle_ = std::move(found[0]);
    return {};
  }

  void describe_device(libusb_device_handle* handle, const libusb_device_descriptor& d, const std::string& serial) {
    libusb_device* device = libusb_get_device(handle);
    description_ =
        fmt::format("USB {:04x}:{:04x} bus {} address {}, {} {}, serial {}\n", d.idVendor, d.idProduct,
                    libusb_get_bus_number(device), libusb_get_device_address(device), text_of(handle, d.iManufacturer),
                    text_of(handle, d.iProduct), serial.empty() ? "none" : serial);
    libusb_config_descriptor* config = nullptr;
    if (libusb_get_active_config_descriptor(device, &config) != 0) return;
    for (int i = 0; i < config->bNumInterfaces; ++i)
      for (int a = 0; a < config->interface[i].num_altsetting; ++a) {
        const libusb_interface_descriptor& f = config->interface[i].altsetting[a];
        description_ += fmt::format("  interface {} class {:02x}\n", f.bInterfaceNumber, f.bInterfaceClass);
        for (int e = 0; e < f.bNumEndpoints; ++e)
          description_ += fmt::format("    endpoint {:02x} attributes {:02x}, {} bytes, interval {}\n",
                                      f.endpoint[e].bEndpointAddress, f.endpoint[e].bmAttributes,
                                      f.endpoint[e].wMaxPacketSize, f.endpoint[e].bInterval);
      }
    libusb_free_config_descriptor(config);
  }

  static void LIBUSB_CALL done(libusb_transfer* t) { *static_cast<int*>(t->user_data) = 1; }

  /// The buffer's bytes over one interrupt transfer; the number that went.
  Result<std::size_t> transfer(std::uint8_t endpoint, Milliseconds timeout, std::string_view operation) {
    if (!handle_) return fail(ErrorCode::DeviceLost, fmt::format("USB, {}: the device is not open", operation));
    if (has_left_) return fail(ErrorCode::DeviceLost, fmt::format("USB, {}: the device was unplugged", operation));
    const Transfer t{libusb_alloc_transfer(0)};
    if (!t) return fail(ErrorCode::Internal, "USB: out of memory");
    int completed = 0;
    libusb_fill_interrupt_transfer(t.get(), handle_.get(), endpoint, reinterpret_cast<unsigned char*>(buffer_.data()),
                                   static_cast<int>(buffer_.size()), &LibusbTransport::done, &completed,
                                   static_cast<unsigned>(std::max<Milliseconds::rep>(timeout.count(), 1)));
    if (const int code = libusb_submit_transfer(t.get()); code != 0) return tl::unexpected{error_of(code, operation)};
    while (completed == 0) {
      timeval slice{1, 0};
      const int code = libusb_handle_events_timeout_completed(context_.get(), &slice, &completed);
      if (code != 0 && code != LIBUSB_ERROR_INTERRUPTED && completed == 0) (void)libusb_cancel_transfer(t.get());
    }
    if (const int code = error_of_status(t->status); code != 0) return tl::unexpected{error_of(code, operation)};
    return static_cast<std::size_t>(t->actual_length);
  }

  SystemClock clock_;  ///< libusb waits in real time, whatever time the print runs in
  Context context_;
  UsbIdentity identity_;
  Handle handle_;
  libusb_hotplug_callback_handle callback_ = 0;
  bool has_hotplug_ = false;  ///< of arrivals and departures
  bool has_left_ = false;     ///< the open device; libusb said so
  int has_arrived_ = 0;       ///< a device like it, since the list was last looked at
  bool is_absent_ = false;    ///< none was in the list
  std::string description_;
  std::vector<std::byte> buffer_;
};

}  // namespace

Result<std::unique_ptr<UsbTransport>> open_libusb(const UsbIdentity& identity, UsbArrival arrival) {
  libusb_context* raw = nullptr;
  if (const int code = libusb_init(&raw); code != 0) return tl::unexpected{error_of(code, "starting libusb")};
  auto transport = std::make_unique<LibusbTransport>(Context{raw}, identity, arrival);
  if (const auto ok = transport->reopen(); !ok) return tl::unexpected{ok.error()};
  return transport;
}

}  // namespace telefab::fab
