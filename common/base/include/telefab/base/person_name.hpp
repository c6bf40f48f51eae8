// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <string_view>

namespace telefab {

/// Whether a text can name somebody to the programs, as a word of a line and as part of a file name: UTF-8 of 1 to
/// `most_bytes` bytes; of ASCII letters, digits and `marks` alone, beyond it letters of any script. Nothing that is
/// blank, invisible or turns what is written round, so that no two names look alike by that.
[[nodiscard]] bool is_person_name(std::string_view text, std::string_view marks, std::size_t most_bytes);

}  // namespace telefab
