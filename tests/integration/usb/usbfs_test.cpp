// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <telefab/base/clock.hpp>
#include <telefab/fab/drivers/dlpc900_projector.hpp>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <telefab/fab/usb/libusb_transport.hpp>
#include <telefab/fab/usb/tty_line.hpp>
#include <telefab/test/print_rig.hpp>
#include <thread>

#include "usbfs_host.hpp"

// The drivers and the unmodified program on real libusb and a real tty, with the device models behind an emulated
// usbfs node and a pseudo terminal.

namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using test::PrintRig;
using test::PtyHost;
using test::UsbfsHost;

constexpr UsbIdentity kProjector{0x0451, 0xC900, {}};

bool emulation_is_preloaded() {
  const char* preload = std::getenv("LD_PRELOAD");
  return preload != nullptr && std::string_view{preload}.find("umockdev") != std::string_view::npos;
}

class Usbfs : public testing::Test {
 protected:
  void SetUp() override {
    if (!emulation_is_preloaded()) GTEST_SKIP() << "skipped: umockdev is not preloaded; run through ctest";
    model.add_up_dose(false);
    host = std::make_unique<UsbfsHost>(model, mutex, "T6500");
  }
  /// Shows one mask through libusb; the exposure must end by itself.
  Result<void> show_one(Dlpc900Projector& projector) {
    test::FormulaMasks masks{PrintRig::kSize};
    if (const auto ok = projector.load(masks.mask(LayerIndex{0})->view(), {60ms}); !ok) return ok;
    for (const Nanoseconds until = clock.now() + 10s; clock.now() < until;) {
      const auto status = projector.poll();
      if (!status) return tl::unexpected{status.error()};
      if (status->state == LightState::Loaded)
        if (const auto ok = projector.expose(); !ok) return ok;
      if (status->state == LightState::Exposed) return {};
      clock.sleep_for(5ms);
    }
    return fail(ErrorCode::DeviceTimeout, "never exposed");
  }

  SystemClock clock;
  MachineLog log;
  std::mutex mutex;
  Dlpc900Model model{1, 6, clock, &log};
  std::unique_ptr<UsbfsHost> host;
};

TEST_F(Usbfs, ShowsAMaskThroughUnmodifiedLibusb) {
  auto usb = open_libusb(kProjector);
  ASSERT_TRUE(usb) << usb.error().what;
  EXPECT_THAT((*usb)->describe(), testing::HasSubstr("DLPC900, serial T6500"));
  EXPECT_THAT((*usb)->describe(), testing::HasSubstr("endpoint 81 attributes 03, 64 bytes, interval 1"));
  auto projector = Dlpc900Projector::open(std::move(*usb), {.mask = PrintRig::kSize, .led_current = 10}, clock);
  ASSERT_TRUE(projector) << projector.error().what;
  const auto shown = show_one(**projector);
  ASSERT_TRUE(shown) << shown.error().what;
  const std::lock_guard lock{mutex};
  EXPECT_FALSE(model.lit());
  ASSERT_EQ(log.light().size(), 1u);
  EXPECT_EQ(model.refusals(), 0u);
}

TEST_F(Usbfs, TakesOnlyTheLightEngineOfTheStatedSerialNumber) {
  UsbIdentity wanted = kProjector;
  wanted.serial = "T6501";
  const auto other = open_libusb(wanted);
  ASSERT_FALSE(other);
  EXPECT_EQ(other.error().code, ErrorCode::DeviceLost);
  EXPECT_THAT(other.error().what, testing::HasSubstr("with serial T6501"));
  wanted.serial = "T6500";
  const auto own = open_libusb(wanted);
  ASSERT_TRUE(own) << own.error().what;
  EXPECT_THAT((*own)->describe(), testing::HasSubstr("serial T6500"));
}

TEST_F(Usbfs, TakesNoneOfTwoLightEnginesUnlessItIsNamed) {
  Dlpc900Model twin_model{1, 6, clock, &log};
  const UsbfsHost twin{twin_model, mutex, "T6501", host.get()};
  const auto either = open_libusb(kProjector);
  ASSERT_FALSE(either);
  EXPECT_EQ(either.error().code, ErrorCode::DeviceLost);
  EXPECT_THAT(either.error().what, testing::HasSubstr("2 USB devices 0451:c900 (serial numbers: "));
  for (const char* serial : {"T6500", "T6501"}) {
    EXPECT_THAT(either.error().what, testing::HasSubstr(serial));
    UsbIdentity wanted = kProjector;
    wanted.serial = serial;
    const auto own = open_libusb(wanted);
    ASSERT_TRUE(own) << own.error().what;
    EXPECT_THAT((*own)->describe(), testing::HasSubstr(std::string{"serial "} + serial));
  }
}

