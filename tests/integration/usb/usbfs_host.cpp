// SPDX-License-Identifier: GPL-3.0-or-later
#include "usbfs_host.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/usbdevice_fs.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <umockdev.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <list>
#include <vector>

namespace telefab::test {

using fab::UsbOutcome;

namespace {

// Device, configuration, one HID interface, two interrupt endpoints of 64 bytes a millisecond.
constexpr const char* kDescriptors =
    "12010002000000405104 00c9 0001 010203 01"
    "0902 2900 01 01 00 80 32"
    "0904 00 00 02 03 00 00 00"
    "0921 1101 00 01 22 2000"
    "0705 01 03 4000 01"
    "0705 81 03 4000 01";

std::string without_spaces(std::string text) {
  std::erase(text, ' ');
  return text;
}

std::vector<guint8> string_descriptor(std::string_view text) {
  std::vector<guint8> d{static_cast<guint8>(2 + 2 * text.size()), 3};
  for (const char c : text) d.insert(d.end(), {static_cast<guint8>(c), 0});
  return d;
}

}  // namespace

/// The bus that the nodes of one process are on, and the thread that answers for them.
struct UsbfsHost::Bus {
  GMainContext* context = g_main_context_new();
  GMainLoop* loop = g_main_loop_new(context, FALSE);
  UMockdevTestbed* testbed = umockdev_testbed_new();
  int devices = 0;
  std::thread thread;

  Bus() = default;
  ~Bus() {
    stop();
    g_object_unref(testbed);
    g_main_loop_unref(loop);
    g_main_context_unref(context);
  }
  Bus(const Bus&) = delete;
  Bus& operator=(const Bus&) = delete;
  void run() {
    thread = std::thread{[this] {
      g_main_context_push_thread_default(context);
      g_main_loop_run(loop);
      g_main_context_pop_thread_default(context);
    }};
  }
  void stop() {
    if (!thread.joinable()) return;
    while (g_main_loop_is_running(loop) == FALSE) std::this_thread::yield();  // else it would begin after its end
    g_main_loop_quit(loop);
    thread.join();
  }
};

struct UsbfsHost::State {
  struct Urb {
    UMockdevIoctlClient* owner;
    UMockdevIoctlData* data;
    UMockdevIoctlData* buffer;
    bool done;
    bool gone = false;  ///< its owner is
  };

  fab::Dlpc900Model& model;
  std::mutex& mutex;
  std::string serial;
  std::shared_ptr<Bus> bus;
  int number = ++bus->devices;  ///< of the port it sits in
  std::string sys_path = fmt::format("/sys/devices/pci0000:00/0000:00:14.0/usb1/1-{}", number);
  std::string node = fmt::format("/dev/bus/usb/001/{:03}", number + 1);
  UMockdevIoctlBase* handler = umockdev_ioctl_base_new();
  GSource* timer = nullptr;
  std::recursive_mutex own;  ///< answering a dead client tells of its end within the answer
  std::list<Urb> urbs;
  int answering = 0;
  std::atomic<std::uint64_t> ioctls = 0;
  std::atomic<bool> plugged = false;
  int fifo = -1;
  bool signalled = true;

  State(fab::Dlpc900Model& m, std::mutex& x, std::string s, std::shared_ptr<Bus> b)
      : model{m}, mutex{x}, serial{std::move(s)}, bus{std::move(b)} {}

  static usbdevfs_urb& urb_of(UMockdevIoctlData* data) { return *reinterpret_cast<usbdevfs_urb*>(data->data); }

