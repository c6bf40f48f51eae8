// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>

namespace telefab {

/// True for well-formed UTF-8 that only shows: no control character (C0, DEL, C1), no line or paragraph separator, and
/// none of the marks that reorder what is written (bidirectional controls). Such a text cannot steer a terminal, forge
/// a line of a log, or look like another one.
[[nodiscard]] bool is_printable(std::string_view text);

/// The text with a space for every line break and tab, and one '?' for every other thing is_printable refuses. For what
/// comes from a file, a peer or a browser and will be shown to people.
[[nodiscard]] std::string to_printable(std::string_view text);

/// A plain file name: printable UTF-8 of 1 to 255 bytes, no folder, no leading dot.
[[nodiscard]] bool is_file_name(std::string_view text);

}  // namespace telefab
