// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <span>
#include <string>
#include <telefab/base/result.hpp>

namespace telefab::fab {

/// Who a screen says it is: maker, product in hexadecimal, serial number and name, as "RHT 1234 0 QEMU Monitor";
/// without a name only the three. What no text may hold becomes "?". Fails with ProtocolBroken for bytes that are no
/// EDID, or whose checksum is wrong. Source: VESA E-EDID 1.4, base block.
[[nodiscard]] Result<std::string> edid_identity(std::span<const std::byte> edid);

}  // namespace telefab::fab
