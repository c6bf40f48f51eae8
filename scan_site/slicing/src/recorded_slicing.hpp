// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/slicing/slice_scan.hpp>

#include "layer_cutter.hpp"

namespace telefab::scan {

/// Sees what is cut before anything becomes of it.
class CutRecorder {
 public:
  virtual ~CutRecorder() = default;
  CutRecorder(const CutRecorder&) = delete;
  CutRecorder& operator=(const CutRecorder&) = delete;
  /// All that is known before the first layer, and which will come.
  virtual void begin(const SliceReport& known, const LayerRange& range) = 0;
  /// In order, never from two threads at once.
  virtual void layer(const CutLayer& cut) = 0;

 protected:
  CutRecorder() = default;
};

/// slice_scan with somebody who looks on; nullptr: nobody.
[[nodiscard]] Result<SliceReport> slice_recorded(std::span<const std::byte> scan, std::string_view name,
                                                 const SliceRequest& request, CutRecorder* recorder,
                                                 const LayerSink& sink, const ProgressSink& progress,
                                                 std::stop_token stop);

}  // namespace telefab::scan
