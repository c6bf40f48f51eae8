// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string_view>

namespace telefab::fab {

/// How the names of files end that a fab makes jobs of, in lower case and with the dot: the one list for the page, the
/// API and the programs that send files. Whether the content is what the name says is judged by whoever reads it.
[[nodiscard]] std::span<const std::string_view> accepted_endings();

}  // namespace telefab::fab
