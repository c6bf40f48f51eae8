// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <filesystem>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>

namespace telefab {

/// So long a link to a page signs in, once.
inline constexpr std::chrono::minutes kPageLinkLasts{10};

/// The key of a link for whoever may read a daemon's folder. It is given back and nowhere else: `file` keeps its digest
/// and when it ends. A key made before opens nothing any more. `wall`: now. Fails as write_secret; Internal: the system
/// has no random numbers.
[[nodiscard]] Result<std::string> make_page_key(const std::filesystem::path& file, Nanoseconds wall);

/// Takes a key that somebody shows; it opens nothing a second time, whoever asks and whatever ends meanwhile.
/// NotFound: no key was made, or it is used; NotTrusted: another key, too old, or others can read the file;
/// InvalidInput: the file is damaged; StorageFailed: it cannot be removed, so the key is not taken.
[[nodiscard]] Result<void> take_page_key(const std::filesystem::path& file, std::string_view key, Nanoseconds wall);

/// What is opened in a browser. `address`: as http://127.0.0.1:7480. The key stands behind "#", which no browser sends
/// on and no server logs.
[[nodiscard]] std::string page_link(std::string_view address, std::string_view key);

}  // namespace telefab
