// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>

#include "layer_tally.hpp"
#include "part_bytes.hpp"

namespace telefab::scan {
namespace {

/// So many missing ranges are named.
constexpr std::size_t kNamed = 5;

std::string layers_text(std::uint32_t first, std::uint32_t end) {
  return end == first + 1 ? fmt::format("layer {}", first) : fmt::format("layers {} to {}", first, end - 1);
}

}  // namespace

Result<PartSequence> PartSequence::of(std::vector<PartSource> parts, std::stop_token stop) {
  if (parts.empty()) return fail(ErrorCode::InvalidInput, "there are no parts to put together");
  PartSequence made;
  std::optional<Digest> known;
  for (PartSource& source : parts) {
    if (stop.stop_requested()) return cancelled("reading parts");
    const auto bytes = source.read();
    if (!bytes) return tl::unexpected{bytes.error()};
    const auto part = open_part(*bytes);
    if (!part) return fail_in(source.name, part.error());
    const PartHead& head = part->head;
    const auto differs = [&](std::string_view how) {
      return fail(ErrorCode::InvalidInput,
                  fmt::format("{} and {} {}", made.parts_.front().source.name, source.name, how));
    };
    if (!made.parts_.empty() && head.key.slicing != made.key().slicing)
      return differs(
          "are parts of different slicings (another scan, other parameters or another version of the "
          "program); name those of one, or give each slicing a folder of its own");
    if (known && part->known != *known)
      return differs("were cut from the same scan with different outcomes; cut one of them again");
    known = part->known;
    made.codec_ = head.codec;
    made.layer_count_ = head.known.header.layer_count;
    made.parts_.push_back({std::move(source), head.key, part->digest, head.range.first, head.range.end});
  }
  std::stable_sort(made.parts_.begin(), made.parts_.end(), [](const Part& a, const Part& b) {
    return std::pair{a.first, a.end} < std::pair{b.first, b.end};
  });
  const Part* last = nullptr;
  for (const Part& part : made.parts_) {
    if (part.first == part.end) continue;
    if (last && part.first < last->end)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("{} ({}) and {} ({}) both hold {}; name parts of one division", last->source.name,
                              label_of(last->key), part.source.name, label_of(part.key),
                              layers_text(part.first, std::min(part.end, last->end))));
    last = &part;
  }
  return made;
}

Result<void> PartSequence::is_whole() const {
  std::vector<std::string> missing;
  std::uint32_t next = 0;
  const auto until = [&](std::uint32_t first) {
    if (first > next) missing.push_back(layers_text(next, first));
  };
  for (const Part& part : parts_) {
    until(part.first);
    next = std::max(next, part.end);
  }
  until(layer_count_);
  if (missing.empty()) return {};
  // Workers know their parts by number.
  const auto& share = key().share;
  const auto of_one_division = [&](const Part& p) {
    return !p.key.layers && p.key.share && p.key.share->count == share->count;
  };
  if (share && std::all_of(parts_.begin(), parts_.end(), of_one_division))
    for (std::string& text : missing) {
      std::string numbers;
      for (std::uint32_t i = 1; i <= share->count; ++i) {
        const LayerRange range = share_of({0, layer_count_}, {i, share->count});
        if (range.count() > 0 && layers_text(range.first, range.end) == text)
          numbers = fmt::format("part {} of {}: ", i, share->count);
      }
      text = numbers + text;
    }
  std::string list;
  for (std::size_t i = 0; i < std::min(kNamed, missing.size()); ++i) list += (i == 0 ? "" : "; ") + missing[i];
  if (missing.size() > kNamed) list += fmt::format("; and {} more", missing.size() - kNamed);
  return fail(ErrorCode::InvalidInput,
              fmt::format("some of the {} layers are missing: {}; cut them, and merge again", layer_count_, list));
}

Result<SliceReport> PartSequence::replay(const LayerSink& sink, const ProgressSink& progress,
                                         std::stop_token stop) const {
  SliceReport report;
  std::optional<LayerTally> tally;
  std::vector<StageTime> times;
  StageClock clock{times};
  std::uint32_t all = 0, done = 0;
  for (const Part& part : parts_) all += part.end - part.first;
  for (const Part& part : parts_) {
    const auto bytes = part.source.read();
    if (!bytes) return tl::unexpected{bytes.error()};
    auto open = open_part(*bytes);
    if (!open) return fail_in(part.source.name, open.error());
    if (open->digest != part.digest)
      return fail(ErrorCode::Conflict, fmt::format("{} was replaced while it was read; try again", part.source.name));
    if (!tally) {
      report = std::move(open->head.known);
      tally.emplace(report, sink);
    }
    for (std::uint32_t i = part.first; i < part.end; ++i) {
      if (stop.stop_requested()) return cancelled("merging parts");
      CutLayer cut;
      open->layers(cut);
      if (!open->layers.ok() || cut.layer.index.count() != i)
        return fail_in(part.source.name,
                       {ErrorCode::NotTrusted, fmt::format("layer {} is malformed; cut the part again", i)});
      if (auto ok = tally->take(std::move(cut)); !ok) return fail_in(part.source.name, ok.error());
      telefab::report(progress, WorkStage::CuttingContours, static_cast<double>(++done) / all);
    }
    if (open->layers.left() > 0)
      return fail_in(part.source.name, {ErrorCode::NotTrusted, "bytes follow the last layer; cut the part again"});
  }
  clock.lap("merging");
  report.times = std::move(times);
  if (auto ok = tally->finish(); !ok) return tl::unexpected{ok.error()};
  return report;
}

}  // namespace telefab::scan
