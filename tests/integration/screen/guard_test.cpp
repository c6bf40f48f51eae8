// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <telefab/fab/drivers/make_devices.hpp>
#include <telefab/fab/screen/guarded_display.hpp>
#include <telefab/fab/screen/packing.hpp>
#include <telefab/fab/screen/screen_projector.hpp>

// A plain file in the place of a framebuffer, and the guard as the program telefab-fab starts it: what the file holds
// is what the vat would see.
namespace telefab::fab {
namespace {

using namespace std::chrono_literals;
using testing::HasSubstr;

constexpr PixelSize kWords{64, 40};
constexpr std::size_t kBytes = 64 * 40 * 4;
constexpr Nanoseconds kDarkWithin = 250ms;

GuardProgram guard_program() {
  const char* bin = std::getenv("TELEFAB_BIN");
  return {std::string{bin != nullptr ? bin : ""} + "/telefab-fab", {"guard-screen"}};
}

Mask some_mask() {
  Mask mask{kWords, std::vector<std::uint8_t>(kWords.width_px * kWords.height_px)};
  for (std::size_t i = 0; i < mask.rows.size(); ++i) mask.rows[i] = static_cast<std::uint8_t>(i * 7);
  return mask;
}

/// A file, and what it holds at any time.
class FileScreen {
 public:
  FileScreen()
      : path_{std::filesystem::temp_directory_path() / fmt::format("telefab-screen-{}-{}", ::getpid(), made_++)} {
    std::ofstream{path_};
    std::filesystem::resize_file(path_, kBytes);
    const int file = ::open(path_.c_str(), O_RDONLY | O_CLOEXEC);
    view_ = static_cast<const std::byte*>(::mmap(nullptr, kBytes, PROT_READ, MAP_SHARED, file, 0));
    ::close(file);
  }
  ~FileScreen() {
    ::munmap(const_cast<std::byte*>(view_), kBytes);
    std::filesystem::remove(path_);
  }
  FileScreen(const FileScreen&) = delete;
  FileScreen& operator=(const FileScreen&) = delete;

  [[nodiscard]] bool is_black() const {
    return std::all_of(view_, view_ + kBytes, [](std::byte b) { return b == std::byte{0}; });
  }
  [[nodiscard]] std::vector<std::byte> bytes() const { return {view_, view_ + kBytes}; }
  [[nodiscard]] ScreenSettings settings() const { return {path_.string(), "", kWords, 0, PixelPacking::Grey}; }
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// How long it takes to be black, most() at most.
  Nanoseconds time_to_black(Nanoseconds most) const {
    const Nanoseconds from = clock_.now();
    while (!is_black() && clock_.now() - from < most) clock_.sleep_for(1ms);
    return clock_.now() - from;
  }

