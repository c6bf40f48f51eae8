// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <vector>

namespace telefab::scan {

/// Expands LZF (the compression of PCD's binary_compressed): runs of literals and back references, no header.
/// Nothing unless exactly `size` bytes come out. An LZF byte pair yields at most 264 bytes, so a claim above that is
/// refused before memory is taken.
[[nodiscard]] std::optional<std::vector<std::byte>> expand_lzf(std::span<const std::byte> packed, std::size_t size);

}  // namespace telefab::scan
