// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <csignal>
#include <cstring>
#include <telefab/fab/screen/packing.hpp>

#include "console.hpp"
#include "guard_message.hpp"

namespace telefab::fab {

using namespace std::chrono_literals;

namespace {

constexpr Nanoseconds kSilence = 160ms;  ///< a program that says nothing for so long hangs
constexpr int kBlackTries = 5;

template <std::size_t kSize>
void put(char (&to)[kSize], std::string_view text) {
  const std::size_t n = std::min(text.size(), kSize - 1);
  std::memcpy(to, text.data(), n);
  to[n] = '\0';
}

template <std::size_t kSize>
std::string text_of(const char (&from)[kSize]) {
  return std::string{from, ::strnlen(from, kSize)};
}

/// One guard and the program it watches.
class Guard {
 public:
  explicit Guard(int socket) : socket_{socket} {}
  ~Guard() {
    if (frame_ != nullptr) ::munmap(frame_, frame_bytes_);
  }
  Guard(const Guard&) = delete;
  Guard& operator=(const Guard&) = delete;

  /// Until the program is gone and the screen is black.
  int watch() {
    while (true) {
      OpenFile file;
      auto request = receive_packet<GuardRequest>(socket_, patience(), &file);
      if (!request) {
        const bool dark = darken();
        return dark ? 0 : 1;
      }
      const Nanoseconds now = clock_.now();
      if (*request) {
        received_at_ = now;
        if (!carry_out(**request, file)) {
          (void)darken();
          return 1;
        }
      }
      if (!shown_until_) continue;
      if (now >= *shown_until_ && darken()) shown_until_.reset();
      if (shown_until_ && now - received_at_ >= kSilence) {
        has_tripped_ = true;
        if (darken()) shown_until_.reset();
        tripped_after_ = clock_.now() - received_at_;
      }
    }
  }

 private:
  [[nodiscard]] Nanoseconds patience() const {
    if (!shown_until_) return 1s;
    const Nanoseconds next = std::min(*shown_until_, received_at_ + kSilence);
    return std::clamp(next - clock_.now(), Nanoseconds{0}, Nanoseconds{1s});
  }

  bool darken() {
    if (!scanout_) return true;
    for (int i = 0; i < kBlackTries; ++i)
      if (scanout_->black()) return true;
    return false;
  }

  /// False: the program cannot be told any more.
  bool carry_out(const GuardRequest& request, OpenFile& file) {
    if (request.order == GuardOrder::Beat) return true;
    GuardReply reply;
    reply.number = request.number;
    int shared = -1;
    if (const auto done = obey(request, file, reply, shared); !done) {
      reply.error = static_cast<std::uint32_t>(done.error().code);
      put(reply.text, done.error().what);
    }
    return send_packet(socket_, reply, shared);
  }

  Result<void> obey(const GuardRequest& request, OpenFile& file, GuardReply& reply, int& shared) {
    if (request.order == GuardOrder::Open) return open(request, file, reply, shared);
    if (!scanout_) return fail(ErrorCode::Conflict, "screen: its guard has opened none");
    switch (request.order) {
      case GuardOrder::Prepare:
        return scanout_->prepare({frame_, frame_bytes_});
      case GuardOrder::Show: {
        if (has_tripped_) return fail(ErrorCode::DeviceTimeout, "screen: its guard took this program for hung");
        // Until it is black again it may be shown, confirmed or not.
        shown_until_ = clock_.now() + Nanoseconds{request.at_most_ns};
        const auto shown = scanout_->show();
        if (shown)
          shown_until_ = clock_.now() + Nanoseconds{request.at_most_ns};
        else if (darken())
          shown_until_.reset();
        return shown;
      }
      case GuardOrder::Ask:
        reply.is_shown = shown_until_ ? 1 : 0;
        reply.has_tripped = has_tripped_ ? 1 : 0;
        reply.tripped_after_ns = tripped_after_.count();
        return shown_until_ ? scanout_->check() : Result<void>{};
      case GuardOrder::Black: {
        const auto black = scanout_->black();
        if (black) {
          shown_until_.reset();
          has_tripped_ = false;
        }
        return black;
      }
      case GuardOrder::Open:
      case GuardOrder::Beat:
        break;
    }
    return fail(ErrorCode::ProtocolBroken, "screen: an order that its guard does not know");
  }

