// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <telefab/scan/slicing/slice_part.hpp>
#include <vector>

namespace telefab::scan {

/// A part and its file.
struct PartPlace {
  PartKey key;
  std::filesystem::path file;
  bool was_there = false;  ///< nothing was cut
};
/// "part 2 of 8 is written to parts/3f9a.2-of-8.tfpart".
[[nodiscard]] std::string sentence_of(const PartPlace& place);
/// The report's JSON with an object "part": which, slicing, file, was_there.
[[nodiscard]] std::string json_with(const PartPlace& place, const SliceReport& report);

/// The part from its file, where a sound one of that key lies there, and sets `was_there`. Nothing where it is not
/// there or damaged: then a note says that it is cut again. Fails: Conflict (a part of another key), and as replay
/// does.
[[nodiscard]] Result<std::optional<SliceReport>> replayed_if_there(PartPlace& place, const LayerSink& sink,
                                                                   const ProgressSink& progress, std::stop_token stop);
/// Writes the file whole or not at all, and makes its folder where there is none. Fails as write_file_atomically does.
[[nodiscard]] Result<void> put_part(const PartPlace& place, std::span<const std::byte> bytes);

/// The parts in files and folders; of a folder all whose names end as those of parts do, by name. Fails: NotFound (no
/// such file or folder, or none in a folder), StorageFailed.
[[nodiscard]] Result<std::vector<PartSource>> parts_in(const std::vector<std::string>& paths);

}  // namespace telefab::scan