  void add_device() {
    const std::string description = fmt::format(
        "P: {}\nN: {}\nE: DEVNAME={}\n"
        "E: DEVTYPE=usb_device\nE: SUBSYSTEM=usb\nE: BUSNUM=001\nE: DEVNUM={:03}\nE: MAJOR=189\n"
        "E: MINOR={}\nA: busnum=1\\n\nA: devnum={}\\n\nA: speed=12\\n\nA: bConfigurationValue=1\\n\n"
        "A: idVendor=0451\\n\nA: idProduct=c900\\n\nH: descriptors={}\n",
        sys_path.substr(4), node.substr(5), node, number + 1, number, number + 1, without_spaces(kDescriptors));
    GError* error = nullptr;
    if (umockdev_testbed_add_from_string(bus->testbed, description.c_str(), &error) == FALSE) {
      std::fprintf(stderr, "umockdev: %s\n", error->message);
      std::abort();
    }
    if (umockdev_testbed_attach_ioctl(bus->testbed, node.c_str(), handler, &error) == FALSE) {
      std::fprintf(stderr, "umockdev: %s\n", error->message);
      std::abort();
    }
    make_fifo();
    plugged = true;
  }

  /// Where the node lies behind the emulation.
  [[nodiscard]] std::string file() const {
    gchar* root = umockdev_testbed_get_root_dir(bus->testbed);
    std::string path = std::string{root} + node;
    g_free(root);
    return path;
  }

  /// usbfs says "writable" when a URB can be reaped; a regular file always says so. A pipe kept full until a URB is
  /// done behaves as usbfs does.
  void make_fifo() {
    const std::string path = file();
    if (fifo >= 0) ::close(fifo);
    ::unlink(path.c_str());
    if (::mkfifo(path.c_str(), 0600) != 0) std::abort();
    fifo = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (fifo < 0) std::abort();
    (void)::fcntl(fifo, F_SETPIPE_SZ, 4096);
    signalled = true;
    signal(false);
  }

  void signal(bool reapable) {
    if (reapable == signalled) return;
    std::array<char, 4096> page{};
    if (reapable)
      while (::read(fifo, page.data(), page.size()) > 0) {
      }
    else
      while (::write(fifo, page.data(), page.size()) > 0) {
      }
    signalled = reapable;
  }

  void update_signal() {
    bool any = false;
    for (const Urb& u : urbs) any = any || (u.done && !u.gone);
    signal(any || !plugged);
  }

  static void finish(Urb& u, int status, int length) {
    urb_of(u.data).status = status;
    urb_of(u.data).actual_length = length;
    u.done = true;
  }

  void control(Urb& u) {
    guint8* b = u.buffer->data;
    const int want = b[6] | b[7] << 8;
    if (b[0] == 0x80 && b[1] == 6 && b[3] == 3) {
      static const std::array<std::string, 2> texts{"Texas Instruments", "DLPC900"};
      std::vector<guint8> d{4, 3, 9, 4};
      if (b[2] == 1 || b[2] == 2) d = string_descriptor(texts[b[2] - 1u]);
      if (b[2] == 3) d = string_descriptor(serial);
      const int n = std::min<int>(want, static_cast<int>(d.size()));
      umockdev_ioctl_data_update(u.buffer, 8, d.data(), n);
      return finish(u, 0, n);
    }
    finish(u, -EPIPE, 0);
  }

  /// Tries to complete an interrupt transfer; what the device does not answer stays in flight.
  void interrupt(Urb& u) {
    const std::lock_guard lock{mutex};
    const usbdevfs_urb& urb = urb_of(u.data);
    const bool in = (urb.endpoint & 0x80) != 0;
    std::vector<std::byte> reply;
    const auto* bytes = reinterpret_cast<const std::byte*>(u.buffer->data);
    const UsbOutcome outcome = in ? model.in(urb.endpoint, reply)
                                  : model.out(urb.endpoint, {bytes, static_cast<std::size_t>(urb.buffer_length)});
    switch (outcome) {
      case UsbOutcome::Ok:
        if (in) {
          const int n = std::min<int>(urb.buffer_length, static_cast<int>(reply.size()));
          umockdev_ioctl_data_update(u.buffer, 0, reinterpret_cast<guint8*>(reply.data()), n);
          return finish(u, 0, n);
        }
        return finish(u, 0, urb.buffer_length);
      case UsbOutcome::Nak:
        return;
      case UsbOutcome::Stall:
        return finish(u, -EPIPE, 0);
      case UsbOutcome::Error:
        return finish(u, -EPROTO, 0);
      case UsbOutcome::Gone:
        return finish(u, -ENODEV, 0);
    }
  }

