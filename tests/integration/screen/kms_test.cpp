// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <telefab/base/clock.hpp>
#include <telefab/fab/screen/packing.hpp>

#include "guest_pattern.hpp"

// The screen of a real kernel in an emulated computer: qemu shows what is scanned out, pixel by pixel.
namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;
namespace fs = std::filesystem;

/// A kernel and its modules: those of TELEFAB_QEMU_KERNEL, a folder into which a linux-image package was unpacked, or
/// those of this computer.
struct Kernel {
  fs::path image, modules;
};

std::optional<Kernel> find_kernel() {
  const char* unpacked = std::getenv("TELEFAB_QEMU_KERNEL");
  const fs::path root = unpacked != nullptr ? unpacked : "/";
  std::error_code error;
  for (const auto& entry : fs::directory_iterator{root / "boot", error}) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with("vmlinuz-") || ::access(entry.path().c_str(), R_OK) != 0) continue;
    const fs::path modules = root / "lib/modules" / name.substr(8) / "kernel";
    if (fs::exists(modules, error)) return Kernel{entry.path(), modules};
  }
  return std::nullopt;
}

bool has_program(const std::string& name) {
  return std::system(("command -v " + name + " >/dev/null 2>&1").c_str()) == 0;
}

struct Screen {
  const char* name;
  std::vector<std::string> modules;
  std::vector<std::string> devices;
  const char* connector;
  PixelSize words;
  PixelPacking packing;
};

/// qemu with the guest program in it; its serial line is ours.
class Machine {
 public:
  Machine(const Kernel& kernel, const Screen& screen) {
    char name[] = "/tmp/telefab-qemu-XXXXXX";
    folder_ = ::mkdtemp(name);
    make_initramfs(kernel, screen);
    start(kernel, screen);
  }
  ~Machine() {
    if (process_ > 0) {
      (void)::kill(process_, SIGKILL);
      (void)::waitpid(process_, nullptr, 0);
    }
    for (const int file : {serial_in_, serial_out_, qmp_})
      if (file >= 0) ::close(file);
    std::error_code error;
    fs::remove_all(folder_, error);
  }
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;

  /// The next line of the guest that begins with one of our words; empty after the time.
  std::string next(Nanoseconds patience) {
    const Nanoseconds until = clock_.now() + patience;
    while (clock_.now() < until) {
      if (const auto end = received_.find('\n'); end != std::string::npos) {
        std::string line = received_.substr(0, end);
        received_.erase(0, end + 1);
        while (!line.empty() && line.back() == '\r') line.pop_back();
        all_ += line + "\n";
        if (line.starts_with("STEP ") || line.starts_with("REPORT ") || line.starts_with("FAIL ")) return line;
        continue;
      }
      pollfd waited{serial_out_, POLLIN, 0};
      if (::poll(&waited, 1, 200) <= 0) continue;
      char chunk[4096];
      const ssize_t n = ::read(serial_out_, chunk, sizeof chunk);
      if (n <= 0) return {};
      received_.append(chunk, static_cast<std::size_t>(n));
    }
    return {};
  }
  void go_on() { EXPECT_EQ(::write(serial_in_, "\n", 1), 1); }
  [[nodiscard]] const std::string& all() const { return all_; }

  /// What the display shows: its size and three bytes a pixel.
  struct Picture {
    PixelSize size;
    std::vector<std::uint8_t> rgb;
  };
  Picture look() {
    const fs::path file = folder_ / "picture.ppm";
    ask(fmt::format(R"({{"execute":"screendump","arguments":{{"filename":"{}"}}}})", file.string()));
    std::ifstream in{file, std::ios::binary};
    std::string kind;
    int most = 0;
    Picture picture;
    in >> kind >> picture.size.width_px >> picture.size.height_px >> most;
    in.get();
    picture.rgb.resize(std::size_t{picture.size.width_px} * picture.size.height_px * 3);
    in.read(reinterpret_cast<char*>(picture.rgb.data()), static_cast<std::streamsize>(picture.rgb.size()));
    EXPECT_EQ(kind, "P6");
    EXPECT_TRUE(in.good());
    return picture;
  }

 private:
  void run(const std::string& command) { ASSERT_EQ(std::system(command.c_str()), 0) << command; }

