// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/store/audit_log.hpp>

namespace telefab {
namespace {

constexpr std::size_t kMaxTextBytes = 1000;
constexpr std::uint64_t kMaxLogBytes = 4ULL << 30U;

}  // namespace

struct AuditLog::Impl {
  std::filesystem::path path;
  const Clock& clock;
  int file = -1;
  std::uint64_t next = 1;
  Digest last{};
  std::mutex mutex;

  Impl(std::filesystem::path where, const Clock& ticking) : path{std::move(where)}, clock{ticking} {}
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (file >= 0) ::close(file);
  }

  [[nodiscard]] tl::unexpected<Error> failed(std::string_view deed) const {
    return fail(errno == EACCES || errno == EROFS ? ErrorCode::NotPermitted : ErrorCode::StorageFailed,
                fmt::format("cannot {} the audit log {}: {}", deed, path.string(), std::strerror(errno)));
  }

  /// Follows the chain through the text; returns the bytes of whole lines.
  [[nodiscard]] Result<std::size_t> follow(std::string_view text) {
    std::size_t at = 0;
    while (true) {
      const std::size_t end = text.find('\n', at);
      if (end == std::string_view::npos) return at;
      const std::string_view line = text.substr(at, end - at);
      const auto entry = nlohmann::json::parse(line, nullptr, false);
      const auto before = entry.is_object() ? entry.find("before") : entry.end();
      if (!entry.is_object() || entry.value("n", std::uint64_t{0}) != next || before == entry.end() ||
          *before != to_hex(last))
        return fail(ErrorCode::NotTrusted,
                    fmt::format("line {} of the audit log {} does not follow the line before it: the "
                                "file was changed; keep it aside and look who did",
                                next, path.string()));
      Hasher hasher;
      hasher.feed(line);
      last = hasher.digest();
      ++next;
      at = end + 1;
    }
  }
};

AuditLog::AuditLog(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}
AuditLog::~AuditLog() = default;

Result<std::unique_ptr<AuditLog>> AuditLog::open(const std::filesystem::path& path, const Clock& clock) {
  auto impl = std::make_unique<Impl>(path, clock);
  if (std::filesystem::exists(path)) {
    const auto bytes = read_file(path, kMaxLogBytes);
    if (!bytes) return tl::unexpected{bytes.error()};
    const auto whole = impl->follow({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
    if (!whole) return tl::unexpected{whole.error()};
    if (*whole < bytes->size() && ::truncate(path.c_str(), static_cast<off_t>(*whole)) != 0)
      return impl->failed("shorten");
  }
  impl->file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0640);
  if (impl->file < 0) return impl->failed("open");
  return std::unique_ptr<AuditLog>{new AuditLog{std::move(impl)}};
}

Result<void> AuditLog::add(std::string_view who, std::string_view what) {
  const std::lock_guard lock{impl_->mutex};
  const nlohmann::ordered_json entry{
      {"n", impl_->next},
      {"unix_ms", std::chrono::duration_cast<std::chrono::milliseconds>(impl_->clock.wall()).count()},
      {"who", who.substr(0, kMaxTextBytes)},
      {"what", what.substr(0, kMaxTextBytes)},
      {"before", to_hex(impl_->last)}};
  const std::string line = entry.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  const std::string text = line + '\n';
  const ssize_t written = ::write(impl_->file, text.data(), text.size());
  if (written != static_cast<ssize_t>(text.size()) || ::fdatasync(impl_->file) != 0) return impl_->failed("write");
  Hasher hasher;
  hasher.feed(line);
  impl_->last = hasher.digest();
  ++impl_->next;
  return {};
}

}  // namespace telefab
