// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/store/audit_log.hpp>

namespace telefab {
namespace {

constexpr std::size_t kMaxTextBytes = 1000;
constexpr std::uint64_t kLongestLine = 32U << 10U;  ///< two texts, escaped, and the rest
constexpr std::uint64_t kMaxLogBytes = 4ULL << 30U;

// The chain shows a changed line by the one behind it; the last one by a checksum of its own, the last key of a line.
constexpr std::string_view kSumKey = R"(,"sum":")";
constexpr std::size_t kSumDigits = 16;
constexpr std::string_view kLineEnd = R"("})";

std::string sum_of(std::string_view text) {
  Hasher hasher;
  hasher.feed(text);
  return to_hex(hasher.digest()).substr(0, kSumDigits);
}

/// `object`: one of JSON that is not empty.
std::string with_sum(std::string object) {
  object.pop_back();
  const std::string sum = sum_of(object);
  return object.append(kSumKey).append(sum).append(kLineEnd);
}

bool is_sound(std::string_view line) {
  const std::size_t tail = kSumKey.size() + kSumDigits + kLineEnd.size();
  if (line.size() < tail) return false;
  const std::string_view object = line.substr(0, line.size() - tail);
  return line == with_sum(std::string{object} + '}');
}

}  // namespace

struct AuditLog::Impl {
  std::filesystem::path path;
  const Clock& clock;
  int file = -1;
  std::uint64_t next = 1;
  std::uint64_t bytes = 0;  ///< of whole lines
  bool is_broken = false;   ///< half a line may stand at the end: nothing is written behind it
  bool has_sums = false;    ///< every further line must carry one
  Digest last{};
  std::mutex mutex;

  Impl(std::filesystem::path where, const Clock& ticking) : path{std::move(where)}, clock{ticking} {}
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (file >= 0) ::close(file);
  }

  [[nodiscard]] tl::unexpected<Error> failed(std::string_view operation) const {
    return fail(errno == EACCES || errno == EROFS ? ErrorCode::NotPermitted : ErrorCode::StorageFailed,
                fmt::format("cannot {} the audit log {}: {}", operation, path.string(), std::strerror(errno)));
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
      const bool has_sum = entry.is_object() && entry.contains("sum");
      if (!entry.is_object() || !entry.contains("n") || entry["n"] != next || before == entry.end() ||
          *before != to_hex(last) || (has_sums && !has_sum) || (has_sum && !is_sound(line)))
        return fail(ErrorCode::NotTrusted,
                    fmt::format("line {} of the audit log {} does not follow the line before it: the "
                                "file was changed; keep it aside and look who did",
                                next, path.string()));
      Hasher hasher;
      hasher.feed(line);
      last = hasher.digest();
      has_sums |= has_sum;
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
    impl->bytes = *whole;
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
  if (impl_->is_broken)
    return fail(
        ErrorCode::StorageFailed,
        fmt::format("the audit log {} could not be written before; start the site again", impl_->path.string()));
  const std::string line = with_sum(entry.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  const std::string text = line + '\n';
  errno = ENOSPC;  // what a short write means, which sets none
  const ssize_t written = ::write(impl_->file, text.data(), text.size());
  if (written != static_cast<ssize_t>(text.size()) || ::fdatasync(impl_->file) != 0) {
    auto error = impl_->failed("write");
    // Half a line would break the chain for the next one, and the next start would be refused.
    impl_->is_broken = ::ftruncate(impl_->file, static_cast<off_t>(impl_->bytes)) != 0;
    return error;
  }
  impl_->bytes += text.size();
  Hasher hasher;
  hasher.feed(line);
  impl_->last = hasher.digest();
  ++impl_->next;
  return {};
}

Result<AuditHead> audit_head(const std::filesystem::path& path) {
  std::ifstream in{path, std::ios::binary | std::ios::ate};
  if (!in) return fail(ErrorCode::NotFound, fmt::format("cannot read the audit log {}", path.string()));
  const auto size = static_cast<std::uint64_t>(in.tellg());
  std::string tail(std::min<std::uint64_t>(size, kLongestLine), '\0');
  in.seekg(static_cast<std::streamoff>(size - tail.size()));
  in.read(tail.data(), static_cast<std::streamsize>(tail.size()));
  if (!in) return fail(ErrorCode::StorageFailed, fmt::format("cannot read the audit log {}", path.string()));
  // What stands behind the last end of a line is being written, or torn.
  const std::size_t end = tail.rfind('\n');
  if (end == std::string::npos) return AuditHead{};
  const std::size_t before = end == 0 ? std::string::npos : tail.rfind('\n', end - 1);
  const std::string_view line = std::string_view{tail}.substr(before == std::string::npos ? 0 : before + 1,
                                                              end - (before == std::string::npos ? 0 : before + 1));
  Hasher hasher;
  hasher.feed(line);
  try {
    return AuditHead{whole_number<std::uint64_t>(nlohmann::json::parse(line).at("n")), hasher.digest()};
  } catch (const nlohmann::json::exception&) {
    return fail(ErrorCode::NotTrusted,
                fmt::format("the last line of {} is not an entry of an audit log", path.string()));
  }
}

}  // namespace telefab
