// SPDX-License-Identifier: GPL-3.0-or-later
#include <zip.h>

#include <string_view>
#include <vector>

#include "sliced_checks.hpp"

// Any bytes as the entries of an archive, "NAME\nBYTES" each, a line of four equal signs between them: checksums of the
// archive hold, so that the search goes on behind them. Bytes that begin like an archive are one themselves.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::string_view kBetween = "\n====\n";
  std::string_view rest{reinterpret_cast<const char*>(data), size};
  if (rest.starts_with("PK")) {
    telefab::fab::check_sliced({reinterpret_cast<const std::byte*>(data), size});
    return 0;
  }
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* made = zip_source_buffer_create(nullptr, 0, 0, &error);
  zip_t* zip = zip_open_from_source(made, ZIP_TRUNCATE, &error);
  if (zip == nullptr) std::abort();
  zip_source_keep(made);
  while (!rest.empty()) {
    const auto end = rest.find(kBetween);
    const std::string_view entry = rest.substr(0, end);
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + kBetween.size());
    const auto line = entry.find('\n');
    if (line == 0 || line == std::string_view::npos || line > 200) continue;
    const std::string name{entry.substr(0, line)};
    zip_source_t* source = zip_source_buffer(zip, entry.data() + line + 1, entry.size() - line - 1, 0);
    const zip_int64_t index = zip_file_add(zip, name.c_str(), source, 0);
    if (index < 0) {
      zip_source_free(source);
    } else {
      (void)zip_set_file_compression(zip, static_cast<zip_uint64_t>(index), ZIP_CM_STORE, 0);
    }
  }
  std::vector<std::byte> bytes;
  if (zip_close(zip) == 0) {
    zip_stat_t stat;
    zip_stat_init(&stat);
    if (zip_source_stat(made, &stat) == 0 && (stat.valid & ZIP_STAT_SIZE) != 0 && zip_source_open(made) == 0) {
      bytes.resize(stat.size);
      (void)zip_source_read(made, bytes.data(), bytes.size());
      (void)zip_source_close(made);
    }
  } else {
    zip_discard(zip);
  }
  zip_source_free(made);
  telefab::fab::check_sliced(bytes);
  return 0;
}
