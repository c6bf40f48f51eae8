// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <telefab/base/digest.hpp>
#include <telefab/base/quantity.hpp>
#include <vector>

namespace telefab {

/// A piece of a coded layer stack as it lies on disk and crosses the wire.
struct SpooledChunk {
  std::uint32_t sequence = 0;
  LayerIndex first_layer;
  std::uint32_t layer_count = 0;
  std::vector<std::byte> payload;
  Digest chain;  ///< over this chunk and all before it
  friend bool operator==(const SpooledChunk&, const SpooledChunk&) = default;
};

/// chain(n) = SHA-256(chain(n-1), sequence, first layer, layer count, payload), integers as 4 bytes little-endian;
/// before the first chunk it is 32 zero bytes. So a chunk dropped, swapped, repeated or taken from another job shows.
[[nodiscard]] Digest chain_after(const Digest& before, std::uint32_t sequence, LayerIndex first_layer,
                                 std::uint32_t layer_count, std::span<const std::byte> payload);

/// The chunks of one job in one append-only file. What append() has answered survives kill -9 and loss of power; a torn
/// tail is cut off at the next opening; a damaged file is kept aside as PATH.damaged-N, and the spool goes on behind
/// its sound chunks, so that the other site sends the rest again. Layers follow each other without gap. Threads: one
/// caller at a time.
class ChunkSpool {
 public:
  /// Makes the file where there is none. Every record is read and checked. Fails with NotPermitted, StorageFailed,
  /// NotTrusted (a record in the middle is damaged: the file was changed; the message names it).
  [[nodiscard]] static Result<ChunkSpool> open(const std::filesystem::path& path);
  /// To be read alone, from a file that is there: the heads of the records are walked, a few bytes a chunk, and a chunk
  /// is checked when it is read. What does not follow is not seen; nothing is cut off and nothing can be added. Fails:
  /// NotFound, NotPermitted, StorageFailed.
  [[nodiscard]] static Result<ChunkSpool> look_into(const std::filesystem::path& path);
  ~ChunkSpool();
  ChunkSpool(ChunkSpool&&) noexcept;
  ChunkSpool& operator=(ChunkSpool&&) noexcept;

  [[nodiscard]] std::uint32_t chunk_count() const;
  [[nodiscard]] std::uint32_t layer_count() const;
  [[nodiscard]] std::uint64_t payload_bytes() const;
  /// After the last chunk.
  [[nodiscard]] Digest chain() const;
  /// Returns the chain once the chunk is durable. InvalidInput unless it begins at layer_count(); Conflict once
  /// finished; StorageFailed.
  [[nodiscard]] Result<Digest> append(LayerIndex first_layer, std::uint32_t layer_count,
                                      std::span<const std::byte> payload);
  /// The chunk that the layer is in. NotFound: it is in none yet.
  [[nodiscard]] Result<std::uint32_t> sequence_of(LayerIndex layer) const;
  /// NotFound above the last; StorageFailed; NotTrusted where the bytes have changed.
  [[nodiscard]] Result<SpooledChunk> read(std::uint32_t sequence) const;
  /// No chunk comes after this; remembers the digest of the decoded stack. Conflict if finished with another one.
  [[nodiscard]] Result<void> finish(const Digest& stack);
  [[nodiscard]] const std::optional<Digest>& finished() const;
  /// Where the file was kept that was found damaged at this opening; nothing: it was not.
  [[nodiscard]] const std::optional<std::filesystem::path>& damaged() const;

 private:
  struct Impl;
  explicit ChunkSpool(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace telefab
