// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>

namespace telefab {

/// Every key of machine, resin and print files as a page in Markdown: unit, range, default and meaning, made of the
/// tables that reading and writing go by. Same program, same bytes.
[[nodiscard]] std::string profile_reference();

}  // namespace telefab
