// SPDX-License-Identifier: GPL-3.0-or-later
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/open_file.hpp>
#include <telefab/base/text.hpp>
#include <telefab/transfer/upload_store.hpp>

namespace telefab {
namespace {

constexpr const char* kAbout = "about.json";
constexpr const char* kPart = "part";
constexpr const char* kScan = "scan";
constexpr std::uint64_t kMostAbout_bytes = 64U << 10U;
constexpr std::size_t kBlock_bytes = 1U << 20U;
/// Half of the digest tells files apart; the whole of it is compared.
constexpr std::size_t kIdDigits = 32;

constexpr std::array<std::string_view, 4> kStates{"receiving", "checking", "whole", "refused"};

std::string id_of(const Digest& content) { return to_hex(content).substr(0, kIdDigits); }

Result<void> write_at(const std::filesystem::path& path, std::uint64_t from, std::span<const std::byte> bytes) {
  const OpenFile file{::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600)};
  if (file.get() < 0) return fail_system("keep an upload in", path, errno);
  // What a write that failed half way left behind is not counted, and is written over.
  std::uint64_t at = from;
  while (!bytes.empty()) {
    const ssize_t n = ::pwrite(file.get(), bytes.data(), bytes.size(), static_cast<off_t>(at));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      const int error = errno;
      (void)!::ftruncate(file.get(), static_cast<off_t>(from));  // it is cut again at the next part
      return fail_system("keep an upload in", path, error);
    }
    bytes = bytes.subspan(static_cast<std::size_t>(n));
    at += static_cast<std::uint64_t>(n);
  }
  return {};
}

Result<Digest> digest_of_file(const std::filesystem::path& path, const std::stop_token& stop) {
  const OpenFile file{::open(path.c_str(), O_RDONLY | O_CLOEXEC)};
  if (file.get() < 0) return fail_system("read the upload", path, errno);
  Hasher hasher;
  std::vector<std::byte> block(kBlock_bytes);
  while (true) {
    if (stop.stop_requested()) return cancelled("checking an upload");
    const ssize_t n = ::read(file.get(), block.data(), block.size());
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return fail_system("read the upload", path, errno);
    if (n == 0) return hasher.digest();
    hasher.feed(std::span{block}.first(static_cast<std::size_t>(n)));
  }
}

std::string about_text(const UploadPlan& plan) {
  return json_text({{"name", plan.name},
                    {"size_bytes", plan.size_bytes},
                    {"sha256", to_hex(plan.content)},
                    {"owner", plan.owner}}) +
         "\n";
}

