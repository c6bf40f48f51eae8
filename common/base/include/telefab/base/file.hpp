// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab {

/// The failure of a call of the system, by its errno: "cannot ACTION PATH: ...", with what to do. NotFound,
/// NotPermitted, StorageFailed.
[[nodiscard]] tl::unexpected<Error> fail_system(std::string_view action, const std::filesystem::path& path, int error);

/// Reads a whole regular file. The messages name the path and say what to do.
/// Fails: NotFound, NotPermitted, InvalidInput (a directory, a device), TooLarge (above limit), StorageFailed.
[[nodiscard]] Result<std::vector<std::byte>> read_file(const std::filesystem::path& path, std::uint64_t limit_bytes);

/// The file holds the old bytes or all of the new ones, never a part: temporary file beside it, fsync, rename,
/// fsync of the folder. Fails: NotPermitted, NotFound (the folder), StorageFailed (disk full); leaves nothing behind.
[[nodiscard]] Result<void> write_file_atomically(const std::filesystem::path& path, std::span<const std::byte> bytes);
[[nodiscard]] Result<void> write_file_atomically(const std::filesystem::path& path, std::string_view text);

/// Makes a file that only this user can read, not even for a moment anybody else. Fails with StorageFailed, also where
/// the file is there already.
[[nodiscard]] Result<void> write_new_secret(const std::filesystem::path& path, std::string_view text);

/// The name of a temporary file beside `path`, for writers that need a path of their own; the file exists, empty.
/// Ends in put_in_place, or in being removed. Fails as write_file_atomically.
[[nodiscard]] Result<std::filesystem::path> make_temporary_beside(const std::filesystem::path& path);
/// Gives `temporary`, closed and complete, the name `path`: fsync, rename, fsync of the folder. `path` holds its old
/// bytes or all of the new ones. Fails as write_file_atomically; the temporary file is gone either way.
[[nodiscard]] Result<void> put_in_place(const std::filesystem::path& temporary, const std::filesystem::path& path);

/// Writes a file whose name nobody looks at yet; not synced. For folders that are renamed into place after
/// sync_file_system. Fails as write_file_atomically; leaves a part behind.
[[nodiscard]] Result<void> write_new_file(const std::filesystem::path& path, std::span<const std::byte> bytes);
/// The name of a file that was made or renamed outlives a loss of power: fsync of the folder it lies in. Fails as
/// write_file_atomically.
[[nodiscard]] Result<void> sync_folder_of(const std::filesystem::path& file);
/// Everything written to the file system of `path` is on disk when this returns.
[[nodiscard]] Result<void> sync_file_system(const std::filesystem::path& path);

}  // namespace telefab
