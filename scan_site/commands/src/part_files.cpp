// SPDX-License-Identifier: GPL-3.0-or-later
#include "part_files.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/command_line/output.hpp>

namespace telefab::scan {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxPartBytes = 16ULL << 30U;

PartSource source_at(const fs::path& file) {
  return {file.string(), [file] { return read_file(file, kMaxPartBytes); }};
}

}  // namespace

std::string sentence_of(const PartPlace& place) {
  return fmt::format("{} {} {}", label_of(place.key),
                     place.was_there ? "was cut before, and nothing was cut again:" : "is written to",
                     place.file.string());
}

std::string json_with(const PartPlace& place, const SliceReport& report) {
  nlohmann::ordered_json root = parsed_json(to_json(report));
  root["part"] = {{"which", label_of(place.key)},
                  {"slicing", to_hex(place.key.slicing)},
                  {"file", place.file.string()},
                  {"was_there", place.was_there}};
  return json_text(root);
}

Result<std::optional<SliceReport>> replayed_if_there(PartPlace& place, const LayerSink& sink,
                                                     const ProgressSink& progress, std::stop_token stop) {
  std::error_code unknown;
  if (!fs::exists(place.file, unknown)) return std::nullopt;
  auto parts = PartSequence::of({source_at(place.file)}, stop);
  if (!parts && parts.error().code == ErrorCode::NotTrusted) {
    write_note(fmt::format("note: {}\n", parts.error().what));
    return std::nullopt;
  }
  if (!parts) return tl::unexpected{parts.error()};
  if (!(parts->key() == place.key))
    return fail(ErrorCode::Conflict,
                fmt::format("{} is {} of another slicing; move it away", place.file.string(), label_of(parts->key())));
  auto report = parts->replay(sink, progress, stop);
  if (!report) return tl::unexpected{report.error()};
  place.was_there = true;
  return std::move(*report);
}

Result<void> put_part(const PartPlace& place, std::span<const std::byte> bytes) {
  const fs::path folder = place.file.parent_path();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return fail_system("make", folder, error.value());
  return write_file_atomically(place.file, bytes);
}

Result<std::vector<PartSource>> parts_in(const std::vector<std::string>& paths) {
  std::vector<PartSource> found;
  for (const fs::path path : paths) {
    std::error_code error;
    if (!fs::is_directory(path, error)) {
      found.push_back(source_at(path));
      continue;
    }
    std::vector<fs::path> files;
    // Those that are being written are hidden.
    for (auto entry = fs::directory_iterator{path, error}; !error && entry != fs::directory_iterator{};
         entry.increment(error))
      if (const std::string name = entry->path().filename().string(); name.ends_with(kPartEnding) && name[0] != '.')
        files.push_back(entry->path());
    if (error) return fail_system("list", path, error.value());
    if (files.empty())
      return fail(ErrorCode::NotFound,
                  fmt::format("{} holds no part (*{}); telefab-scan slice --part I/N --parts {} makes them",
                              path.string(), kPartEnding, path.string()));
    std::sort(files.begin(), files.end());
    for (const fs::path& file : files) found.push_back(source_at(file));
  }
  return found;
}

}  // namespace telefab::scan