TEST_F(Usbfs, TakesNoneOfTwoLightEnginesOfOneSerialNumber) {
  Dlpc900Model twin_model{1, 6, clock, &log};
  const UsbfsHost twin{twin_model, mutex, "T6500", host.get()};
  UsbIdentity wanted = kProjector;
  wanted.serial = "T6500";
  const auto either = open_libusb(wanted);
  ASSERT_FALSE(either);
  EXPECT_THAT(either.error().what, testing::HasSubstr("they cannot be told apart"));
}

// The one that could be opened was taken for the only one.
TEST_F(Usbfs, TakesNoOtherLightEngineThanOneThatItMayNotOpenUnlessItIsNamed) {
  Dlpc900Model twin_model{1, 6, clock, &log};
  UsbfsHost twin{twin_model, mutex, "T6501", host.get()};
  twin.spoil_node();
  const auto either = open_libusb(kProjector);
  ASSERT_FALSE(either);
  EXPECT_THAT(either.error().what, testing::HasSubstr("opening 0451:c900"));
  UsbIdentity wanted = kProjector;
  wanted.serial = "T6500";
  EXPECT_TRUE(open_libusb(wanted));
}

TEST_F(Usbfs, TellsTimeoutStallAndUnplugApart) {
  auto usb = open_libusb(kProjector);
  ASSERT_TRUE(usb) << usb.error().what;
  const Nanoseconds from = clock.now();
  EXPECT_EQ((*usb)->read(dlpc900::kInEndpoint, 64, Milliseconds{50}).error().code, ErrorCode::DeviceTimeout);
  EXPECT_LT(clock.now() - from, 1s);
  const auto query = dlpc900::frame(dlpc900::kRead, 1, dlpc900::Command::MainStatus, {});
  {
    const std::lock_guard lock{mutex};
    model.plan_fault(ProjectorFault::Stall, 0);
  }
  EXPECT_EQ((*usb)->write(dlpc900::kOutEndpoint, query, Milliseconds{500}).error().code, ErrorCode::DeviceRefused);
  EXPECT_TRUE((*usb)->clear_halt(dlpc900::kOutEndpoint));
  EXPECT_TRUE((*usb)->write(dlpc900::kOutEndpoint, query, Milliseconds{500}));
  EXPECT_TRUE((*usb)->read(dlpc900::kInEndpoint, 64, Milliseconds{500}));
  host->unplug();
  EXPECT_EQ((*usb)->write(dlpc900::kOutEndpoint, query, Milliseconds{500}).error().code, ErrorCode::DeviceLost);
}

TEST_F(Usbfs, HearsOfADepartureAndOfAnArrivalItWaitsFor) {
  for (const UsbArrival how : {UsbArrival::Callback, UsbArrival::Poll}) {
    SCOPED_TRACE(static_cast<int>(how));
    auto usb = open_libusb(kProjector, how);
    ASSERT_TRUE(usb) << usb.error().what;
    host->unplug();
    const Nanoseconds from = clock.now();
    ASSERT_FALSE((*usb)->reopen());
    EXPECT_NEAR(double((clock.now() - from).count()) * 1e-9, 0.2, 0.15);
    std::jthread operator_hand{[&] {
      clock.sleep_for(60ms);
      host->plug();
    }};
    Result<void> back = (*usb)->reopen();
    for (int tries = 0; !back && tries < 10; ++tries) back = (*usb)->reopen();
    EXPECT_TRUE(back) << back.error().what;
  }
}

