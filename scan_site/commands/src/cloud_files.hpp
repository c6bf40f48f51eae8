// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/normals.hpp>
#include <telefab/scan/formats/read_cloud.hpp>

// What the verbs that work on clouds have in common: files in, files out.
namespace telefab::scan {

inline constexpr std::uint64_t kMaxScanFileBytes = 64ULL << 30U;

/// Reads a scan file, in millimetres if `unit` or the file itself says what it is in ("" = as the file says); else as
/// it stands.
[[nodiscard]] Result<PointCloud> load_cloud(const std::string& path, const std::string& unit, std::stop_token stop);
/// The same with normals, estimated where the file has none. Says on standard error what was flipped or guessed.
[[nodiscard]] Result<PointCloud> load_oriented(const std::string& path, const std::string& unit, std::stop_token stop);
/// The last part of a path, for messages and pose files.
[[nodiscard]] std::string name_of_file(const std::string& path);

}  // namespace telefab::scan
