// SPDX-License-Identifier: GPL-3.0-or-later
#include "zip_writer.hpp"

#include <fmt/format.h>
#include <zip.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <list>
#include <optional>
#include <telefab/base/file.hpp>

namespace telefab::fab {
namespace {

/// One entry as libzip asks for it: stat, open, read to the end, close. The bytes live from stat to close.
struct Entry {
  EntryMaker maker;
  std::vector<std::byte> bytes;
  std::size_t read = 0;
  bool made = false;
  zip_error_t error{};
  std::optional<Error>* failure = nullptr;  ///< of the archive; the first one stays

  bool make() {
    if (made) return true;
    auto result = maker();
    if (!result) {
      if (!*failure) *failure = std::move(result.error());
      zip_error_set(&error, ZIP_ER_READ, EIO);
      return false;
    }
    bytes = std::move(*result);
    made = true;
    return true;
  }
};

zip_int64_t serve_entry(void* state, void* data, zip_uint64_t length, zip_source_cmd_t command) {
  auto& entry = *static_cast<Entry*>(state);
  switch (command) {
    case ZIP_SOURCE_STAT: {
      if (!entry.make()) return -1;
      auto* stat = static_cast<zip_stat_t*>(data);
      zip_stat_init(stat);
      stat->size = entry.bytes.size();
      stat->comp_size = entry.bytes.size();
      stat->comp_method = ZIP_CM_STORE;
      stat->valid = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
      return sizeof(zip_stat_t);
    }
    case ZIP_SOURCE_OPEN:
      entry.read = 0;
      return entry.make() ? 0 : -1;
    case ZIP_SOURCE_READ: {
      const std::size_t count = std::min<std::size_t>(length, entry.bytes.size() - entry.read);
      if (count != 0) std::memcpy(data, entry.bytes.data() + entry.read, count);
      entry.read += count;
      return static_cast<zip_int64_t>(count);
    }
    case ZIP_SOURCE_CLOSE:
      std::vector<std::byte>{}.swap(entry.bytes);
      entry.made = false;
      return 0;
    case ZIP_SOURCE_ERROR:
      return zip_error_to_data(&entry.error, data, length);
    case ZIP_SOURCE_FREE:
      return 0;
    case ZIP_SOURCE_SUPPORTS:
      return zip_source_make_command_bitmap(ZIP_SOURCE_STAT, ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE,
                                            ZIP_SOURCE_ERROR, ZIP_SOURCE_FREE, -1);
    default:
      zip_error_set(&entry.error, ZIP_ER_OPNOTSUPP, 0);
      return -1;
  }
}

constexpr zip_uint16_t kFirstDay = (1U << 5U) | 1U;  // 1 January 1980, in DOS's way
constexpr zip_uint32_t kDeflateLevel = 6;

}  // namespace

struct ZipWriter::Archive {
  std::filesystem::path path;
  std::filesystem::path temporary;
  zip_t* zip = nullptr;
  std::list<Entry> entries;  ///< libzip keeps pointers to them
  std::optional<Error> failure;

  ~Archive() {
    if (zip != nullptr) zip_discard(zip);
    std::error_code ignored;  // an empty file beside the place; there is nobody left to tell
    if (!temporary.empty()) std::filesystem::remove(temporary, ignored);
  }
  [[nodiscard]] tl::unexpected<Error> broken(zip_error_t& error) const {
    if (zip_error_system_type(&error) == ZIP_ET_SYS) return fail_system("write", path, zip_error_code_system(&error));
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot write {}: {}", path.string(), zip_error_strerror(&error)));
  }
  [[nodiscard]] tl::unexpected<Error> broken() const { return broken(*zip_get_error(zip)); }
};

ZipWriter::ZipWriter(std::unique_ptr<Archive> archive) : archive_{std::move(archive)} {}
ZipWriter::~ZipWriter() = default;
ZipWriter::ZipWriter(ZipWriter&&) noexcept = default;
ZipWriter& ZipWriter::operator=(ZipWriter&&) noexcept = default;

Result<ZipWriter> ZipWriter::create(std::filesystem::path path) {
  auto temporary = make_temporary_beside(path);
  if (!temporary) return tl::unexpected{temporary.error()};
  auto archive = std::make_unique<Archive>();
  archive->path = std::move(path);
  archive->temporary = std::move(*temporary);
  int code = 0;
  archive->zip = zip_open(archive->temporary.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code);
  if (archive->zip == nullptr) {
    zip_error_t error;
    zip_error_init_with_code(&error, code);
    auto failed = archive->broken(error);
    zip_error_fini(&error);
    return failed;
  }
  return ZipWriter{std::move(archive)};
}

Result<void> ZipWriter::add(const std::string& name, std::string_view text, Packing packing) {
  const auto bytes = std::as_bytes(std::span{text});
  return add(
      name,
      [kept = std::vector<std::byte>(bytes.begin(), bytes.end())]() -> Result<std::vector<std::byte>> { return kept; },
      packing);
}

Result<void> ZipWriter::add(const std::string& name, EntryMaker maker, Packing packing) {
  Entry& entry = archive_->entries.emplace_back();
  entry.maker = std::move(maker);
  entry.failure = &archive_->failure;
  zip_source_t* source = zip_source_function(archive_->zip, &serve_entry, &entry);
  if (source == nullptr) return archive_->broken();
  const zip_int64_t index = zip_file_add(archive_->zip, name.c_str(), source, ZIP_FL_ENC_UTF_8);
  if (index < 0) {
    zip_source_free(source);
    return archive_->broken();
  }
  const auto at = static_cast<zip_uint64_t>(index);
  const zip_int32_t method = packing == Packing::Stored ? ZIP_CM_STORE : ZIP_CM_DEFLATE;
  if (zip_set_file_compression(archive_->zip, at, method, packing == Packing::Stored ? 0 : kDeflateLevel) != 0 ||
      zip_file_set_dostime(archive_->zip, at, 0, kFirstDay, 0) != 0)
    return archive_->broken();
  return {};
}

Result<void> ZipWriter::finish(WorkStage stage, const ProgressSink& progress, std::stop_token stop) {
  struct Watch {
    WorkStage stage;
    const ProgressSink& progress;
    std::stop_token stop;
  } watch{stage, progress, std::move(stop)};
  zip_register_progress_callback_with_state(
      archive_->zip, 0.001,
      [](zip_t*, double fraction, void* state) {
        const auto& w = *static_cast<Watch*>(state);
        report(w.progress, w.stage, fraction);
      },
      nullptr, &watch);
  zip_register_cancel_callback_with_state(
      archive_->zip, [](zip_t*, void* state) { return static_cast<Watch*>(state)->stop.stop_requested() ? 1 : 0; },
      nullptr, &watch);
  if (zip_close(archive_->zip) != 0) {
    if (archive_->failure) return tl::unexpected{*archive_->failure};
    if (watch.stop.stop_requested())
      return fail(ErrorCode::Cancelled,
                  fmt::format("writing {} was cancelled; nothing was written", archive_->path.string()));
    return archive_->broken();
  }
  archive_->zip = nullptr;
  const std::filesystem::path temporary = std::exchange(archive_->temporary, {});
  return put_in_place(temporary, archive_->path);
}

}  // namespace telefab::fab
