// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/wire/message.hpp>

namespace telefab {

// What both sites keep of a transfer beside its chunks, in the job's folder: the offer, and the end of the stack. Each
// is a message as it goes over the wire, alone in its file.

/// The file appears whole. Fails as write_file_atomically.
[[nodiscard]] Result<void> save_offer(const std::filesystem::path& folder, const Offer& offer);
[[nodiscard]] Result<void> save_end(const std::filesystem::path& folder, const StackEnd& end);

/// Fails: NotFound before it was saved, InvalidInput and ProtocolBroken for a file that holds something else.
[[nodiscard]] Result<Offer> saved_offer(const std::filesystem::path& folder);
[[nodiscard]] Result<StackEnd> saved_end(const std::filesystem::path& folder);

}  // namespace telefab