 private:
  static inline int made_ = 0;
  std::filesystem::path path_;
  const std::byte* view_ = nullptr;
  mutable SystemClock clock_;
};

Result<std::unique_ptr<ScreenProjector>> open_on(const FileScreen& screen, Clock& clock) {
  auto display = open_guarded_display(screen.settings(), guard_program(), clock);
  if (!display) return tl::unexpected{display.error()};
  return ScreenProjector::open(std::move(*display), {kWords, {kWords, {}, {}, {}}, 0}, clock);
}

/// A program of its own that shows a mask for a minute; true once it does.
class Worker {
 public:
  explicit Worker(const FileScreen& screen) {
    int ends[2];
    EXPECT_EQ(::pipe(ends), 0);
    process_ = ::fork();
    if (process_ == 0) {
      SystemClock clock;
      auto projector = open_on(screen, clock);
      const Mask mask = some_mask();
      const bool ok = projector && (*projector)->load(mask.view(), {Microseconds{60s}, 1}) && (*projector)->poll() &&
                      (*projector)->expose();
      const char word = ok ? 'y' : 'n';
      (void)!::write(ends[1], &word, 1);
      while (true) ::pause();
    }
    ::close(ends[1]);
    char word = 'n';
    (void)!::read(ends[0], &word, 1);
    ::close(ends[0]);
    shows_ = word == 'y';
  }
  ~Worker() {
    (void)::kill(process_, SIGKILL);
    (void)::waitpid(process_, nullptr, 0);
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;
  [[nodiscard]] bool shows() const { return shows_; }
  void send(int signal) const { EXPECT_EQ(::kill(process_, signal), 0); }

 private:
  pid_t process_ = -1;
  bool shows_ = false;
};

// An upgrade replaces the file of a program that goes on with its print; its guard must be of its own version.
TEST(OwnGuardProgram, IsTheProgramThatRunsAlsoWhereItsFileWasReplaced) {
  const auto file = std::filesystem::temp_directory_path() / fmt::format("telefab-replaced-{}", ::getpid());
  std::filesystem::copy_file("/bin/sh", file);
  const std::string script = "rm $0 && cp /bin/false $0 && chmod 755 $0 && " + own_guard_program().path + " -c true";
  EXPECT_EQ(std::system(fmt::format("{0} -c '{1}' {0}", file.string(), script).c_str()), 0);
  std::filesystem::remove(file);
}

TEST(GuardedScreen, ShowsAMaskByteForByteAndIsBlackBeforeAndAfter) {
  FileScreen screen;
  SystemClock clock;
  {
    const auto projector = open_on(screen, clock);
    ASSERT_TRUE(projector) << projector.error().what;
    EXPECT_TRUE(screen.is_black());
    EXPECT_THAT((*projector)->facts().name, HasSubstr("unconfirmed"));
    const Mask mask = some_mask();
    ASSERT_TRUE((*projector)->load(mask.view(), {Microseconds{400ms}, 1}));
    EXPECT_EQ((*projector)->poll()->state, LightState::Loaded);
    EXPECT_TRUE(screen.is_black()) << "loading shows nothing";
    const Nanoseconds from = clock.now();
    ASSERT_TRUE((*projector)->expose());
    std::vector<std::byte> want(kBytes);
    ASSERT_TRUE(pack_mask(mask.view(), {kWords, {}, {}, {}}, want, kWords.width_px * 4));
    EXPECT_EQ(screen.bytes(), want);
    Result<ProjectorStatus> status = ProjectorStatus{};
    while ((status = (*projector)->poll()) && status->state == LightState::Exposing) clock.sleep_for(5ms);
    ASSERT_TRUE(status) << status.error().what;
    EXPECT_EQ(status->state, LightState::Exposed);
    EXPECT_GE(clock.now() - from, 400ms);
    EXPECT_TRUE(screen.is_black());
  }
  EXPECT_TRUE(screen.is_black());
}

TEST(GuardedScreen, IsBlackWithinAQuarterOfASecondWhereItsProgramIsKilled) {
  Nanoseconds slowest{};
  for (int i = 0; i < 5; ++i) {
    FileScreen screen;
    Worker worker{screen};
    ASSERT_TRUE(worker.shows());
    ASSERT_FALSE(screen.is_black());
    worker.send(SIGKILL);
    const Nanoseconds took = screen.time_to_black(5s);
    EXPECT_LE(took, kDarkWithin);
    slowest = std::max(slowest, took);
  }
  fmt::print("killed: black within {:.1f} ms\n", double(slowest.count()) / 1e6);
}

TEST(GuardedScreen, IsBlackWithinAQuarterOfASecondWhereItsProgramHangs) {
  Nanoseconds slowest{};
  for (int i = 0; i < 5; ++i) {
    FileScreen screen;
    Worker worker{screen};
    ASSERT_TRUE(worker.shows());
    ASSERT_FALSE(screen.is_black());
    worker.send(SIGSTOP);
    const Nanoseconds took = screen.time_to_black(5s);
    EXPECT_LE(took, kDarkWithin);
    slowest = std::max(slowest, took);
    // Going on changes nothing: it has to go dark first, and to load again.
    worker.send(SIGCONT);
    SystemClock{}.sleep_for(100ms);
    EXPECT_TRUE(screen.is_black());
  }
  fmt::print("stopped: black within {:.1f} ms\n", double(slowest.count()) / 1e6);
}

TEST(GuardedScreen, IsBlackWhereTheProgramIsAskedToStopAndTheGuardDoesNotEndFirst) {
  FileScreen screen;
  Worker worker{screen};
  ASSERT_TRUE(worker.shows());
  worker.send(SIGTERM);  // ends the worker, who has no handler; a guard would hear it from a terminal or systemd too
  EXPECT_LE(screen.time_to_black(5s), kDarkWithin);
}

/// The guard of this process: its only child.
pid_t guard_of_ours() {
  std::ifstream children{fmt::format("/proc/self/task/{}/children", ::getpid())};
  pid_t child = -1;
  children >> child;
  return child;
}

TEST(GuardedScreen, IsDarkenedByItsProgramWhereTheGuardIsKilled) {
  FileScreen screen;
  SystemClock clock;
  const auto projector = open_on(screen, clock);
  ASSERT_TRUE(projector) << projector.error().what;
  const Mask mask = some_mask();
  ASSERT_TRUE((*projector)->load(mask.view(), {Microseconds{60s}, 1}));
  ASSERT_TRUE((*projector)->poll());
  ASSERT_TRUE((*projector)->expose());
  const pid_t guard = guard_of_ours();
  if (guard <= 0) GTEST_SKIP() << "this kernel does not list children";
  ASSERT_EQ(::kill(guard, SIGKILL), 0);
  clock.sleep_for(20ms);
  const auto status = (*projector)->poll();
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::DeviceLost);
  ASSERT_TRUE((*projector)->dark());
  EXPECT_TRUE(screen.is_black());
  // And it goes on, with another guard.
  ASSERT_TRUE((*projector)->load(mask.view(), {Microseconds{50ms}, 1}));
  ASSERT_TRUE((*projector)->poll());
  EXPECT_TRUE((*projector)->expose());
  EXPECT_FALSE(screen.is_black());
  EXPECT_LE(screen.time_to_black(5s), 50ms + kDarkWithin);
}

TEST(GuardedScreen, IsDarkenedWhereItsGuardHangs) {
  FileScreen screen;
  SystemClock clock;
  const auto projector = open_on(screen, clock);
  ASSERT_TRUE(projector) << projector.error().what;
  const Mask mask = some_mask();
  ASSERT_TRUE((*projector)->load(mask.view(), {Microseconds{60s}, 1}));
  ASSERT_TRUE((*projector)->poll());
  ASSERT_TRUE((*projector)->expose());
  const pid_t guard = guard_of_ours();
  if (guard <= 0) GTEST_SKIP() << "this kernel does not list children";
  ASSERT_EQ(::kill(guard, SIGSTOP), 0);
  EXPECT_FALSE((*projector)->poll());
  ASSERT_TRUE((*projector)->dark());
  EXPECT_TRUE(screen.is_black());
}

TEST(GuardedScreen, HasAGuardOfAnotherProcessGroupSoThatAKeyAtTheTerminalEndsItNot) {
  FileScreen screen;
  SystemClock clock;
  const auto projector = open_on(screen, clock);
  ASSERT_TRUE(projector) << projector.error().what;
  const pid_t guard = guard_of_ours();
  if (guard <= 0) GTEST_SKIP() << "this kernel does not list children";
  EXPECT_NE(::getpgid(guard), ::getpgrp());
}

TEST(GuardedScreen, IsRefusedOnAFramebufferOnWhichAnotherProgramShowsItsMasks) {
  FileScreen screen;
  SystemClock clock;
  {
    const auto first = open_on(screen, clock);
    ASSERT_TRUE(first) << first.error().what;
    const auto second = open_guarded_display(screen.settings(), guard_program(), clock);
    ASSERT_FALSE(second);
    EXPECT_THAT(second.error().what, HasSubstr("another program shows its masks on"));
  }
  const auto next = open_guarded_display(screen.settings(), guard_program(), clock);
  EXPECT_TRUE(next) << next.error().what;
}

TEST(GuardedScreen, NamesWhatIsWrongWithAFramebuffer) {
  SystemClock clock;
  const auto refused = [&](ScreenSettings settings) {
    const auto display = open_guarded_display(settings, guard_program(), clock);
    return display ? std::string{} : display.error().what;
  };
  FileScreen screen;
  ScreenSettings settings = screen.settings();
  EXPECT_EQ(refused(settings), "");
  settings.words.width_px = 63;
  EXPECT_THAT(refused(settings), HasSubstr("63 x 40"));
  settings = screen.settings();
  settings.connector += "-not-there";
  EXPECT_THAT(refused(settings), HasSubstr("No such file"));
  EXPECT_FALSE(std::filesystem::exists(settings.connector)) << "a slip makes no file";
  settings.connector = "/dev/null";
  EXPECT_THAT(refused(settings), HasSubstr("neither a framebuffer nor a plain file"));
  settings.connector = "";
  EXPECT_THAT(refused(settings), HasSubstr("screen.connector"));
  settings.connector = "HDMI-A-97";
  EXPECT_THAT(refused(settings), HasSubstr("no connector \"HDMI-A-97\""));
  const auto no_guard = open_guarded_display(screen.settings(), {"/nonexistent/guard", {}}, clock);
  ASSERT_FALSE(no_guard);
  EXPECT_THAT(no_guard.error().what, HasSubstr("/nonexistent/guard"));
}

TEST(GuardedScreen, IsNotUsedWithAGuardThatDarkensNothing) {
  FileScreen screen;
  SystemClock clock;
  const auto refused = open_guarded_display(screen.settings(), {"/bin/cat", {}}, clock);
  ASSERT_FALSE(refused);
  EXPECT_TRUE(screen.is_black());
}

}  // namespace
}  // namespace telefab::fab
