// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <functional>
#include <stop_token>
#include <telefab/base/result.hpp>

namespace telefab {

/// link(2): 0, or the errno.
using LinkCall = std::function<int(const char* from, const char* to)>;

/// Gives a file a second name, without its bytes being there twice. False where that cannot be: the names lie on two
/// file systems, or theirs knows no second names, or has as many as it bears. `call`: the system's where it is empty.
/// Fails: NotFound, NotPermitted, StorageFailed (also where `to` is there).
[[nodiscard]] Result<bool> give_second_name(const std::filesystem::path& from, const std::filesystem::path& to,
                                            const LinkCall& call = {});

/// Copies a file under another name, which is whole and durable when this returns; nothing is left where it fails.
/// Fails: Cancelled, as write_file_atomically.
[[nodiscard]] Result<void> copy_whole(const std::filesystem::path& from, const std::filesystem::path& to,
                                      const std::stop_token& stop);

}  // namespace telefab
