// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>

namespace telefab {

/// What a scan site reads, in one line for help and errors of every program. The readers are in scan_site/formats.
inline constexpr std::string_view kReadableScans = "PLY, PCD, PTX, E57, LAS, OFF, STL, OBJ or text";

}  // namespace telefab
