// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <fstream>
#include <mutex>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
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

tl::unexpected<Error> cannot(std::string_view operation, const std::filesystem::path& path) {
  return fail_system(fmt::format("{} the audit log", operation), path, errno);
}

std::filesystem::path part_path(const std::filesystem::path& path, std::size_t number) {
  return fmt::format("{}.{:06}", path.string(), number);
}

/// Parts are numbered from 1 without a gap.
std::size_t closed_parts(const std::filesystem::path& path) {
  std::error_code error;
  std::size_t count = 0;
  while (std::filesystem::exists(part_path(path, count + 1), error)) ++count;
  return count;
}

/// The chain of a log as far as it was followed.
struct Chain {
  std::uint64_t next = 1;
  Digest last{};
  bool has_sums = false;  ///< every further line must carry one

  /// Follows it through the text of a file; returns the bytes of whole lines.
  [[nodiscard]] Result<std::size_t> follow(std::string_view text, const std::filesystem::path& path) {
    std::size_t at = 0;
    while (true) {
      const std::size_t end = text.find('\n', at);
      if (end == std::string_view::npos) return at;
      const std::string_view line = text.substr(at, end - at);
      const auto entry = json_or_discarded(line);
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
  [[nodiscard]] Result<std::size_t> follow_file(const std::filesystem::path& path, std::uint64_t& size) {
    const auto bytes = read_file(path, kMaxLogBytes);
    if (!bytes) return tl::unexpected{bytes.error()};
    size = bytes->size();
    return follow({reinterpret_cast<const char*>(bytes->data()), bytes->size()}, path);
  }
};

/// The last whole line of one file; nothing where it has none.
Result<AuditHead> head_of(const std::filesystem::path& path) {
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
    const auto entry = parsed_json(line);
    if (!entry.contains("sum") || is_sound(line))
      return AuditHead{whole_number<std::uint64_t>(entry.at("n")), hasher.digest()};
  } catch (const nlohmann::ordered_json::exception&) {  // said below
  }
  return fail(ErrorCode::NotTrusted, fmt::format("the last line of {} is not an entry of an audit log", path.string()));
}

}  // namespace

struct AuditLog::Impl {
  std::filesystem::path path;
  const Clock& clock;
  std::uint64_t part_bytes;
  std::size_t parts = 0;    ///< closed ones
  int file = -1;            ///< -1: to be opened at the next line
  std::uint64_t bytes = 0;  ///< of whole lines
  bool is_broken = false;   ///< half a line may stand at the end: nothing is written behind it
  Chain chain;
  std::mutex mutex;

  Impl(std::filesystem::path where, const Clock& ticking, std::uint64_t most)
      : path{std::move(where)}, clock{ticking}, part_bytes{most} {}
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (file >= 0) ::close(file);
  }

  [[nodiscard]] Result<void> open_file() {
    if (file >= 0) return {};
    file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0640);
    if (file < 0) return cannot("open", path);
    return {};
  }

  /// Makes a full file a closed part. Where that fails, it takes lines a while longer: none is lost by it.
  void close_full_part() {
    if (bytes < part_bytes || is_broken || ::rename(path.c_str(), part_path(path, parts + 1).c_str()) != 0) return;
    ++parts;
    if (file >= 0) ::close(std::exchange(file, -1));
    bytes = 0;
    (void)sync_folder_of(path);  // a loss of power before it takes effect leaves one long part, and no line is lost
  }
};

AuditLog::AuditLog(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}
AuditLog::~AuditLog() = default;

Result<std::unique_ptr<AuditLog>> AuditLog::open(const std::filesystem::path& path, const Clock& clock,
                                                 std::uint64_t part_bytes) {
  auto impl = std::make_unique<Impl>(path, clock, part_bytes);
  impl->parts = closed_parts(path);
  if (impl->parts > 0) {
    const auto before = head_of(part_path(path, impl->parts));
    if (!before) return tl::unexpected{before.error()};
    impl->chain = {before->entries + 1, before->line, true};
  }
  if (std::filesystem::exists(path)) {
    std::uint64_t size = 0;
    const auto whole = impl->chain.follow_file(path, size);
    if (!whole) return tl::unexpected{whole.error()};
    if (*whole < size && ::truncate(path.c_str(), static_cast<off_t>(*whole)) != 0) return cannot("shorten", path);
    impl->bytes = *whole;
  }
  impl->close_full_part();
  if (auto opened = impl->open_file(); !opened) return tl::unexpected{opened.error()};
  return std::unique_ptr<AuditLog>{new AuditLog{std::move(impl)}};
}

Result<void> AuditLog::add(std::string_view who, std::string_view what) {
  const std::lock_guard lock{impl_->mutex};
  Chain& chain = impl_->chain;
  const nlohmann::ordered_json entry{
      {"n", chain.next},
      {"unix_ms", std::chrono::duration_cast<std::chrono::milliseconds>(impl_->clock.wall()).count()},
      {"who", who.substr(0, kMaxTextBytes)},
      {"what", what.substr(0, kMaxTextBytes)},
      {"before", to_hex(chain.last)}};
  if (impl_->is_broken)
    return fail(
        ErrorCode::StorageFailed,
        fmt::format("the audit log {} could not be written before; start the site again", impl_->path.string()));
  impl_->close_full_part();
  if (auto opened = impl_->open_file(); !opened) return opened;
  const std::string line = with_sum(json_text(entry));
  const std::string text = line + '\n';
  errno = ENOSPC;  // what a short write means, which sets none
  const ssize_t written = ::write(impl_->file, text.data(), text.size());
  if (written != static_cast<ssize_t>(text.size()) || ::fdatasync(impl_->file) != 0) {
    auto error = cannot("write", impl_->path);
    // Half a line would break the chain for the next one, and the next start would be refused.
    impl_->is_broken = ::ftruncate(impl_->file, static_cast<off_t>(impl_->bytes)) != 0;
    return error;
  }
  impl_->bytes += text.size();
  Hasher hasher;
  hasher.feed(line);
  chain.last = hasher.digest();
  chain.has_sums = true;
  ++chain.next;
  return {};
}

std::vector<std::filesystem::path> audit_parts(const std::filesystem::path& path) {
  std::vector<std::filesystem::path> parts;
  const std::size_t closed = closed_parts(path);
  for (std::size_t number = 1; number <= closed; ++number) parts.push_back(part_path(path, number));
  std::error_code error;
  if (std::filesystem::exists(path, error)) parts.push_back(path);
  return parts;
}

Result<AuditHead> audit_head(const std::filesystem::path& path) {
  const auto parts = audit_parts(path);
  // A file that has just been begun has no line yet.
  for (auto part = parts.rbegin(); part != parts.rend(); ++part) {
    auto head = head_of(*part);
    if (!head || head->entries > 0 || std::next(part) == parts.rend()) return head;
  }
  return fail(ErrorCode::NotFound, fmt::format("cannot read the audit log {}", path.string()));
}

Result<AuditHead> check_audit_log(const std::filesystem::path& path) {
  const auto parts = audit_parts(path);
  if (parts.empty()) return fail(ErrorCode::NotFound, fmt::format("cannot read the audit log {}", path.string()));
  Chain chain;
  for (const auto& part : parts) {
    std::uint64_t size = 0;
    const auto whole = chain.follow_file(part, size);
    if (!whole) return tl::unexpected{whole.error()};
    if (*whole < size && part != parts.back())
      return fail(ErrorCode::NotTrusted, fmt::format("the part {} of an audit log ends within a line", part.string()));
  }
  return AuditHead{chain.next - 1, chain.last};
}

}  // namespace telefab
