// SPDX-License-Identifier: GPL-3.0-or-later
#include "slicer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <telefab/base/file.hpp>
#include <telefab/scan/formats/registration_note.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>
#include <telefab/service/data_folder.hpp>
#include <telefab/service/saved_message.hpp>
#include <telefab/wire/job_signature.hpp>

namespace telefab::scan {
namespace {

// The wire knows no codec and states the numbers again; an offer in a coding that it does not read would end the line.
static_assert(static_cast<std::uint32_t>(Coding::ExactInWords) == kFirstCoding &&
                  static_cast<std::uint32_t>(Coding::Curve) == kLastCoding,
              "the codings that offers may name are those of the codec");

/// Millimetres as printed per unit of the scan, along that of its axes that is scaled most.
double scale_of(const Transform4& scan_to_build) {
  double most = 0;
  for (std::size_t axis = 0; axis < 3; ++axis)
    most = std::max(most, std::hypot(scan_to_build[axis], scan_to_build[4 + axis], scan_to_build[8 + axis]));
  return most;
}

/// Codes layers into a spool; chunks that are in it already are not written again, so that the coder goes on as if it
/// had never been interrupted.
class SpoolWriter {
 public:
  SpoolWriter(const SliceTask& task, std::shared_ptr<SharedSpool> spool, const SlicerEvents& events, CodecOptions codec,
              const std::string& site_key)
      : task_{task}, spool_{std::move(spool)}, events_{events}, codec_{codec}, site_key_{site_key} {}

  /// Goes on with an interrupted spool; the number of layers it holds.
  Result<std::uint32_t> resume_unfinished() {
    const auto chunks = spool_->with([](const ChunkSpool& spool) { return spool.chunk_count(); });
    // Decoded curves are not the contours they were coded from: such a scan is cut again from its first layer, and
    // the chunks that are there already must come out the same.
    if (chunks == 0 || codec_.coding != Coding::Exact) return 0U;
    auto offer = saved_offer(task_.folder);
    if (!offer) return tl::unexpected{offer.error()};
    kept_ = *offer;
    if (auto begun = begin(offer->header); !begun) return tl::unexpected{begun.error()};
    const auto decoder = StackDecoder::start(offer->header);
    if (!decoder) return tl::unexpected{decoder.error()};
    for (std::uint32_t sequence = 0; sequence < chunks; ++sequence) {
      const auto kept = spool_->with([&](const ChunkSpool& spool) { return spool.read(sequence); });
      if (!kept) return tl::unexpected{kept.error()};
      const auto layers = decoder->decode({kept->sequence, kept->first_layer, kept->layer_count, kept->payload});
      if (!layers) return tl::unexpected{layers.error()};
      for (const Layer& layer : *layers)
        if (auto added = add(layer); !added) return tl::unexpected{added.error()};
    }
    return layers_;
  }

  Result<void> take(const StackHeader& header, const Layer& layer) {
    if (!encoder_)
      if (auto begun = begin(header); !begun) return begun;
    return add(layer);
  }

  Result<void> finish() {
    if (!encoder_) return fail(ErrorCode::InvalidInput, fmt::format("{} has no layer", task_.name));
    auto chunk = encoder_->finish();
    if (!chunk) return tl::unexpected{chunk.error()};
    if (*chunk)
      if (auto kept = keep(**chunk); !kept) return kept;
    return spool_->with([&](ChunkSpool& spool) { return spool.finish(encoder_->stack_digest()); });
  }

  /// The scan file that the next offer names.
  void set_scan(std::span<const std::byte> file) {
    scan_ = digest_of(file);
    registration_rms_ = registration_rms_of(file).value_or(0);
  }
  [[nodiscard]] bool is_whole() const { return encoder_ && layers_ == layer_count_; }

 private:
  Result<void> begin(const StackHeader& header) {
    auto encoder = StackEncoder::start(header, codec_);
    if (!encoder) return tl::unexpected{encoder.error()};
    encoder_.emplace(std::move(*encoder));
    layer_count_ = header.layer_count;
    if (kept_) {  // the fab may have it: made again without the scan's digest it would be another job's
      events_.offered(task_.job, *kept_);
      return {};
    }
    Offer offer{task_.job,
                task_.name,
                task_.asked_machine,
                task_.parameters,
                digest_of_profile(task_.machine),
                header,
                static_cast<std::uint32_t>(codec_.coding),
                task_.owner,
                {},
                {},
                scan_,
                registration_rms_ * scale_of(header.scan_to_build)};
    if (auto signed_now = sign_offer(offer, site_key_); !signed_now) return signed_now;
    if (auto saved = save_offer(task_.folder, offer); !saved) return saved;
    events_.offered(task_.job, offer);
    return {};
  }

