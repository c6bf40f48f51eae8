// SPDX-License-Identifier: GPL-3.0-or-later
#include "zip_reader.hpp"

#include <fmt/format.h>
#include <zip.h>

namespace telefab::fab {
namespace {

constexpr std::uint64_t kMostBytes = 1ULL << 30U;
constexpr std::uint64_t kAlwaysAllowed = 64ULL << 20U;
constexpr std::uint64_t kMostRatio = 200;

std::string text_of(zip_error_t& error) {
  std::string text = zip_error_strerror(&error);
  zip_error_fini(&error);
  return text;
}

}  // namespace

struct ZipReader::Archive {
  zip_t* zip = nullptr;
  std::uint64_t size = 0;
  ~Archive() {
    if (zip != nullptr) zip_discard(zip);
  }
};

ZipReader::ZipReader(std::unique_ptr<Archive> archive) : archive_{std::move(archive)} {}
ZipReader::~ZipReader() = default;
ZipReader::ZipReader(ZipReader&&) noexcept = default;
ZipReader& ZipReader::operator=(ZipReader&&) noexcept = default;

Result<ZipReader> ZipReader::open(std::span<const std::byte> bytes) {
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* source = zip_source_buffer_create(bytes.data(), bytes.size(), 0, &error);
  auto archive = std::make_unique<Archive>();
  archive->size = bytes.size();
  if (source != nullptr) archive->zip = zip_open_from_source(source, ZIP_RDONLY | ZIP_CHECKCONS, &error);
  if (archive->zip == nullptr) {
    if (source != nullptr) zip_source_free(source);
    return fail(ErrorCode::InvalidInput, fmt::format("not a readable zip archive: {}", text_of(error)));
  }
  zip_error_fini(&error);
  return ZipReader{std::move(archive)};
}

bool ZipReader::has(const std::string& name) const { return zip_name_locate(archive_->zip, name.c_str(), 0) >= 0; }

std::vector<std::string> ZipReader::names() const {
  std::vector<std::string> all;
  const zip_int64_t count = zip_get_num_entries(archive_->zip, 0);
  for (zip_int64_t i = 0; i < count; ++i)
    if (const char* name = zip_get_name(archive_->zip, static_cast<zip_uint64_t>(i), 0)) all.emplace_back(name);
  return all;
}

Result<std::string> ZipReader::entry(const std::string& name, std::uint64_t most) {
  zip_stat_t stat;
  zip_stat_init(&stat);
  if (zip_stat(archive_->zip, name.c_str(), 0, &stat) != 0)
    return fail(ErrorCode::NotFound, fmt::format("the archive has no {}", name));
  if ((stat.valid & ZIP_STAT_SIZE) == 0) return fail(ErrorCode::InvalidInput, fmt::format("{} has no size", name));
  if (stat.size > most)
    return fail(ErrorCode::TooLarge, fmt::format("{} unpacks to {} bytes; {} are read", name, stat.size, most));
  if (stat.size > kMostBytes || (stat.size > kAlwaysAllowed && stat.size / kMostRatio > archive_->size))
    return fail(ErrorCode::TooLarge,
                fmt::format("{} unpacks to {} bytes from an archive of {}; at most {} bytes and {} times its size are "
                            "read",
                            name, stat.size, archive_->size, kMostBytes, kMostRatio));
  zip_file_t* file = zip_fopen_index(archive_->zip, stat.index, 0);
  if (file == nullptr)
    return fail(ErrorCode::InvalidInput, fmt::format("cannot unpack {}: {}", name, zip_strerror(archive_->zip)));
  std::string text(stat.size, '\0');
  const zip_int64_t got = zip_fread(file, text.data(), stat.size);
  char beyond = 0;
  const bool more = got == static_cast<zip_int64_t>(stat.size) && zip_fread(file, &beyond, 1) > 0;
  // The end is read to, so that the checksum is compared.
  const bool damaged = zip_error_code_zip(zip_file_get_error(file)) != ZIP_ER_OK;
  zip_fclose(file);
  if (got != static_cast<zip_int64_t>(stat.size) || more || damaged)
    return fail(ErrorCode::InvalidInput,
                fmt::format("{} is damaged: it does not unpack to what the archive says", name));
  return text;
}

}  // namespace telefab::fab
