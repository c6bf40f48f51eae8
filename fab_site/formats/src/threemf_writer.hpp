// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <stop_token>
#include <telefab/base/progress.hpp>

#include "contour_texts.hpp"
#include "zip_writer.hpp"

namespace telefab::fab {

/// The model part of a 3MF file: one object a part, each with its stack of slices. The mesh that the standard asks of
/// every object is a box, said to be of low resolution, so that consumers must take the slices.
class ThreeMfModel final : public LayerText {
 public:
  explicit ThreeMfModel(const ContourJob& job) : job_{job} {}
  void begin(std::string& out) override;
  /// Layers are counted through the parts: part n, layer i is number n * layer_count + i.
  void layer(std::string& out, std::uint32_t index) override;
  void end(std::string& out) override;

 private:
  const ContourJob& job_;
};

/// What every 3MF archive begins with: content types, and where its model lies.
[[nodiscard]] Result<void> add_threemf_frame(ZipWriter& zip);

[[nodiscard]] Result<void> write_threemf(const ContourJob& job, const std::filesystem::path& path,
                                         const ProgressSink& progress, std::stop_token stop);

}  // namespace telefab::fab
