// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/base/result.hpp>

namespace telefab {

/// The name under which a damaged file is kept: PATH.damaged-1, or the next number that nothing has yet. What was kept
/// before is never written over. Nothing is made; the caller, who alone writes in that folder, moves, links or copies.
/// Fails with StorageFailed: the folder cannot be read, or a thousand are there already.
[[nodiscard]] Result<std::filesystem::path> name_for_damaged(const std::filesystem::path& path);

/// A copy of the file under that name, durable when this returns: for who goes on in the file itself. The name. Fails
/// as name_for_damaged and write_file_atomically.
[[nodiscard]] Result<std::filesystem::path> copy_damaged(const std::filesystem::path& path);

}  // namespace telefab