TEST_F(Usbfs, ComesBackAfterAHundredUnplugsWithoutLeakingADescriptor) {
  auto usb = open_libusb(kProjector);
  ASSERT_TRUE(usb) << usb.error().what;
  const auto descriptors = [] {
    return std::distance(std::filesystem::directory_iterator{"/proc/self/fd"}, std::filesystem::directory_iterator{});
  };
  const auto query = dlpc900::frame(dlpc900::kRead, 1, dlpc900::Command::MainStatus, {});
  std::ptrdiff_t before = 0;
  for (int i = 0; i < 100; ++i) {
    host->unplug();
    ASSERT_FALSE((*usb)->write(dlpc900::kOutEndpoint, query, Milliseconds{200}));
    host->plug();
    Result<void> back = (*usb)->reopen();
    for (int tries = 0; !back && tries < 100; ++tries) {
      clock.sleep_for(5ms);  // udev's news travel on another thread
      back = (*usb)->reopen();
    }
    ASSERT_TRUE(back) << i << ": " << back.error().what;
    ASSERT_TRUE((*usb)->write(dlpc900::kOutEndpoint, query, Milliseconds{500})) << i;
    ASSERT_TRUE((*usb)->read(dlpc900::kInEndpoint, 64, Milliseconds{500})) << i;
    if (i == 5) before = descriptors();
  }
  EXPECT_LE(descriptors(), before + 1);
}

TEST_F(Usbfs, WaitsForAReplyWithoutUsingTheProcessor) {
  auto usb = open_libusb(kProjector);
  ASSERT_TRUE(usb) << usb.error().what;
  const auto cpu_us = [] {
    rusage u{};
    ::getrusage(RUSAGE_THREAD, &u);
    return u.ru_utime.tv_usec + u.ru_stime.tv_usec + 1000000 * (u.ru_utime.tv_sec + u.ru_stime.tv_sec);
  };
  const auto from = cpu_us();
  EXPECT_FALSE((*usb)->read(dlpc900::kInEndpoint, 64, Milliseconds{500}));
  EXPECT_LT(cpu_us() - from, 5000) << "more than 1 % of half a second";
}

TEST_F(Usbfs, IsProbedByTheUnmodifiedProgram) {
  GrblModel board{25, clock, &log};
  PtyHost pty{board, mutex};
  const char* bin = std::getenv("TELEFAB_BIN");
  const char* source = std::getenv("TELEFAB_SOURCE");
  ASSERT_TRUE(bin != nullptr && source != nullptr);
  const auto folder = std::filesystem::temp_directory_path() / fmt::format("telefab-usb-{}", ::getpid());
  std::filesystem::create_directories(folder);
  std::ifstream profile{std::filesystem::path{source} / "deploy/config/machines/dlp6500.toml"};
  std::ofstream{folder / "real.toml"}
      << std::string{std::istreambuf_iterator<char>{profile}, {}}
      << "\n[devices]\nprojector = \"dlpc900\"\nstage = \"grbl\"\nled_current = "
         "20\nled_polarity = \"normal\"\nprojector_serial = \"T6500\"\nstage_serial = \""
      << pty.path() << "\"\n";
  const std::string command =
      fmt::format("{}/telefab-fab probe --machine dlp6500 --machines {} 2>&1", bin, folder.string());
  std::string text;
  const auto run = [&] {
    text.clear();
    std::FILE* out = ::popen(command.c_str(), "r");
    if (out == nullptr) return -1;
    std::array<char, 512> chunk{};
    while (const std::size_t n = std::fread(chunk.data(), 1, chunk.size(), out)) text.append(chunk.data(), n);
    return ::pclose(out);
  };
  const int status = run();
  EXPECT_EQ(WEXITSTATUS(status), 0) << text;
  EXPECT_THAT(text, testing::HasSubstr("DLPC900 DLP6500 firmware 6.0.0"));
  EXPECT_THAT(text, testing::HasSubstr("self-test passed"));
  EXPECT_THAT(text, testing::HasSubstr("GRBL stage"));
  // Another light engine than the one that is there is not taken for it.
  {
    std::ifstream in{folder / "real.toml"};
    std::string other{std::istreambuf_iterator<char>{in}, {}};
    other.replace(other.find("\"T6500\""), 7, "\"T9999\"");
    std::ofstream{folder / "real.toml"} << other;
  }
  EXPECT_NE(WEXITSTATUS(run()), 0) << text;
  EXPECT_THAT(text, testing::HasSubstr("with serial T9999"));
  std::filesystem::remove_all(folder);
  const std::lock_guard lock{mutex};
  EXPECT_TRUE(log.light().empty()) << "a probe must not light anything";
}

}  // namespace
}  // namespace telefab::fab