  Result<void> add(const Layer& layer) {
    auto chunk = encoder_->add(layer);
    if (!chunk) return tl::unexpected{chunk.error()};
    ++layers_;
    return *chunk ? keep(**chunk) : Result<void>{};
  }

  Result<void> keep(const Chunk& chunk) {
    auto kept = spool_->with([&](ChunkSpool& spool) -> Result<void> {
      if (chunk.sequence < spool.chunk_count()) {
        const auto before = spool.read(chunk.sequence);
        if (!before) return tl::unexpected{before.error()};
        if (before->payload == chunk.payload) return {};
        return fail(ErrorCode::Internal,
                    fmt::format("chunk {} of job {} did not come out as before the restart; submit "
                                "the scan again",
                                chunk.sequence, task_.job));
      }
      auto appended = spool.append(chunk.first_layer, chunk.layer_count, chunk.payload);
      if (!appended) return tl::unexpected{appended.error()};
      return {};
    });
    if (kept) events_.sliced(task_.job, chunk.first_layer.count() + chunk.layer_count);
    return kept;
  }

  const SliceTask& task_;
  std::shared_ptr<SharedSpool> spool_;
  const SlicerEvents& events_;
  CodecOptions codec_;
  const std::string& site_key_;
  Digest scan_;
  double registration_rms_ = 0;  // unit of the file
  std::optional<Offer> kept_;    ///< of the interrupted spool
  std::optional<StackEncoder> encoder_;
  std::uint32_t layers_ = 0;
  std::uint32_t layer_count_ = 0;
};

}  // namespace

Slicer::Slicer(SpoolRegistry& registry, const Clock& clock, std::string site_key, SlicerEvents events)
    : spools_{registry},
      clock_{clock},
      site_key_{std::move(site_key)},
      events_{std::move(events)},
      queue_{"slicer", [this](const std::string& job, std::stop_token stop) { run(job, stop); }} {}

void Slicer::add(SliceTask task) {
  const std::string job = task.job;
  {
    const std::lock_guard lock{mutex_};
    waiting_.insert_or_assign(job, std::move(task));
  }
  queue_.add(job);
}

bool Slicer::cancel(const std::string& job) {
  if (queue_.drop(job)) return true;
  const std::lock_guard lock{mutex_};
  waiting_.erase(job);
  return false;
}

void Slicer::run(const std::string& job, const std::stop_token& stop) {
  std::unique_lock lock{mutex_};
  const auto found = waiting_.extract(job);
  lock.unlock();
  if (found.empty()) return;  // cancelled a moment ago
  const SliceTask& task = found.mapped();
  const Nanoseconds began = clock_.now();
  events_.began(job);
  Result<void> outcome;
  try {
    outcome = slice(task, stop);
  } catch (const std::bad_alloc&) {
    outcome = fail(ErrorCode::TooLarge, fmt::format("{} does not fit into this machine's memory", task.name));
  } catch (const std::exception& error) {
    outcome = fail(ErrorCode::Internal, fmt::format("slicing {}: a fault of Telefab: {}", task.name, error.what()));
  }
  // Interrupted by the end of the daemon: the job goes on at the next start.
  if (queue_.is_ending() && !outcome) return;
  if (outcome)
    events_.ended(job, std::chrono::duration<double>(clock_.now() - began).count());
  else
    events_.ended(job, tl::unexpected{outcome.error()});
}

Result<void> Slicer::slice(const SliceTask& task, std::stop_token stop) {
  auto parameters = job_parameters_from(task.parameters, task.machine);
  if (!parameters) return tl::unexpected{parameters.error()};
  auto spool = spools_.of(task.job, task.folder);
  if (!spool) return tl::unexpected{spool.error()};
  SpoolWriter writer{task, *spool, events_, parameters->codec, site_key_};
  const auto cut_before = writer.resume_unfinished();
  if (!cut_before) return tl::unexpected{cut_before.error()};
  if (!writer.is_whole()) {
    const auto scan = read_file(task.folder / "scan", kMaxScanBytes);
    if (!scan) return tl::unexpected{scan.error()};
    writer.set_scan(*scan);
    if (*cut_before > 0) {
      const auto offer = saved_offer(task.folder);
      if (!offer) return tl::unexpected{offer.error()};
      parameters->slice.layers = {{*cut_before, offer->header.layer_count - 1}};
    }
    const auto report = slice_scan(
        *scan, task.name, parameters->slice,
        [&](const StackHeader& header, Layer&& layer) { return writer.take(header, layer); }, {}, stop);
    if (!report) return tl::unexpected{report.error()};
    if (auto made = make_folder(task.folder / "report"); !made) return made;
    if (auto kept = write_file_atomically(task.folder / "report" / "slice.json", to_json(*report) + "\n"); !kept)
      return kept;
  }
  return writer.finish();
}

}  // namespace telefab::scan
