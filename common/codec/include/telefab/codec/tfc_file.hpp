// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <telefab/codec/stack_codec.hpp>

namespace telefab {

/// Takes the next bytes of a file or stream.
using ByteSink = std::function<Result<void>(std::span<const std::byte>)>;

/// Writes a .tfc file, the contour stream at rest, layer by layer. Format: common/codec/README.md.
class TfcWriter {
 public:
  /// Writes magic and header. Fails as StackEncoder::start and the sink do.
  [[nodiscard]] static Result<TfcWriter> start(StackHeader header, const CodecOptions& options, ByteSink sink);
  /// Fails as StackEncoder::add and the sink do.
  [[nodiscard]] Result<void> add(const Layer& layer);
  /// Writes the last chunk and the end record with both digests; returns the digest of the stack as decoded.
  [[nodiscard]] Result<Digest> finish();

 private:
  TfcWriter(StackEncoder encoder, ChunkChain chain, ByteSink sink)
      : encoder_{std::move(encoder)}, chain_{std::move(chain)}, sink_{std::move(sink)} {}
  [[nodiscard]] Result<void> write(const Chunk& chunk);

  StackEncoder encoder_;
  ChunkChain chain_;
  ByteSink sink_;
  std::uint32_t chunks_ = 0;
};

/// The bytes of a .tfc file of a whole stack.
[[nodiscard]] Result<std::vector<std::byte>> write_tfc(const LayerStack& stack, const CodecOptions& options);

/// The bytes of a .tfc file of chunks that exist already, from the first on, and of the digest of what they decode to:
/// nothing is coded, and so rounded, once more.
[[nodiscard]] std::vector<std::byte> tfc_of(const StackHeader& header, std::span<const Chunk> chunks,
                                            const Digest& stack);

/// Whether bytes begin as a .tfc file does, one whose line ends were translated on its way included.
[[nodiscard]] bool is_tfc(std::span<const std::byte> bytes);

/// Reads a .tfc file back. Fails with InvalidInput: not a .tfc file, truncated, damaged (checksum, digest), a layer
/// that breaks its bounds; the message says which record and at which byte.
[[nodiscard]] Result<LayerStack> read_tfc(std::span<const std::byte> bytes);

}  // namespace telefab
