// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <telefab/base/digest.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>

namespace telefab::scan {

/// Which layers of which slicing a part has: all that tells whether one that lies there is the one wanted.
struct PartKey {
  Digest slicing;                                      ///< see digest_of_slicing
  std::optional<std::array<std::uint32_t, 2>> layers;  ///< as asked for (SliceRequest)
  std::optional<LayerShare> share;
  friend bool operator==(const PartKey&, const PartKey&) = default;
};

/// Of all that decides the bytes of a part beside its layers: digest and name of the scan's file, what was asked for,
/// the request's machine and how many points it takes, and the version of the program that cuts.
[[nodiscard]] Digest digest_of_slicing(const Digest& scan, std::string_view name, const SliceParameters& asked,
                                       const SliceRequest& request);
/// What such names end with.
inline constexpr std::string_view kPartEnding = ".tfpart";
/// "3f9ac1d2e4b50718.2-of-8.tfpart": half of the half of the digest, and which layers.
[[nodiscard]] std::string file_name_of(const PartKey& key);
/// "part 2 of 8", "layers 0 to 99", "part 2 of 8 of layers 0 to 99", "all layers".
[[nodiscard]] std::string label_of(const PartKey& key);

/// Layers that one worker cut: the bytes of its file, exact, so that parts put together are what one process makes.
/// The same arguments give the same bytes, on any number of threads. Form: README.md of this room.
struct CutPart {
  std::vector<std::byte> bytes;
  SliceReport report;  ///< of these layers
};
/// Cuts the layers that `parameters.slice` asks for, as slice_scan does and with its failures; `slicing`: as
/// digest_of_slicing gives for the same scan and parameters.
[[nodiscard]] Result<CutPart> cut_part(std::span<const std::byte> scan, std::string_view name,
                                       const JobParameters& parameters, const Digest& slicing, const LayerSink& sink,
                                       const ProgressSink& progress, std::stop_token stop);

/// A part somewhere: read when it is its turn, so that no two are in memory at once.
struct PartSource {
  std::string name;  ///< for messages
  std::function<Result<std::vector<std::byte>>()> read;
};

/// Parts of one slicing, in the order of their layers.
class PartSequence {
 public:
  /// Parts in any order. Fails: NotTrusted (a damaged part; read again it is another one), InvalidInput (no part; a
  /// file that is none; parts of several slicings, or that have layers in common; the message has their names), and as
  /// their `read` does.
  [[nodiscard]] static Result<PartSequence> of(std::vector<PartSource> parts, std::stop_token stop);

  /// Of the lowest part.
  [[nodiscard]] const PartKey& key() const { return parts_.front().key; }
  [[nodiscard]] const CodecOptions& codec() const { return codec_; }
  [[nodiscard]] std::size_t size() const { return parts_.size(); }
  /// Whether every layer of the stack is there. Fails: InvalidInput, which says what is missing.
  [[nodiscard]] Result<void> is_whole() const;

  /// The layers once more, as slice_scan gave them, and its report but for the times. Fails as it does where all
  /// layers together are no part, as the sink does, and as `of`.
  [[nodiscard]] Result<SliceReport> replay(const LayerSink& sink, const ProgressSink& progress,
                                           std::stop_token stop) const;

 private:
  struct Part {
    PartSource source;
    PartKey key;
    Digest digest;  ///< of its bytes
    std::uint32_t first = 0, end = 0;
  };
  PartSequence() = default;

  std::vector<Part> parts_;
  CodecOptions codec_;
  std::uint32_t layer_count_ = 0;
};

}  // namespace telefab::scan
