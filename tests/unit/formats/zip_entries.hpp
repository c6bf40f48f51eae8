// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <zip.h>

#include <filesystem>
#include <map>
#include <stdexcept>
#include <string>

namespace telefab::test {

/// Every entry of an archive by libzip itself, checksums compared. Throws where libzip complains.
[[nodiscard]] inline std::map<std::string, std::string> zip_entries(const std::filesystem::path& path) {
  int code = 0;
  zip_t* zip = zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, &code);
  if (zip == nullptr) throw std::runtime_error("libzip does not open it");
  std::map<std::string, std::string> entries;
  for (zip_int64_t i = 0; i < zip_get_num_entries(zip, 0); ++i) {
    zip_stat_t stat;
    zip_stat_index(zip, static_cast<zip_uint64_t>(i), 0, &stat);
    std::string bytes(stat.size, '\0');
    zip_file_t* file = zip_fopen_index(zip, static_cast<zip_uint64_t>(i), 0);
    if (file == nullptr || zip_fread(file, bytes.data(), bytes.size()) != static_cast<zip_int64_t>(bytes.size()))
      throw std::runtime_error(stat.name);
    if (zip_fclose(file) != 0) throw std::runtime_error(std::string{"checksum of "} + stat.name);
    entries[stat.name] = std::move(bytes);
  }
  zip_discard(zip);
  return entries;
}

}  // namespace telefab::test
