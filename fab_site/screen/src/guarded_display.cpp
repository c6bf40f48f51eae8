// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <mutex>
#include <telefab/fab/screen/guarded_display.hpp>
#include <telefab/fab/screen/packing.hpp>
#include <thread>

#include "guard_message.hpp"

extern char** environ;

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr Nanoseconds kBeat = 30ms;
constexpr Nanoseconds kOpenPatience = 10s;
constexpr Nanoseconds kAnswerPatience = 2s;
constexpr Nanoseconds kShortPatience = 300ms;  ///< of what costs nothing; a guard that hangs is replaced behind it
constexpr Nanoseconds kTrial = 5s;
constexpr Nanoseconds kDarkWithin = 250ms;
constexpr Nanoseconds kSilence = 400ms;  ///< tried: long enough for a guard that is late to be seen late
constexpr Nanoseconds kEndPatience = 500ms;
constexpr Nanoseconds kLook = 2ms;
constexpr int kTrials = 3;

/// The running guard, and the signs of life that it hears.
class GuardLink {
 public:
  ~GuardLink() {
    beats_ = {};
    socket_ = {};  // it darkens and ends
    if (!hangs_ && has_ended()) return;
    (void)::kill(process_, SIGKILL);
    (void)has_ended();
  }
  GuardLink(const GuardLink&) = delete;
  GuardLink& operator=(const GuardLink&) = delete;

  static Result<std::unique_ptr<GuardLink>> start(const GuardProgram& program) {
    int ends[2] = {-1, -1};
    if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0)
      return fail(ErrorCode::Internal, fmt::format("screen: no socket for its guard: {}", std::strerror(errno)));
    OpenFile ours{ends[0]}, theirs{ends[1]};
    std::vector<std::string> words{program.path};
    words.insert(words.end(), program.arguments.begin(), program.arguments.end());
    std::vector<char*> arguments;
    for (std::string& word : words) arguments.push_back(word.data());
    arguments.push_back(nullptr);
    // A copy by dup2 is open in the guard alone; where the number is already the right one, nothing would be copied.
    OpenFile moved;
    if (theirs.get() == kGuardSocket) {
      moved = OpenFile{::fcntl(theirs.get(), F_DUPFD_CLOEXEC, kGuardSocket + 1)};
      std::swap(moved, theirs);
    }
    posix_spawn_file_actions_t actions;
    ::posix_spawn_file_actions_init(&actions);
    ::posix_spawn_file_actions_adddup2(&actions, theirs.get(), kGuardSocket);
    // No socket of the daemon; and no key at its terminal reaches the one that is to darken.
    ::posix_spawn_file_actions_addclosefrom_np(&actions, kGuardSocket + 1);
    posix_spawnattr_t attributes;
    ::posix_spawnattr_init(&attributes);
    ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP);
    pid_t process = -1;
    const int failed = ::posix_spawn(&process, program.path.c_str(), &actions, &attributes, arguments.data(), environ);
    ::posix_spawnattr_destroy(&attributes);
    ::posix_spawn_file_actions_destroy(&actions);
    if (failed != 0)
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("screen: its guard {} cannot be started: {}", program.path, std::strerror(failed)));
    std::unique_ptr<GuardLink> link{new GuardLink{std::move(ours), process}};
    link->beat();
    return link;
  }

  /// The answer. DeviceLost: the guard is gone; DeviceTimeout: it does not answer.
  Result<GuardReply> ask(GuardRequest request, Nanoseconds patience, int file = -1, OpenFile* came = nullptr) {
    request.number = ++number_;
    {
      const std::lock_guard lock{mutex_};
      if (!send_packet(socket_.get(), request, file)) {
        if (errno != EAGAIN) return fail(ErrorCode::DeviceLost, "screen: its guard is gone");
        hangs_ = true;
        return fail(ErrorCode::DeviceTimeout, "screen: its guard does not answer");
      }
    }
    const Nanoseconds until = clock_.now() + patience;
    while (clock_.now() < until) {
      auto reply = receive_packet<GuardReply>(socket_.get(), until - clock_.now(), came);
      if (!reply) return tl::unexpected{reply.error()};
      if (!*reply || (*reply)->number != request.number) continue;
      if ((*reply)->error != 0) return fail(static_cast<ErrorCode>((*reply)->error), std::string{(*reply)->text});
      return **reply;
    }
    hangs_ = true;
    return fail(ErrorCode::DeviceTimeout, "screen: its guard does not answer");
  }

  void beat() {
    beats_ = std::jthread{[this](const std::stop_token& stop) {
      pthread_setname_np(pthread_self(), "screen");
      SystemClock clock;
      while (!stop.stop_requested()) {
        {
          const std::lock_guard lock{mutex_};
          if (!send_packet(socket_.get(), GuardRequest{}) && errno != EAGAIN) return;
        }
        clock.sleep_for(kBeat);
      }
    }};
  }
  /// It was asked and did not answer: it will not be waited for.
  [[nodiscard]] bool hangs() const { return hangs_; }
  void fall_silent() { beats_ = {}; }

 private:
  GuardLink(OpenFile socket, pid_t process) : socket_{std::move(socket)}, process_{process} {}

  /// Waits for it, no longer than half a second.
  bool has_ended() {
    for (const Nanoseconds until = clock_.now() + kEndPatience; clock_.now() < until; clock_.sleep_for(kLook))
      if (::waitpid(process_, nullptr, WNOHANG) != 0) return true;
    return false;
  }

  OpenFile socket_;
  pid_t process_;
  SystemClock clock_;
  std::mutex mutex_;  ///< two threads send
  std::uint32_t number_ = 0;
  bool hangs_ = false;
  std::jthread beats_;
};

