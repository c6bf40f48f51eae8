// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/geometry/layer.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// A .tfc file, read.
struct StackFile {
  LayerStack stack;
  std::vector<std::byte> bytes;
};
/// Reads a .tfc file. Fails as read_file and read_tfc do, with the path in the message.
[[nodiscard]] Result<StackFile> read_stack_file(const std::string& path);
[[nodiscard]] Result<LayerStack> read_stack(const std::string& path);
/// Of its contours: width, depth and height; headers may state a whole platform. For captions of pictures.
[[nodiscard]] std::array<double, 3> part_size_mm(const LayerStack& stack);
/// "making masks  42 %" on a terminal, nothing elsewhere; clear_progress() wipes the line.
[[nodiscard]] ProgressSink progress_line();
void clear_progress();

}  // namespace telefab::fab
