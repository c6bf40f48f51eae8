// SPDX-License-Identifier: GPL-3.0-or-later
#include "platforms.hpp"

#include <telefab/base/file.hpp>
#include <telefab/service/data_folder.hpp>

namespace telefab::fab {

Result<std::optional<std::string>> Platforms::part_on(const std::string& machine) const {
  constexpr std::uint64_t kLongestName = 4096;
  const auto bytes = read_file(folder_ / machine, kLongestName);
  if (!bytes && bytes.error().code == ErrorCode::NotFound) return std::optional<std::string>{};
  if (!bytes) return fail_in("whether the platform is empty", bytes.error());
  std::string job{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
  while (job.ends_with('\n')) job.pop_back();
  if (job.empty()) return std::optional<std::string>{};
  return std::optional{std::move(job)};
}

Result<void> Platforms::occupy(const std::string& machine, const std::string& job) const {
  if (auto made = make_folder(folder_); !made) return made;
  return write_file_atomically(folder_ / machine, job + "\n");
}

Result<void> Platforms::clear(const std::string& machine) const {
  return write_file_atomically(folder_ / machine, std::string_view{"\n"});
}

}  // namespace telefab::fab
