// SPDX-License-Identifier: GPL-3.0-or-later
#include "intake.hpp"

#include <fmt/format.h>

#include <telefab/codec/tfc_file.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/wire/job_signature.hpp>

namespace telefab::fab {

Result<Intake> Intake::open(const std::filesystem::path& folder, const Offer& offer, LayerSink sink) {
  const Frame frame = to_frame(offer);
  if (std::filesystem::exists(folder / "offer")) {
    const auto before = saved_offer(folder);
    if (!before) return tl::unexpected{before.error()};
    if (to_frame(*before) != frame)
      return fail(ErrorCode::Conflict,
                  fmt::format("replayed-job: job {} is here already and is another one", offer.job));
  } else {
    if (auto saved = save_offer(folder, offer); !saved) return tl::unexpected{saved.error()};
  }
  return reopen(folder, std::move(sink));
}

Result<Intake> Intake::reopen(const std::filesystem::path& folder, LayerSink sink) {
  auto offer = saved_offer(folder);
  if (!offer) return tl::unexpected{offer.error()};
  auto decoder = StackDecoder::start(offer->header);
  if (!decoder) return tl::unexpected{decoder.error()};
  auto spool = ChunkSpool::open(folder / "chunks");
  if (!spool) return tl::unexpected{spool.error()};
  Intake intake{folder, std::move(*offer), std::move(*spool), std::move(*decoder), std::move(sink)};
  intake.hasher_.feed(canonical_text(intake.offer_.header));
  intake.has_end_ = saved_end(folder).has_value();
  if (intake.spool_.finished()) return intake;
  for (std::uint32_t sequence = 0; sequence < intake.spool_.chunk_count(); ++sequence) {
    const auto chunk = intake.spool_.read(sequence);
    if (!chunk) return tl::unexpected{chunk.error()};
    if (auto fed = intake.feed({chunk->sequence, chunk->first_layer, chunk->layer_count, chunk->payload}); !fed)
      return tl::unexpected{fed.error()};
  }
  return intake;
}

Result<void> Intake::feed(const Chunk& chunk) {
  const auto layers = decoder_.decode(chunk);
  if (!layers) return tl::unexpected{layers.error()};
  for (const Layer& layer : *layers) {
    hasher_.feed(canonical_text(layer));
    if (sink_) sink_(layer);
  }
  return {};
}

Result<void> Intake::take(const SendChunk& chunk) {
  if (chunk.sequence > next_sequence())
    return fail(ErrorCode::ProtocolBroken,
                fmt::format("chunk-order: chunk {} came where {} was due", chunk.sequence, next_sequence()));
  if (chunk.sequence < next_sequence()) {
    const auto before = spool_.read(chunk.sequence);
    if (!before) return tl::unexpected{before.error()};
    if (before->chain == chunk.chain && before->payload == chunk.payload) return {};
    return fail(ErrorCode::NotTrusted,
                fmt::format("chunk-chain: chunk {} is here already and is another one", chunk.sequence));
  }
  if (chunk.first_layer.count() != spool_.layer_count() ||
      chunk.layer_count > offer_.header.layer_count - spool_.layer_count())
    return fail(ErrorCode::ProtocolBroken,
                fmt::format("chunk-layers: chunk {} does not begin at layer {}, or ends above the last", chunk.sequence,
                            spool_.layer_count()));
  if (chain_after(spool_.chain(), chunk.sequence, chunk.first_layer, chunk.layer_count, chunk.payload) != chunk.chain)
    return fail(ErrorCode::NotTrusted,
                fmt::format("chunk-chain: chunk {} does not follow the chunks that are here", chunk.sequence));
  if (auto fed = feed({chunk.sequence, chunk.first_layer, chunk.layer_count, chunk.payload}); !fed) return fed;
  auto kept = spool_.append(chunk.first_layer, chunk.layer_count, chunk.payload);
  if (!kept) return tl::unexpected{kept.error()};
  return {};
}

Result<void> Intake::finish(const StackEnd& end) {
  if (spool_.layer_count() != offer_.header.layer_count || end.chunk_count != spool_.chunk_count())
    return fail(ErrorCode::NotTrusted,
                fmt::format("stack-end: {} of {} layers are here", spool_.layer_count(), offer_.header.layer_count));
  if (end.chain != spool_.chain()) return fail(ErrorCode::NotTrusted, "stack-chain: the chain of the chunks differs");
  if (spool_.finished() ? *spool_.finished() != end.stack : hasher_.digest() != end.stack)
    return fail(ErrorCode::NotTrusted, "stack-digest: the decoded layers are not those the scan site cut");
  if (is_signed(offer_))
    if (auto held = check_end(offer_, end); !held) return held;
  if (auto saved = save_end(folder_, end); !saved) return saved;
  has_end_ = true;
  return spool_.finish(end.stack);
}

Result<ReceivedStack> received_stack(const std::filesystem::path& folder) {
  const auto offer = saved_offer(folder);
  if (!offer) return tl::unexpected{offer.error()};
  const auto decoder = StackDecoder::start(offer->header);
  if (!decoder) return tl::unexpected{decoder.error()};
  const auto spool = ChunkSpool::open(folder / "chunks");
  if (!spool) return tl::unexpected{spool.error()};
  if (is_signed(*offer)) {
    const auto end = saved_end(folder);
    if (!end) return tl::unexpected{end.error()};
    if (auto held = check_offer(*offer, {}); !held) return tl::unexpected{held.error()};
    if (auto held = check_end(*offer, *end); !held) return tl::unexpected{held.error()};
    if (end->chain != spool->chain() || end->stack != spool->finished())
      return fail(ErrorCode::NotTrusted, "job-signature: the kept layers are not those that were signed");
  }
  std::vector<Layer> layers;
  std::vector<Chunk> chunks;
  bool earlier = false;
  for (std::uint32_t sequence = 0; sequence < spool->chunk_count(); ++sequence) {
    auto chunk = spool->read(sequence);
    if (!chunk) return tl::unexpected{chunk.error()};
    chunks.push_back({chunk->sequence, chunk->first_layer, chunk->layer_count, std::move(chunk->payload)});
    earlier |= is_of_earlier_release(chunks.back());
    auto some = decoder->decode(chunks.back());
    if (!some) return tl::unexpected{some.error()};
    std::move(some->begin(), some->end(), std::back_inserter(layers));
  }
  auto stack = LayerStack::from_layers(offer->header, std::move(layers));
  if (!stack) return tl::unexpected{stack.error()};
  if (!spool->finished() || (!earlier && digest_of(*stack) != *spool->finished()))
    return fail(ErrorCode::NotTrusted, "stack-digest: the kept layers are not those that were received");
  return ReceivedStack{std::move(*stack), std::move(chunks), *spool->finished()};
}

std::uint64_t ReceivedStack::bytes() const {
  std::uint64_t bytes = 0;
  for (const Chunk& chunk : chunks) bytes += chunk.payload.size();
  return bytes;
}

std::vector<std::byte> ReceivedStack::tfc() const { return tfc_of(layers.header(), chunks, digest); }

}  // namespace telefab::fab
