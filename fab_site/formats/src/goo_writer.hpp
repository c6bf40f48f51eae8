// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <functional>
#include <stop_token>
#include <telefab/base/progress.hpp>

#include "mask_archives.hpp"

namespace telefab::fab {

/// What stands in a GOO file and is known only when all masks have passed.
struct GooSummary {
  Image small_preview;  ///< 116 x 116, RGB
  Image big_preview;    ///< 290 x 290
  double solid_mm3 = 0;
};

/// Writes a GOO v3 file beside its place and moves it there when it is whole. `mask` gives the picture of a layer as
/// the panel shows it, each layer once and in order; `summary` is asked for behind the last. Memory is that of one
/// mask. Fails as they do, with InvalidInput (a value that the format does not hold), Cancelled, StorageFailed; then
/// nothing is left behind.
[[nodiscard]] Result<void> write_goo(const std::filesystem::path& path, const PrintPlan& plan,
                                     const ArchiveFacts& facts,
                                     const std::function<Result<Mask>(std::uint32_t layer)>& mask,
                                     const std::function<GooSummary()>& summary, const ProgressSink& progress,
                                     const std::stop_token& stop);

}  // namespace telefab::fab
