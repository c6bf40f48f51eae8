// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace telefab {

/// Deflates the filtered rows of an image (each led by its filter number, 0) as one zlib stream, looking only for what
/// masks are made of: bytes that repeat, and bytes that stand in the row above as well. One block, codes of its own.
/// Same rows, same bytes. Nothing where the rows are not like that (more than one token in three bytes), so that
/// general compression does better; then a part of the rows has been looked at in vain.
/// Cost: one pass over the rows, at the speed of memory where they are blank.
[[nodiscard]] std::optional<std::vector<std::byte>> deflate_runs(std::span<const std::uint8_t> pixels,
                                                                 std::size_t row_bytes);

}  // namespace telefab