  Result<void> open(const GuardRequest& request, OpenFile& file, GuardReply& reply, int& shared) {
    ScreenSettings settings;
    settings.connector = text_of(request.connector);
    settings.edid = text_of(request.edid);
    settings.words = {request.width_words, request.height_px};
    settings.refresh_hz = request.refresh_hz;
    settings.packing = static_cast<PixelPacking>(request.packing);
    frame_bytes_ = std::size_t{request.width_words} * request.height_px * bytes_per_word(settings.packing);
    struct stat status {};
    if (file.get() < 0 || ::fstat(file.get(), &status) != 0 || static_cast<std::size_t>(status.st_size) != frame_bytes_)
      return fail(ErrorCode::ProtocolBroken, "screen: no frame is shared with its guard");
    void* frame = ::mmap(nullptr, frame_bytes_, PROT_READ, MAP_SHARED, file.get(), 0);
    if (frame == MAP_FAILED) return fail(ErrorCode::Internal, "screen: its guard cannot read the frame");
    frame_ = static_cast<std::byte*>(frame);
    if (settings.connector.starts_with('/')) {
      lock_ = OpenFile{::open(settings.connector.c_str(), O_RDONLY | O_CLOEXEC)};
      if (lock_.get() >= 0 && take_lock(lock_) != 0)
        return fail(ErrorCode::DeviceRefused,
                    fmt::format("screen: another program shows its masks on {}", settings.connector));
    }
    auto scanout = open_scanout(settings, clock_);
    if (!scanout) return tl::unexpected{scanout.error()};
    scanout_ = std::move(*scanout);
    put(reply.text, scanout_->name());
    reply.frame_ns = scanout_->frame().count();
    reply.confirms = scanout_->confirms() ? 1 : 0;
    reply.means = scanout_->black_means();
    shared = scanout_->shared_file();
    return {};
  }

  int socket_;
  SystemClock clock_;
  OpenFile lock_;  ///< a framebuffer has no owner of its own
  std::unique_ptr<Scanout> scanout_;
  std::byte* frame_ = nullptr;
  std::size_t frame_bytes_ = 0;
  std::optional<Nanoseconds> shown_until_;  ///< a frame may be shown; black by then
  bool has_tripped_ = false;
  Nanoseconds received_at_{}, tripped_after_{};
};

/// A screen behind a console that was cleared before.
class ScanoutOnConsole final : public Scanout {
 public:
  ScanoutOnConsole(std::unique_ptr<Console> console, std::unique_ptr<Scanout> screen)
      : console_{std::move(console)}, screen_{std::move(screen)}, name_{screen_->name()} {
    switch (console_->state()) {
      case Console::State::NotThere:
        break;
      case Console::State::NotPermitted:
        name_ += ", text console NOT cleared (not permitted): it comes back where all programs die";
        break;
      case Console::State::Cleared:
        name_ += ", text console cleared";
        break;
      case Console::State::Silent:
        name_ += ", text console silent";
        break;
    }
  }
  const std::string& name() const override { return name_; }
  Nanoseconds frame() const override { return screen_->frame(); }
  bool confirms() const override { return screen_->confirms(); }
  Result<void> prepare(std::span<const std::byte> frame) override { return screen_->prepare(frame); }
  Result<void> show() override { return screen_->show(); }
  Result<void> black() override { return screen_->black(); }
  Result<void> check() override { return screen_->check(); }
  int shared_file() const override { return screen_->shared_file(); }
  BlackMeans black_means() const override { return screen_->black_means(); }

 private:
  std::unique_ptr<Console> console_;  ///< ends behind the screen
  std::unique_ptr<Scanout> screen_;
  std::string name_;
};

}  // namespace

Result<std::unique_ptr<Scanout>> open_scanout(const ScreenSettings& settings, Clock& clock) {
  const bool is_framebuffer = settings.connector.starts_with('/');
  struct stat status {};
  const bool is_file = is_framebuffer && ::stat(settings.connector.c_str(), &status) == 0 && S_ISREG(status.st_mode);
  if (is_file) return open_framebuffer(settings);
  auto console = std::make_unique<Console>();
  auto screen = is_framebuffer ? open_framebuffer(settings) : open_kms(settings, clock);
  if (!screen) return screen;
  return std::make_unique<ScanoutOnConsole>(std::move(console), std::move(*screen));
}

int run_screen_guard(int socket) {
  // A stop, a watchdog's too, is the program's to hear: the guard ends behind it.
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGABRT, SIGPIPE}) (void)::signal(signal, SIG_IGN);
  struct stat status {};
  if (::fstat(socket, &status) != 0 || !S_ISSOCK(status.st_mode)) return 1;
  // Where it is not permitted the guard is as quick as any other program.
  (void)::mlockall(MCL_CURRENT);
  (void)::setpriority(PRIO_PROCESS, 0, -10);
  Guard guard{socket};
  return guard.watch();
}

}  // namespace telefab::fab