/// Memory that the program writes and its guard reads.
class SharedFrame {
 public:
  SharedFrame() = default;
  SharedFrame(const SharedFrame&) = delete;
  SharedFrame& operator=(const SharedFrame&) = delete;
  ~SharedFrame() {
    if (rows_ != nullptr) ::munmap(rows_, bytes_);
  }
  Result<void> make(std::size_t bytes) {
    file_ = OpenFile{::memfd_create("telefab-screen", MFD_CLOEXEC)};
    if (file_.get() < 0 || ::ftruncate(file_.get(), static_cast<off_t>(bytes)) != 0)
      return fail(ErrorCode::Internal, fmt::format("screen: no memory for a frame: {}", std::strerror(errno)));
    void* rows = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, file_.get(), 0);
    if (rows == MAP_FAILED)
      return fail(ErrorCode::Internal, fmt::format("screen: no memory for a frame: {}", std::strerror(errno)));
    rows_ = static_cast<std::byte*>(rows);
    bytes_ = bytes;
    return {};
  }
  [[nodiscard]] int file() const { return file_.get(); }
  [[nodiscard]] std::span<std::byte> bytes() const { return {rows_, bytes_}; }

 private:
  OpenFile file_;
  std::byte* rows_ = nullptr;
  std::size_t bytes_ = 0;
};

class GuardedDisplay final : public ScreenDisplay {
 public:
  GuardedDisplay(const ScreenSettings& settings, const GuardProgram& program, Clock& clock)
      : settings_{settings}, program_{program}, clock_{clock} {}
  ~GuardedDisplay() override { (void)black(); }

  Result<void> open() {
    const std::uint32_t word_bytes = bytes_per_word(settings_.packing);
    if (const auto ok = frame_.make(std::size_t{settings_.words.width_px} * settings_.words.height_px * word_bytes);
        !ok)
      return ok;
    facts_.words = settings_.words;
    facts_.word_bytes = word_bytes;
    if (const auto ok = start(); !ok) return ok;
    return try_guard();
  }

  const DisplayFacts& facts() const override { return facts_; }
  std::span<std::byte> hidden() override { return frame_.bytes(); }

  Result<void> prepare() override { return order({.order = GuardOrder::Prepare}); }

  Result<void> show(Nanoseconds at_most) override {
    return order({.order = GuardOrder::Show, .at_most_ns = at_most.count()});
  }

  Result<bool> is_shown() override {
    if (!guard_) return no_guard();
    const auto reply = guard_->ask({.order = GuardOrder::Ask}, kShortPatience);
    if (!reply) return tl::unexpected{reply.error()};
    if (reply->has_tripped != 0)
      return fail(ErrorCode::DeviceTimeout, "screen: its guard darkened it, for this program gave no sign of life");
    return reply->is_shown != 0;
  }

  Result<void> black() override {
    if (guard_ && !guard_->hangs()) {
      if (const auto ok = order({.order = GuardOrder::Black}); ok) return ok;
    }
    // Its guard is dead or hangs: darkened by the file that both have open, then by a new guard.
    guard_.reset();
    Result<void> black;
    if (card_.get() >= 0) {
      black = blacken_kms(card_.get(), means_);
    } else if (was_ours_ && settings_.connector.starts_with('/')) {
      const auto by_hand = open_framebuffer(settings_);
      if (!by_hand) black = tl::unexpected{by_hand.error()};
    }
    card_ = {};
    // Without a guard nothing is shown any more, but black is black.
    const auto again = start();
    if (!again) why_no_guard_ = again.error().what;
    return black ? black : again;
  }

