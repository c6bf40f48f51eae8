// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <telefab/base/digest.hpp>
#include <telefab/geometry/layer.hpp>
#include <vector>

namespace telefab {

/// How contours are written. Numbers go to disk and over the wire: never renumber.
enum class Coding : std::uint32_t {
  // 1 to 4 were earlier forms. 5 and 6 are still read: Exact and Curve with certificates in words.
  ExactInWords = 5,
  CurveInWords = 6,
  Exact = 7,  ///< the slicer's vertices on a grid of pixel pitch / 16
  Curve = 8,  ///< the curve within a stated error: contours as those of the layer below, moved
};

struct CodecOptions {
  Coding coding = Coding::Curve;
  std::uint32_t layers_per_chunk = 64;  ///< [1, 64]; each chunk begins with a key layer; a loss costs at most one chunk
  double total_error_pitch = 0.065;  ///< (chord_error_pitch, 1]; Curve: largest distance to the true section, both ways
  double chord_error_pitch = 0.025;  ///< [0, 1); what the slicer's chords have used of it: its chord tolerance
  [[nodiscard]] Result<void> validate() const;
};

/// Some layers in a row, decodable alone.
struct Chunk {
  std::uint32_t sequence = 0;  ///< 0, 1, 2, ... within the stack
  LayerIndex first_layer;
  std::uint32_t layer_count = 0;
  std::vector<std::byte> payload;
  friend bool operator==(const Chunk&, const Chunk&) = default;
};

/// Whether an earlier release wrote the chunk, with certificates in words: what is decoded then has another stack
/// digest than the one stated. The chain vouches for its bytes.
[[nodiscard]] bool is_of_earlier_release(const Chunk& chunk);

/// SHA-256 chained over header and chunks: chain 0 is the digest of the header's canonical text, chain n+1 that of
/// chain n, the chunk's numbers and its payload. Equal chains, equal streams.
class ChunkChain {
 public:
  explicit ChunkChain(const StackHeader& header);
  /// Takes the next chunk in and returns the chain behind it.
  Digest add(const Chunk& chunk);
  [[nodiscard]] const Digest& value() const { return value_; }

 private:
  Digest value_;
};

/// Turns layers, in order, into chunks. The same layers and options give the same bytes on every machine.
class StackEncoder {
 public:
  /// Fails with InvalidInput for a bad header or bad options.
  [[nodiscard]] static Result<StackEncoder> start(StackHeader header, const CodecOptions& options);
  StackEncoder(StackEncoder&&) noexcept;
  StackEncoder& operator=(StackEncoder&&) noexcept;
  ~StackEncoder();

  /// Takes the next layer; gives a chunk when one is full. Fails with InvalidInput for a layer out of order or outside
  /// the header's bounds, TooLarge for a layer that does not fit a chunk.
  /// What contours rest on is kept: every decoded edge says the gravest of what lies beside it.
  /// A ring that has no area left on the grid is left out, and the layer's certificate says so; so it does where the
  /// contours of a certified layer cross or nest wrongly.
  [[nodiscard]] Result<std::optional<Chunk>> add(const Layer& layer);
  /// Gives the last, shorter chunk if there is one. Fails with InvalidInput where layers are missing.
  [[nodiscard]] Result<std::optional<Chunk>> finish();

  /// The layers of the chunk last given, as every decoder sees them. Valid until the next call.
  [[nodiscard]] std::span<const Layer> coded_layers() const;
  /// Largest distance, both ways, between what was given and what is decoded, in pixel pitches; chords not included.
  [[nodiscard]] double worst_error_pitch() const;
  /// digest_of the stack as decoded; complete after finish().
  [[nodiscard]] Digest stack_digest() const;

 private:
  struct State;
  explicit StackEncoder(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Turns chunks back into layers. Stateless between chunks. Safe on hostile bytes: every count is checked before memory
/// is taken, every vertex lies inside the header's bounds, the whole payload is consumed; contours of a layer that says
/// it is certified do not cross, and holes lie in outer rings.
class StackDecoder {
 public:
  /// Fails with InvalidInput for a bad header.
  [[nodiscard]] static Result<StackDecoder> start(StackHeader header);
  /// Fails with ProtocolBroken and names chunk and layer.
  [[nodiscard]] Result<std::vector<Layer>> decode(const Chunk& chunk) const;
  [[nodiscard]] const StackHeader& header() const { return header_; }

 private:
  explicit StackDecoder(StackHeader header) : header_{std::move(header)} {}
  StackHeader header_;
};

}  // namespace telefab