Result<UploadPlan> plan_in(const std::filesystem::path& folder) {
  const auto bytes = read_file(folder / kAbout, kMostAbout_bytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  UploadPlan plan;
  try {
    const auto about = parsed_json({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
    plan.name = about.at("name").get<std::string>();
    plan.owner = about.at("owner").get<std::string>();
    plan.size_bytes = whole_number<std::uint64_t>(about.at("size_bytes"));
    const auto content = digest_from_hex(about.at("sha256").get<std::string>());
    if (!content) return tl::unexpected{content.error()};
    plan.content = *content;
  } catch (const nlohmann::ordered_json::exception& error) {
    return fail(ErrorCode::InvalidInput, fmt::format("{}: {}", (folder / kAbout).string(), error.what()));
  }
  if (!is_file_name(plan.name))
    return fail(ErrorCode::InvalidInput, fmt::format("{}: a name that is none", (folder / kAbout).string()));
  return plan;
}

}  // namespace

std::string_view name_of(UploadState state) { return kStates[static_cast<std::size_t>(state) - 1]; }

Result<std::unique_ptr<UploadStore>> UploadStore::open(std::filesystem::path folder, UploadLimits limits,
                                                       const Clock& clock) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return fail(ErrorCode::StorageFailed, fmt::format("cannot make {}: {}", folder.string(), error.message()));
  std::unique_ptr<UploadStore> store{new UploadStore{std::move(folder), limits, clock}};
  store->resume_unfinished();
  return store;
}

void UploadStore::resume_unfinished() {
  std::error_code error;
  std::vector<std::filesystem::path> useless;
  for (const auto& entry : std::filesystem::directory_iterator{folder_, error}) {
    const auto plan = plan_in(entry.path());
    const std::string id = entry.path().filename().string();
    if (!plan || id_of(plan->content) != id) {
      useless.push_back(entry.path());
      continue;
    }
    Upload upload{id, *plan, 0, UploadState::Receiving};
    const auto size_of = [&](const char* name) -> std::uint64_t {
      const auto size = std::filesystem::file_size(entry.path() / name, error);
      return error ? 0 : size;
    };
    if (size_of(kScan) == plan->size_bytes) {
      upload.received_bytes = plan->size_bytes;
      upload.state = UploadState::Whole;
    } else {
      upload.received_bytes = std::min<std::uint64_t>(size_of(kPart), plan->size_bytes);
      if (upload.received_bytes == plan->size_bytes) upload.state = UploadState::Checking;
    }
    uploads_.emplace(id, Kept{std::move(upload), clock_.now()});
  }
  for (const auto& path : useless) std::filesystem::remove_all(path, error);  // what stays is tried at the next start
}

Result<const UploadStore::Kept*> UploadStore::kept(std::string_view id) const {
  const auto found = uploads_.find(id);
  if (found == uploads_.end())
    return fail(
        ErrorCode::NotFound,
        fmt::format("there is no upload {}: it was discarded, or nobody has used it for "
                    "{:.0f} hours; send the file again",
                    to_printable(id), std::chrono::duration<double, std::ratio<3600>>(limits_.kept_for).count()));
  return &found->second;
}

Result<UploadStore::Kept*> UploadStore::kept(std::string_view id) {
  const auto there = std::as_const(*this).kept(id);
  if (!there) return tl::unexpected{there.error()};
  return &uploads_.find(id)->second;
}

Result<Upload> UploadStore::begin(const UploadPlan& plan) {
  if (!is_file_name(plan.name))
    return fail(ErrorCode::InvalidInput,
                "a file is named in 1 to 255 bytes, without folders, leading dots or characters that do not show; "
                "rename it");
  if (plan.size_bytes == 0) return fail(ErrorCode::InvalidInput, fmt::format("{} is empty", plan.name));
  if (plan.size_bytes > limits_.most_bytes)
    return fail(ErrorCode::TooLarge,
                fmt::format("{} has {} bytes; the limit is {}", plan.name, plan.size_bytes, limits_.most_bytes));
  const std::lock_guard lock{mutex_};
  const std::string id = id_of(plan.content);
  const auto found = uploads_.find(id);
  if (found != uploads_.end()) {
    Kept& there = found->second;
    if (there.upload.plan.size_bytes != plan.size_bytes || there.upload.plan.content != plan.content)
      return fail(ErrorCode::Conflict, fmt::format("{} of {} bytes is known with another digest or size; send it again",
                                                   plan.name, plan.size_bytes));
    there.touched = clock_.now();
    if (there.upload.state == UploadState::Refused) {
      there.upload.state = UploadState::Receiving;
      there.upload.received_bytes = 0;
    }
    if (there.upload.plan.name == plan.name) return there.upload;
    UploadPlan renamed = there.upload.plan;
    renamed.name = plan.name;
    if (auto written = write_file_atomically(folder_of(id) / kAbout, about_text(renamed)); !written)
      return tl::unexpected{written.error()};
    there.upload.plan = std::move(renamed);
    return there.upload;
  }
  if (uploads_.size() >= limits_.most_uploads)
    return fail(ErrorCode::TooLarge,
                fmt::format("{} uploads lie here already, the most there may be; discard one", limits_.most_uploads));
  std::error_code error;
  std::filesystem::create_directories(folder_of(id), error);
  if (error) return fail(ErrorCode::StorageFailed, fmt::format("cannot keep {}: {}", plan.name, error.message()));
  if (auto written = write_file_atomically(folder_of(id) / kAbout, about_text(plan)); !written) {
    std::filesystem::remove_all(folder_of(id), error);  // what stays is removed at the next start
    return tl::unexpected{written.error()};
  }
  const Upload upload{id, plan, 0, UploadState::Receiving};
  uploads_.emplace(id, Kept{upload, clock_.now()});
  return upload;
}

Result<Upload> UploadStore::append(std::string_view id, std::uint64_t from_bytes, std::span<const std::byte> part) {
  const std::lock_guard lock{mutex_};
  const auto there = kept(id);
  if (!there) return tl::unexpected{there.error()};
  Upload& upload = (*there)->upload;
  if (upload.state != UploadState::Receiving)
    return fail(ErrorCode::Conflict,
                fmt::format("{} is {}: no part is missing", upload.plan.name, name_of(upload.state)));
  if (from_bytes != upload.received_bytes)
    return fail(ErrorCode::Conflict,
                fmt::format("{} goes on at byte {}, not at {}", upload.plan.name, upload.received_bytes, from_bytes));
  if (part.size() > limits_.part_bytes)
    return fail(ErrorCode::TooLarge, fmt::format("a part has at most {} bytes", limits_.part_bytes));
  if (part.empty() || part.size() > upload.plan.size_bytes - upload.received_bytes)
    return fail(ErrorCode::InvalidInput, fmt::format("a part of {} bytes: {} are missing of {}", part.size(),
                                                     upload.plan.size_bytes - upload.received_bytes, upload.plan.name));
  if (auto written = write_at(folder_of(id) / kPart, from_bytes, part); !written)
    return tl::unexpected{written.error()};
  upload.received_bytes += part.size();
  if (upload.received_bytes == upload.plan.size_bytes) upload.state = UploadState::Checking;
  (*there)->touched = clock_.now();
  return upload;
}

Result<Upload> UploadStore::check(std::string_view id, std::stop_token stop) {
  auto before = find(id);
  if (!before || before->state == UploadState::Whole) return before;
  if (before->state != UploadState::Checking)
    return fail(ErrorCode::Conflict,
                fmt::format("{} is {}: it cannot be checked", before->plan.name, name_of(before->state)));
  // Nothing is appended to one that is complete, so the file is read outside of the lock.
  const auto path = folder_of(id) / kPart;
  const auto digest = digest_of_file(path, stop);
  const std::lock_guard lock{mutex_};
  const auto there = kept(id);
  if (!there) return tl::unexpected{there.error()};
  Upload& upload = (*there)->upload;
  if (upload.state != UploadState::Checking) return upload;  // somebody else was faster
  if (!digest) return tl::unexpected{digest.error()};
  if (*digest != upload.plan.content) {
    upload.state = UploadState::Refused;
    upload.received_bytes = 0;
    std::error_code ignored;  // written over by the next part
    std::filesystem::remove(path, ignored);
    return fail(ErrorCode::NotTrusted,
                fmt::format("{} did not arrive as it was announced; send it again", upload.plan.name));
  }
  if (auto placed = put_in_place(path, folder_of(id) / kScan); !placed) return tl::unexpected{placed.error()};
  upload.state = UploadState::Whole;
  (*there)->touched = clock_.now();
  return upload;
}

Result<Upload> UploadStore::find(std::string_view id) const {
  const std::lock_guard lock{mutex_};
  const auto there = kept(id);
  if (!there) return tl::unexpected{there.error()};
  return (*there)->upload;
}

std::vector<Upload> UploadStore::list() const {
  const std::lock_guard lock{mutex_};
  std::vector<Upload> all;
  for (const auto& [id, each] : uploads_) all.push_back(each.upload);
  return all;
}

Result<void> UploadStore::remove(std::string_view id) {
  const std::lock_guard lock{mutex_};
  if (const auto there = kept(id); !there) return tl::unexpected{there.error()};
  std::error_code error;
  std::filesystem::remove_all(folder_of(id), error);
  if (error) return fail(ErrorCode::StorageFailed, fmt::format("cannot remove upload {}: {}", id, error.message()));
  uploads_.erase(uploads_.find(id));
  return {};
}

Result<std::filesystem::path> UploadStore::file(std::string_view id) const {
  const auto upload = find(id);
  if (!upload) return tl::unexpected{upload.error()};
  if (upload->state != UploadState::Whole)
    return fail(ErrorCode::Conflict,
                fmt::format("{} is {}: {} of {} bytes are here", upload->plan.name, name_of(upload->state),
                            upload->received_bytes, upload->plan.size_bytes));
  return folder_of(id) / kScan;
}

void UploadStore::touch(std::string_view id) {
  const std::lock_guard lock{mutex_};
  if (const auto found = uploads_.find(id); found != uploads_.end()) found->second.touched = clock_.now();
}

std::vector<std::string> UploadStore::remove_outlived() {
  std::vector<std::string> old;
  {
    const std::lock_guard lock{mutex_};
    for (const auto& [id, each] : uploads_)
      if (clock_.now() - each.touched > limits_.kept_for) old.push_back(id);
  }
  // What cannot be removed now is tried at the next look.
  std::erase_if(old, [&](const std::string& id) { return !remove(id).has_value(); });
  return old;
}

std::uint64_t UploadStore::missing_bytes() const {
  const std::lock_guard lock{mutex_};
  std::uint64_t missing = 0;
  for (const auto& [id, each] : uploads_)
    if (each.upload.state == UploadState::Receiving || each.upload.state == UploadState::Refused)
      missing += each.upload.plan.size_bytes - each.upload.received_bytes;
  return missing;
}

}  // namespace telefab