  /// umockdev tells of the end of a client from within any call that speaks to it: what was the client's is forgotten
  /// once nobody holds it any more.
  struct Answering {
    explicit Answering(State& s) : state{s} { ++state.answering; }
    ~Answering() {
      if (--state.answering == 0) state.forget_the_gone();
    }
    Answering(const Answering&) = delete;
    Answering& operator=(const Answering&) = delete;
    State& state;
  };

  void forget_the_gone() {
    std::erase_if(urbs, [](const Urb& u) {
      if (!u.gone) return false;
      g_object_unref(u.buffer);
      g_object_unref(u.data);
      return true;
    });
    update_signal();
  }

  bool handle(UMockdevIoctlClient* client) {
    const std::lock_guard one_at_a_time{own};  // umockdev answers each client from where it pleases
    const Answering until_the_end{*this};
    ++ioctls;
    const gulong request = umockdev_ioctl_client_get_request(client);
    UMockdevIoctlData* arg = umockdev_ioctl_client_get_arg(client);
    const auto complete = [&](glong result, int code = 0) {
      umockdev_ioctl_client_complete(client, result, code);
      return true;
    };
    if (!plugged && request != USBDEVFS_REAPURBNDELAY && request != USBDEVFS_DISCARDURB) return complete(-1, ENODEV);
    switch (request) {
      case USBDEVFS_GET_CAPABILITIES: {
        UMockdevIoctlData* d = umockdev_ioctl_data_resolve(arg, 0, sizeof(guint32), nullptr);
        if (d == nullptr) return complete(-1, EFAULT);  // it died in the middle of the call, here and below
        *reinterpret_cast<guint32*>(d->data) = USBDEVFS_CAP_BULK_CONTINUATION | USBDEVFS_CAP_NO_PACKET_SIZE_LIM;
        return complete(0);
      }
      case USBDEVFS_CLEAR_HALT: {
        const std::lock_guard lock{mutex};
        model.clear_halt(0);
        return complete(0);
      }
      case USBDEVFS_CLAIMINTERFACE: {
        const std::lock_guard lock{mutex};
        model.reopened();
        return complete(0);
      }
      case USBDEVFS_DISCONNECT_CLAIM: {
        const std::lock_guard lock{mutex};
        model.reopened();
        return complete(0);
      }
      case USBDEVFS_RELEASEINTERFACE:
      case USBDEVFS_SETCONFIGURATION:
      case FIONBIO:
        return complete(0);
      case USBDEVFS_GETDRIVER:
      case USBDEVFS_IOCTL:
        return complete(-1, ENODATA);
      case USBDEVFS_SUBMITURB: {
        UMockdevIoctlData* data = umockdev_ioctl_data_resolve(arg, 0, sizeof(usbdevfs_urb), nullptr);
        if (data == nullptr) return complete(-1, EFAULT);
        usbdevfs_urb& urb = urb_of(data);
        UMockdevIoctlData* buffer = umockdev_ioctl_data_resolve(data, G_STRUCT_OFFSET(usbdevfs_urb, buffer),
                                                                static_cast<gsize>(urb.buffer_length), nullptr);
        if (buffer == nullptr) return complete(-1, EFAULT);
        urbs.push_back(
            {client, UMOCKDEV_IOCTL_DATA(g_object_ref(data)), UMOCKDEV_IOCTL_DATA(g_object_ref(buffer)), false});
        Urb& u = urbs.back();
        if (urb.type == USBDEVFS_URB_TYPE_CONTROL)
          control(u);
        else
          interrupt(u);
        update_signal();
        return complete(0);
      }
      case USBDEVFS_REAPURBNDELAY: {
        for (auto u = urbs.begin(); u != urbs.end(); ++u) {
          if (!u->done || u->gone || u->owner != client) continue;
          UMockdevIoctlData* slot = umockdev_ioctl_data_resolve(arg, 0, sizeof(gpointer), nullptr);
          if (slot == nullptr) return complete(-1, EFAULT);
          (void)umockdev_ioctl_data_set_ptr(slot, 0, u->data);
          u->gone = true;
          update_signal();
          return complete(0);
        }
        return complete(-1, plugged ? EAGAIN : ENODEV);
      }
      case USBDEVFS_DISCARDURB: {
        for (Urb& u : urbs)
          if (!u.done && !u.gone && u.owner == client && *reinterpret_cast<gulong*>(arg->data) == u.data->client_addr) {
            finish(u, -ENOENT, 0);
            update_signal();
            return complete(0);
          }
        return complete(-1, EINVAL);
      }
      default:
        return complete(-1, ENOTTY);
    }
  }

