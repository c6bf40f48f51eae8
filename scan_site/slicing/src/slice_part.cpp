// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/slicing/slice_part.hpp>

#include <fmt/format.h>

#include <telefab/base/version.hpp>

#include "part_bytes.hpp"
#include "recorded_slicing.hpp"

namespace telefab::scan {
namespace {

/// So much of a digest tells slicings apart in a folder; the file has all of it.
constexpr std::size_t kDigitsInNames = 16;

class PartRecorder final : public CutRecorder {
 public:
  PartRecorder(PartKey key, const CodecOptions& codec) : key_{std::move(key)}, codec_{codec} {}
  void begin(const SliceReport& known, const LayerRange& range) override {
    write_head({.key = key_, .codec = codec_, .range = range, .known = known}, to_);
  }
  void layer(const CutLayer& cut) override { to_(cut); }
  [[nodiscard]] std::vector<std::byte> sealed() && { return with_seal(std::move(to_.bytes())); }

 private:
  PartKey key_;
  CodecOptions codec_;
  ArchiveWriter to_;
};

}  // namespace

Digest digest_of_slicing(const Digest& scan, std::string_view name, const SliceParameters& asked,
                         const SliceRequest& request) {
  Hasher hasher;
  hasher.feed(fmt::format("telefab-scan {}\nform {}\nscan {}\nname {} {}\npoints {}\n", kVersion, kPartForm,
                          to_hex(scan), name.size(), name, request.intake.most_points.value_or(0)));
  hasher.feed(to_json(asked));
  hasher.feed("\n");
  hasher.feed(to_toml(request.machine));
  return hasher.digest();
}

std::string file_name_of(const PartKey& key) {
  std::string name = to_hex(key.slicing).substr(0, kDigitsInNames);
  if (key.layers) name += fmt::format(".layers-{}-{}", (*key.layers)[0], (*key.layers)[1]);
  if (key.share) name += fmt::format(".{}-of-{}", key.share->index, key.share->count);
  if (!key.layers && !key.share) name += ".all";
  return name.append(kPartEnding);
}

std::string label_of(const PartKey& key) {
  const std::string layers = key.layers ? fmt::format("layers {} to {}", (*key.layers)[0], (*key.layers)[1]) : "";
  if (!key.share) return key.layers ? layers : "all layers";
  return fmt::format("part {} of {}{}{}", key.share->index, key.share->count, key.layers ? " of " : "", layers);
}

Result<CutPart> cut_part(std::span<const std::byte> scan, std::string_view name, const JobParameters& parameters,
                         const Digest& slicing, const LayerSink& sink, const ProgressSink& progress,
                         std::stop_token stop) {
  PartRecorder recorder{{slicing, parameters.slice.layers, parameters.slice.share}, parameters.codec};
  auto report = slice_recorded(scan, name, parameters.slice, &recorder, sink, progress, stop);
  if (!report) return tl::unexpected{report.error()};
  return CutPart{std::move(recorder).sealed(), std::move(*report)};
}

}  // namespace telefab::scan
