// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <telefab/base/result.hpp>

namespace telefab {

/// As md5_hex(), of a file of any size, in blocks. Fails: NotFound, NotPermitted, StorageFailed.
[[nodiscard]] Result<std::string> md5_of_file(const std::filesystem::path& path);

}  // namespace telefab
