// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::fab::goo {

/// One layer's pixels, row by row, as the format packs them: 0x55, chunks, checksum.
[[nodiscard]] std::vector<std::byte> pack(std::span<const std::uint8_t> pixels);

/// The pixels again, exactly `count` of them. Fails with InvalidInput and the byte: not begun by 0x55, a checksum that
/// does not hold, a chunk cut off, a run of nothing, a difference below 0 or above 255, more pixels than the frame has
/// or fewer. Takes memory for `count` pixels, which the caller has bounded.
[[nodiscard]] Result<std::vector<std::uint8_t>> unpack(std::span<const std::byte> data, std::size_t count);

}  // namespace telefab::fab::goo