  void make_initramfs(const Kernel& kernel, const Screen& screen) {
    const fs::path root = folder_ / "root";
    for (const char* folder : {"bin", "dev", "proc", "sys", "modules"}) fs::create_directories(root / folder);
    const fs::path guest = fs::read_symlink("/proc/self/exe").parent_path() / "screen_guest";
    fs::copy_file(guest, root / "bin/screen_guest");
    fs::copy_file("/bin/busybox", root / "bin/busybox");
    // Its libraries, at the places where it looks for them.
    run(
        fmt::format("ldd {} | grep -o '/[^ ]*' | sort -u | while read -r f; do mkdir -p {}/$(dirname $f) && cp -L $f "
                    "{}/$f; done",
                    guest.string(), root.string(), root.string()));
    std::string init =
        "#!/bin/busybox sh\nB=/bin/busybox\n$B mount -t devtmpfs none /dev\n$B mount -t proc none /proc\n"
        "$B mount -t sysfs none /sys\n";
    for (const std::string& module : screen.modules) {
      run(fmt::format("f=$(find {} -name '{}.ko*' | head -1) && cp $f {}/modules/", kernel.modules.string(), module,
                      root.string()));
      init += fmt::format("$B insmod /modules/{}.ko\n", module);
    }
    // What a console would show, were it to come back.
    init += fmt::format(
        "echo 'TEXT ON THE CONSOLE' > /dev/tty0\n/bin/screen_guest {} {} {} {} </dev/ttyS0 >/dev/ttyS0 2>&1\n"
        "$B poweroff -f\n",
        screen.connector, screen.words.width_px, screen.words.height_px, name_of(screen.packing));
    std::ofstream{root / "init"} << init;
    fs::permissions(root / "init", fs::perms::owner_all);
    run(fmt::format("cd {} && find . | cpio -o -H newc --quiet > {}/initramfs", root.string(), folder_.string()));
  }

