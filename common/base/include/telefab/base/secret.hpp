// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab {

/// Reads a private key or another secret. Fails as read_file does, and with NotTrusted, saying what to do, where users
/// other than its owner and this process's own group may read or change it.
[[nodiscard]] Result<std::string> read_secret(const std::filesystem::path& path);
/// The same judgement alone, for what a library reads itself.
[[nodiscard]] Result<void> check_is_secret(const std::filesystem::path& path);

/// So many random bytes of the system's, in hexadecimal. Internal: it has none.
[[nodiscard]] Result<std::string> random_hex(std::size_t bytes);

/// Writes a secret in the place of the one before: the file holds all of the old or all of the new, and nobody but its
/// owner can read either. Root's belong to the owner of the folder, whose daemon is to read them. One writer at a time.
/// Fails with NotPermitted, StorageFailed.
[[nodiscard]] Result<void> write_secret(const std::filesystem::path& path, std::string_view text);

}  // namespace telefab