 private:
  Result<void> start() {
    auto link = GuardLink::start(program_);
    if (!link) return tl::unexpected{link.error()};
    GuardRequest request{.order = GuardOrder::Open,
                         .width_words = settings_.words.width_px,
                         .height_px = settings_.words.height_px,
                         .packing = static_cast<std::uint32_t>(settings_.packing),
                         .refresh_hz = settings_.refresh_hz};
    if (settings_.connector.size() >= sizeof request.connector || settings_.edid.size() >= sizeof request.edid)
      return fail(ErrorCode::InvalidInput, "screen: screen.connector or screen.edid is too long");
    std::memcpy(request.connector, settings_.connector.data(), settings_.connector.size());
    std::memcpy(request.edid, settings_.edid.data(), settings_.edid.size());
    const auto reply = (*link)->ask(request, kOpenPatience, frame_.file(), &card_);
    if (!reply) return tl::unexpected{reply.error()};
    means_ = reply->means;
    facts_.name = reply->text;
    facts_.frame = Nanoseconds{reply->frame_ns};
    facts_.confirms = reply->confirms != 0;
    guard_ = std::move(*link);
    was_ours_ = true;
    return {};
  }

  /// A guard that does not darken is found before there is anything to darken: a black frame is shown, without a sign
  /// of life behind it.
  Result<void> try_guard() {
    Nanoseconds took{};
    for (int i = 0; i < kTrials; ++i) {
      if (const auto ok = prepare(); !ok) return ok;
      if (const auto ok = show(kTrial); !ok) return ok;
      guard_->fall_silent();
      clock_.sleep_for(kSilence);
      const auto reply = guard_->ask({.order = GuardOrder::Ask}, kAnswerPatience);
      guard_->beat();
      if (!reply) return tl::unexpected{reply.error()};
      if (reply->has_tripped == 0 || reply->is_shown != 0)
        return fail(ErrorCode::DeviceRefused, "screen: its guard does not darken it where this program hangs");
      if (const auto ok = black(); !ok) return ok;
      took = Nanoseconds{reply->tripped_after_ns};
      if (took <= kDarkWithin) return {};
    }
    return fail(
        ErrorCode::DeviceRefused,
        fmt::format("screen: its guard takes {} ms to darken it where this program hangs, {} are allowed; is this "
                    "computer overloaded?",
                    took.count() / 1'000'000, kDarkWithin.count() / 1'000'000));
  }

  Result<void> order(const GuardRequest& request) {
    if (!guard_) return no_guard();
    const auto reply = guard_->ask(request, request.order == GuardOrder::Black ? kShortPatience : kAnswerPatience);
    if (!reply) return tl::unexpected{reply.error()};
    return {};
  }

  [[nodiscard]] tl::unexpected<Error> no_guard() const {
    return fail(ErrorCode::DeviceLost, "screen: its guard is gone, and no other could be started: " + why_no_guard_);
  }

  ScreenSettings settings_;
  GuardProgram program_;
  Clock& clock_;
  DisplayFacts facts_;
  SharedFrame frame_;
  OpenFile card_;  ///< shared with the guard; outlives it
  BlackMeans means_;
  std::unique_ptr<GuardLink> guard_;
  bool was_ours_ = false;  ///< a guard had it; what another program shows is not darkened by hand
  std::string why_no_guard_;
};

}  // namespace

ScreenSettings screen_settings(const MachineProfile& machine) {
  const auto& screen = machine.screen;
  return {screen.connector, screen.edid, {screen.width_px, screen.height_px}, screen.refresh_hz, screen.packing};
}

GuardProgram own_guard_program() {
  // Not the path that it had: after an upgrade another version lies there, which may speak otherwise.
  return {"/proc/self/exe", {"guard-screen"}};
}

Result<std::unique_ptr<ScreenDisplay>> open_guarded_display(const ScreenSettings& settings, const GuardProgram& program,
                                                            Clock& clock) {
  if (settings.connector.empty())
    return fail(ErrorCode::InvalidInput, "screen: state screen.connector; there are " + describe_screens());
  if (settings.words.width_px == 0 || settings.words.height_px == 0)
    return fail(ErrorCode::InvalidInput, "screen: state its mode, screen.width_px, height_px and refresh_hz");
  auto display = std::make_unique<GuardedDisplay>(settings, program, clock);
  if (const auto ok = display->open(); !ok) return tl::unexpected{ok.error()};
  return display;
}

}  // namespace telefab::fab