  void start(const Kernel& kernel, const Screen& screen) {
    int in[2], out[2];
    ASSERT_EQ(::pipe2(in, O_CLOEXEC), 0);
    ASSERT_EQ(::pipe2(out, O_CLOEXEC), 0);
    const std::string socket = (folder_ / "qmp").string();
    std::vector<std::string> words{"qemu-system-x86_64",
                                   "-accel",
                                   "tcg",
                                   "-cpu",
                                   "max",
                                   "-m",
                                   "768",
                                   "-nodefaults",
                                   "-display",
                                   "none",
                                   "-vga",
                                   "none",
                                   "-serial",
                                   "stdio",
                                   "-no-reboot",
                                   "-qmp",
                                   "unix:" + socket + ",server=on,wait=off",
                                   "-kernel",
                                   kernel.image.string(),
                                   "-initrd",
                                   (folder_ / "initramfs").string(),
                                   "-append",
                                   "console=ttyS0 quiet panic=-1 vt.global_cursor_default=0"};
    words.insert(words.end(), screen.devices.begin(), screen.devices.end());
    process_ = ::fork();
    if (process_ == 0) {
      ::dup2(in[0], 0);
      ::dup2(out[1], 1);
      std::vector<char*> arguments;
      for (std::string& word : words) arguments.push_back(word.data());
      arguments.push_back(nullptr);
      ::execvp(arguments[0], arguments.data());
      ::_exit(127);
    }
    ::close(in[0]);
    ::close(out[1]);
    serial_in_ = in[1];
    serial_out_ = out[0];
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    socket.copy(address.sun_path, sizeof address.sun_path - 1);
    qmp_ = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    for (int i = 0; i < 500; ++i) {
      if (::connect(qmp_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) break;
      clock_.sleep_for(20ms);
    }
    answer();  // its first words
    ask(R"({"execute":"qmp_capabilities"})");
  }

  void ask(const std::string& question) {
    ASSERT_EQ(::write(qmp_, question.data(), question.size()), static_cast<ssize_t>(question.size()));
    answer();
  }
  void answer() {
    std::string text;
    for (const Nanoseconds until = clock_.now() + 20s; clock_.now() < until;) {
      pollfd waited{qmp_, POLLIN, 0};
      if (::poll(&waited, 1, 200) <= 0) continue;
      char chunk[4096];
      const ssize_t n = ::read(qmp_, chunk, sizeof chunk);
      if (n <= 0) break;
      text.append(chunk, static_cast<std::size_t>(n));
      if (text.find("\"return\"") != std::string::npos || text.find("\"QMP\"") != std::string::npos) return;
      if (text.find("\"error\"") != std::string::npos) break;
    }
    ADD_FAILURE() << "qemu answers: " << text;
  }

  SystemClock clock_;
  fs::path folder_;
  pid_t process_ = -1;
  int serial_in_ = -1, serial_out_ = -1, qmp_ = -1;
  std::string received_, all_;
};

/// The picture that the words of a frame are, as a display scans them out.
std::vector<std::uint8_t> expected(const Screen& screen, std::uint32_t pattern) {
  const PanelLayout layout{screen.words, screen.packing, {}, {}};
  const Mask mask = test::guest_pattern(panel_pixels(layout), pattern);
  std::vector<std::byte> frame(std::size_t{screen.words.width_px} * screen.words.height_px * 4);
  EXPECT_TRUE(pack_mask(mask.view(), layout, frame, std::size_t{screen.words.width_px} * 4));
  std::vector<std::uint8_t> rgb;
  for (std::size_t i = 0; i < frame.size(); i += 4)
    for (const std::size_t colour : {2u, 1u, 0u}) rgb.push_back(std::to_integer<std::uint8_t>(frame[i + colour]));
  return rgb;
}

std::size_t lit_bytes(const Machine::Picture& picture) {
  return static_cast<std::size_t>(std::count_if(picture.rgb.begin(), picture.rgb.end(), [](auto b) { return b != 0; }));
}

class KmsScreen : public testing::TestWithParam<Screen> {};

TEST_P(KmsScreen, ShowsMasksPixelByPixelAndIsBlackWhereItsProgramIsKilledOrHangs) {
  for (const char* program : {"qemu-system-x86_64", "cpio", "ldd"})
    if (!has_program(program)) GTEST_SKIP() << "skipped: no " << program << " here";
  if (!fs::exists("/bin/busybox")) GTEST_SKIP() << "skipped: no busybox-static here";
  const auto kernel = find_kernel();
  if (!kernel)
    GTEST_SKIP() << "skipped: no kernel here; set TELEFAB_QEMU_KERNEL to a folder with an unpacked linux-image package";
  const Screen& screen = GetParam();
  Machine machine{*kernel, screen};
  std::map<std::string, int> steps;
  bool is_over = false;
  while (!is_over) {
    const std::string line = machine.next(60s);
    ASSERT_FALSE(line.empty()) << "the guest is silent; it said:\n" << machine.all();
    ASSERT_FALSE(line.starts_with("FAIL ")) << line << "\n" << machine.all();
    is_over = line == "REPORT END";
    if (line.starts_with("REPORT ")) {
      fmt::print("{}\n", line.substr(line.find(' ') + 1));
      EXPECT_THAT(line, testing::Not(HasSubstr("ACCEPTED")));
      continue;
    }
    const std::string step = line.substr(5);
    ++steps[step];
    const auto picture = machine.look();
    machine.go_on();
    const bool shows = step.starts_with("pattern-") || step.starts_with("before-");
    if (!step.starts_with("after-")) {
      EXPECT_EQ(picture.size, screen.words) << step;
    }
    if (shows) {
      constexpr std::size_t kNumber = std::string_view{"pattern-"}.size();
      const std::uint32_t pattern = step.starts_with("before-") ? 1 : static_cast<std::uint32_t>(step[kNumber] - '0');
      EXPECT_TRUE(picture.rgb == expected(screen, pattern)) << step;
    } else {
      EXPECT_EQ(lit_bytes(picture), 0u) << step;
    }
  }
  EXPECT_EQ(steps.size(), screen.connector[0] == '/' ? 15u : 16u) << machine.all();
}

INSTANTIATE_TEST_SUITE_P(
    Emulated, KmsScreen,
    testing::Values(Screen{"bochs",
                           {"drm", "drm_kms_helper", "ttm", "drm_ttm_helper", "drm_vram_helper", "bochs"},
                           {"-device", "bochs-display,vgamem=64M"},
                           "Virtual-1",
                           {1280, 800},
                           PixelPacking::Grey},
                    Screen{"virtio",
                           {"virtio_ring", "virtio", "virtio_pci_modern_dev", "virtio_pci_legacy_dev", "virtio_pci",
                            "drm", "drm_kms_helper", "drm_shmem_helper", "virtio_dma_buf", "virtio-gpu"},
                           {"-device", "virtio-gpu-pci,xres=1920,yres=1080"},
                           "Virtual-1",
                           {1920, 1080},
                           PixelPacking::Bgr},
                    Screen{"bochs_framebuffer",
                           {"drm", "drm_kms_helper", "ttm", "drm_ttm_helper", "drm_vram_helper", "bochs"},
                           {"-device", "bochs-display,vgamem=64M"},
                           "/dev/fb0",
                           {1280, 800},
                           PixelPacking::Grey},
                    Screen{"virtio_large",
                           {"virtio_ring", "virtio", "virtio_pci_modern_dev", "virtio_pci_legacy_dev", "virtio_pci",
                            "drm", "drm_kms_helper", "drm_shmem_helper", "virtio_dma_buf", "virtio-gpu"},
                           {"-device", "virtio-gpu-pci,xres=2560,yres=4320,max_hostmem=512M"},
                           "Virtual-1",
                           {2560, 4320},
                           PixelPacking::Rgb}),
    [](const auto& p) { return std::string{p.param.name}; });

}  // namespace
}  // namespace telefab::fab
