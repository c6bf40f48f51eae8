// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/base/damaged_file.hpp>
#include <telefab/base/file.hpp>

namespace telefab {
namespace {

constexpr int kMostDamaged = 1000;

tl::unexpected<Error> cannot_keep(const std::filesystem::path& path, std::string_view why) {
  return fail(ErrorCode::StorageFailed, fmt::format("{} is damaged and cannot be kept aside: {}", path.string(), why));
}

}  // namespace

Result<std::filesystem::path> name_for_damaged(const std::filesystem::path& path) {
  std::error_code error;
  for (int number = 1; number <= kMostDamaged; ++number) {
    std::filesystem::path name = fmt::format("{}.damaged-{}", path.string(), number);
    const auto there = std::filesystem::symlink_status(name, error);
    if (there.type() == std::filesystem::file_type::not_found) return name;
    if (error) return cannot_keep(path, error.message());
  }
  return cannot_keep(path, "too many are");
}

Result<std::filesystem::path> copy_damaged(const std::filesystem::path& path) {
  auto name = name_for_damaged(path);
  if (!name) return name;
  const auto copy = make_temporary_beside(*name);
  if (!copy) return tl::unexpected{copy.error()};
  std::error_code error;
  std::filesystem::copy_file(path, *copy, std::filesystem::copy_options::overwrite_existing, error);
  if (error) {
    std::error_code ignored;  // the reason is the error that is told
    std::filesystem::remove(*copy, ignored);
    return cannot_keep(path, error.message());
  }
  if (auto placed = put_in_place(*copy, *name); !placed) return tl::unexpected{placed.error()};
  return name;
}

}  // namespace telefab
