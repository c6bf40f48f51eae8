// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <span>
#include <stop_token>
#include <telefab/scan/formats/read_cloud.hpp>

// One reader a format. Each gets a whole file whose content or suffix says it is of that format.
namespace telefab::scan {

[[nodiscard]] Result<ScanFile> read_ply(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
[[nodiscard]] Result<ScanFile> read_pcd(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
[[nodiscard]] Result<ScanFile> read_ptx(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
[[nodiscard]] Result<ScanFile> read_e57(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
[[nodiscard]] Result<ScanFile> read_las(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
[[nodiscard]] Result<ScanFile> read_off(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
[[nodiscard]] Result<ScanFile> read_obj(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
[[nodiscard]] Result<ScanFile> read_stl(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);
/// XYZ, PTS, PWN, CSV and their kin.
[[nodiscard]] Result<ScanFile> read_text(std::span<const std::byte> bytes, const ReadOptions&, const std::stop_token&);

[[nodiscard]] bool looks_like_ptx(std::span<const std::byte> bytes);
/// A binary STL has its exact length from its triangle count; a text STL begins with "solid" and has facets.
[[nodiscard]] bool looks_like_stl(std::span<const std::byte> bytes);

/// Every how many items the readers look at the stop token.
inline constexpr std::size_t kStopEvery = 1U << 16;

}  // namespace telefab::scan
