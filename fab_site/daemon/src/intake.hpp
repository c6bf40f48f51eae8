// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/codec/stack_codec.hpp>
#include <telefab/transfer/chunk_spool.hpp>
#include <telefab/wire/job_signature.hpp>
#include <telefab/wire/message.hpp>

#include <filesystem>
#include <functional>

namespace telefab::fab {

/// One job on its way in: its chunks on disk, every one decoded and checked before it is acknowledged, and the digest
/// of the layers so far. Threads: one caller at a time.
class Intake {
 public:
  /// Takes a decoded layer, bottom first.
  using LayerSink = std::function<void(const Layer&)>;

  /// A new job, or one whose folder holds chunks already, which are read and checked. The offer is kept in the folder.
  /// Conflict where the folder holds another offer. `sink`, if any, gets every layer, those that are here already
  /// first; none of a job that is complete.
  [[nodiscard]] static Result<Intake> open(const std::filesystem::path& folder, const Offer& offer,
                                           LayerSink sink = {});
  /// Of a job that was offered before; NotFound where it was not.
  [[nodiscard]] static Result<Intake> reopen(const std::filesystem::path& folder, LayerSink sink = {});

  [[nodiscard]] const Offer& offer() const { return offer_; }
  [[nodiscard]] const ChunkSpool& spool() const { return spool_; }
  [[nodiscard]] std::uint32_t next_sequence() const { return spool_.chunk_count(); }
  /// All layers are here; the end may be missing.
  [[nodiscard]] bool is_whole() const { return spool_.finished().has_value(); }
  /// All layers are here, and of a signed job its signed end.
  [[nodiscard]] bool is_complete() const { return spool_.finished().has_value() && (!is_signed(offer_) || has_end_); }
  /// Durable when it returns. A chunk that is here already and equal is fine. ProtocolBroken (gap, layers that do not
  /// decode or leave the bounds), NotTrusted (chain), StorageFailed.
  [[nodiscard]] Result<void> take(const SendChunk& chunk);
  /// NotTrusted where count, chain or digest of the decoded layers differ, or the end of a signed job is not signed
  /// with the same key. The end is kept in the folder.
  [[nodiscard]] Result<void> finish(const StackEnd& end);

 private:
  Intake(std::filesystem::path folder, Offer offer, ChunkSpool spool, StackDecoder decoder, LayerSink sink)
      : folder_{std::move(folder)},
        offer_{std::move(offer)},
        spool_{std::move(spool)},
        decoder_{std::move(decoder)},
        sink_{std::move(sink)} {}
  [[nodiscard]] Result<void> feed(const Chunk& chunk);

  std::filesystem::path folder_;
  Offer offer_;
  ChunkSpool spool_;
  StackDecoder decoder_;
  Hasher hasher_;
  LayerSink sink_;
  bool has_end_ = false;
};

/// A complete job.
struct ReceivedStack {
  LayerStack layers;
  std::vector<Chunk> chunks;  ///< as they came, of all layers
  Digest digest;              ///< of the layers, as the scan site stated it

  /// Of the chunks' payloads.
  [[nodiscard]] std::uint64_t bytes() const;
  /// A .tfc file of the chunks as they came.
  [[nodiscard]] std::vector<std::byte> tfc() const;
};
/// All of a complete job, its digest and its signatures checked again. Fails where the saved offer or the chunks cannot
/// be read, and with NotTrusted where the layers are not those that were sent, or not all of them.
[[nodiscard]] Result<ReceivedStack> received_stack(const std::filesystem::path& folder);

}  // namespace telefab::fab
