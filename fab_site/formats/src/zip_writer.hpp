// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/progress.hpp>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::fab {

/// Makes the bytes of an entry when its turn has come, so that an archive takes the memory of one entry.
using EntryMaker = std::function<Result<std::vector<std::byte>>()>;

enum class Packing : std::uint8_t { Stored, Deflated };

/// Writes a zip archive beside its place and moves it there when it is whole. Same entries, same bytes: every time
/// stamp is that of the format's first day.
class ZipWriter {
 public:
  /// Fails as write_file_atomically.
  [[nodiscard]] static Result<ZipWriter> create(std::filesystem::path path);
  ~ZipWriter();
  ZipWriter(ZipWriter&&) noexcept;
  ZipWriter& operator=(ZipWriter&&) noexcept;

  /// Entries are written in the order in which they are added.
  [[nodiscard]] Result<void> add(const std::string& name, std::string_view text, Packing packing = Packing::Stored);
  [[nodiscard]] Result<void> add(const std::string& name, EntryMaker maker, Packing packing = Packing::Stored);
  /// Makes all entries and puts the archive in its place. Fails as the makers do, with Cancelled, or StorageFailed;
  /// then nothing is left behind.
  [[nodiscard]] Result<void> finish(WorkStage stage, const ProgressSink& progress, std::stop_token stop);

 private:
  struct Archive;
  explicit ZipWriter(std::unique_ptr<Archive> archive);
  std::unique_ptr<Archive> archive_;
};

}  // namespace telefab::fab
