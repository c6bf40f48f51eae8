// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/slicing/slice_part.hpp>

#include "part_fields.hpp"
#include "recorded_slicing.hpp"

namespace telefab::scan {

/// Changes with what is written, and with it the digest of every slicing: parts of another form are found by nobody.
inline constexpr std::uint32_t kPartForm = 1;

/// What a part begins with: its layers follow.
struct PartHead {
  PartKey key;
  CodecOptions codec;
  LayerRange range;
  SliceReport known;  ///< before the first layer; the same in every part of a slicing
};
void write_head(const PartHead& head, ArchiveWriter& to);
/// The bytes with their digest behind them.
[[nodiscard]] std::vector<std::byte> with_seal(std::vector<std::byte> bytes);

/// A part whose digest holds, its layers yet to be read.
struct OpenPart {
  PartHead head;
  Digest known;   ///< of the bytes of head.codec and head.known
  Digest digest;  ///< of all
  ArchiveReader layers;
};
/// Fails: InvalidInput (not a part, or of another form), NotTrusted (damaged). `bytes` outlive what is returned.
[[nodiscard]] Result<OpenPart> open_part(std::span<const std::byte> bytes);

}  // namespace telefab::scan