  gboolean tick() {
    const std::lock_guard one_at_a_time{own};
    const Answering until_the_end{*this};
    for (Urb& u : urbs)
      if (!u.done && !plugged)
        finish(u, -ENODEV, 0);
      else if (!u.done && !u.gone && urb_of(u.data).type == USBDEVFS_URB_TYPE_INTERRUPT)
        interrupt(u);
    return TRUE;
  }

  /// A process closed the node or died: as usbfs does, its transfers end and nobody reaps them.
  void vanished(const UMockdevIoctlClient* client) {
    const std::lock_guard one_at_a_time{own};
    const Answering until_the_end{*this};
    for (Urb& u : urbs) u.gone = u.gone || u.owner == client;
  }

  static void on_vanished(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    static_cast<State*>(self)->vanished(client);
  }
  static gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    return static_cast<State*>(self)->handle(client) ? TRUE : FALSE;
  }
  static gboolean on_tick(gpointer self) { return static_cast<State*>(self)->tick(); }
};

UsbfsHost::UsbfsHost(fab::Dlpc900Model& model, std::mutex& mutex, std::string serial, const UsbfsHost* beside)
    : state_{std::make_unique<State>(model, mutex, std::move(serial),
                                     beside != nullptr ? beside->state_->bus : std::make_shared<Bus>())} {
  State& s = *state_;
  // A node is answered by the thread whose context it is attached in.
  s.bus->stop();
  g_main_context_push_thread_default(s.bus->context);
  g_signal_connect(s.handler, "handle-ioctl", G_CALLBACK(&State::on_ioctl), &s);
  g_signal_connect(s.handler, "client-vanished", G_CALLBACK(&State::on_vanished), &s);
  s.add_device();
  s.timer = g_timeout_source_new(1);
  g_source_set_callback(s.timer, &State::on_tick, &s, nullptr);
  g_source_attach(s.timer, s.bus->context);
  g_main_context_pop_thread_default(s.bus->context);
  s.bus->run();
}

UsbfsHost::~UsbfsHost() {
  State& s = *state_;
  s.bus->stop();
  g_source_destroy(s.timer);
  g_source_unref(s.timer);
  (void)umockdev_testbed_detach_ioctl(s.bus->testbed, s.node.c_str(), nullptr);
  g_signal_handlers_disconnect_by_data(s.handler, &s);
  g_object_unref(s.handler);
  s.bus.reset();  // a worker of the testbed's own speaks to the nodes until it is gone
  if (s.fifo >= 0) ::close(s.fifo);
}

void UsbfsHost::unplug() {
  state_->plugged = false;
  umockdev_testbed_uevent(state_->bus->testbed, state_->sys_path.c_str(), "remove");
}

void UsbfsHost::plug() {
  state_->plugged = true;
  umockdev_testbed_uevent(state_->bus->testbed, state_->sys_path.c_str(), "add");
}

void UsbfsHost::spoil_node() {
  const std::string path = state_->file();
  if (::unlink(path.c_str()) != 0 || ::mkdir(path.c_str(), 0700) != 0) std::abort();
}

std::uint64_t UsbfsHost::ioctls() const { return state_->ioctls; }

}  // namespace telefab::test
