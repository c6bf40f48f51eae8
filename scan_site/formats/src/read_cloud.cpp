// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/job/readable_scans.hpp>
#include <telefab/scan/formats/read_cloud.hpp>

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <string>
#include <telefab/base/text.hpp>
#include <telefab/scan/formats/face_samples.hpp>

#include "foreign_file.hpp"
#include "readers.hpp"
#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

struct FormatRow {
  ScanFormat format;
  std::string_view name;
  std::string_view suffix;
  Result<ScanFile> (*read)(std::span<const std::byte>, const ReadOptions&, const std::stop_token&);
};
constexpr std::array kFormats{
    FormatRow{ScanFormat::Ply, "PLY", ".ply", read_ply},    FormatRow{ScanFormat::Pcd, "PCD", ".pcd", read_pcd},
    FormatRow{ScanFormat::Text, "text", ".xyz", read_text}, FormatRow{ScanFormat::Off, "OFF", ".off", read_off},
    FormatRow{ScanFormat::Stl, "STL", ".stl", read_stl},    FormatRow{ScanFormat::Obj, "OBJ", ".obj", read_obj},
    FormatRow{ScanFormat::Ptx, "PTX", ".ptx", read_ptx},    FormatRow{ScanFormat::E57, "E57", ".e57", read_e57},
    FormatRow{ScanFormat::Las, "LAS", ".las", read_las},
};

const FormatRow& row_of(ScanFormat format) {
  return *std::find_if(kFormats.begin(), kFormats.end(), [&](const FormatRow& row) { return row.format == format; });
}

bool looks_like_obj(std::string_view text) {
  TextCursor lines{text.substr(0, 65536)};
  for (std::string_view line = lines.take_full_line(); !line.empty(); line = lines.take_full_line()) {
    FieldCursor fields{line};
    const std::string_view key = fields.take_word();
    if (key == "v" || key == "vn" || key == "vt") return true;
    if (key != "o" && key != "g" && key != "mtllib" && key != "usemtl" && key != "s") return false;
  }
  return false;
}

/// The first line that is no comment of a PCD file is its version; some writers leave it out.
bool looks_like_pcd(std::string_view text) {
  TextCursor lines{text.substr(0, 65536)};
  FieldCursor first{lines.take_full_line()};
  const auto is = [](std::string_view word, std::string_view name) {
    return std::equal(word.begin(), word.end(), name.begin(), name.end(),
                      [](unsigned char a, unsigned char b) { return std::toupper(a) == std::toupper(b); });
  };
  const std::string_view key = first.take_word();
  if (is(key, "FIELDS") || is(key, "COLUMNS")) return true;
  const std::string_view version = first.take_word();
  return is(key, "VERSION") && (version == ".7" || version == "0.7" || version == ".6" || version == "0.6" ||
                                version == ".5" || version == "0.5");
}

/// By content where content can tell, else by suffix, else text.
ScanFormat format_of(std::span<const std::byte> bytes, std::string_view file_name) {
  const std::string_view text = as_text(bytes);
  if (text.starts_with("ply\n") || text.starts_with("ply\r")) return ScanFormat::Ply;
  if (looks_like_pcd(text)) return ScanFormat::Pcd;
  if (text.starts_with("ASTM-E57")) return ScanFormat::E57;
  if (text.starts_with("LASF")) return ScanFormat::Las;
  if (looks_like_stl(bytes)) return ScanFormat::Stl;
  TextCursor lines{text.substr(0, 65536)};
  FieldCursor head{lines.take_full_line()};
  const std::string_view word = head.take_word();
  if (word.size() <= 8 && word.ends_with("OFF")) return ScanFormat::Off;
  if (looks_like_ptx(bytes)) return ScanFormat::Ptx;
  if (looks_like_obj(text)) return ScanFormat::Obj;
  std::string suffix{file_name.substr(std::min(file_name.size(), file_name.rfind('.')))};
  std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  for (const FormatRow& row : kFormats)
    if (row.suffix == suffix) return row.format;
  return ScanFormat::Text;
}

std::array<std::uint32_t, 3> bits_of(const Eigen::Vector3f& p) {
  // adding zero makes -0 and 0 one key
  return {std::bit_cast<std::uint32_t>(p.x() + 0.F), std::bit_cast<std::uint32_t>(p.y() + 0.F),
          std::bit_cast<std::uint32_t>(p.z() + 0.F)};
}

std::uint64_t hash_of(const std::array<std::uint32_t, 3>& key) {
  std::uint64_t h = key[0] * 0x9E3779B97F4A7C15ULL;
  h = (h ^ (h >> 29U) ^ key[1]) * 0xBF58476D1CE4E5B9ULL;
  h = (h ^ (h >> 32U) ^ key[2]) * 0x94D049BB133111EBULL;
  return h ^ (h >> 31U);
}

/// Leaves out the points without a normal while they are few; drops all normals when they are not.
void drop_missing_normals(PointCloud& cloud) {
  if (!cloud.has_normals()) return;
  const auto is_missing = [](const Eigen::Vector3f& n) { return n.isZero(0); };
  const auto missing = static_cast<std::size_t>(std::count_if(cloud.normals.begin(), cloud.normals.end(), is_missing));
  if (missing == 0) return;
  if (missing * 100 >= cloud.size()) {
    cloud.normals.clear();
    return;
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (is_missing(cloud.normals[i])) continue;
    cloud.copy_point(i, kept++);
  }
  cloud.shrink(kept);
}

}  // namespace

std::string_view name_of(ScanFormat format) { return row_of(format).name; }

PointCloud without_duplicates(PointCloud cloud) {
  constexpr std::uint32_t kFree = UINT32_MAX;
  const std::size_t slots = std::bit_ceil(cloud.size() * 2 + 1);
  std::vector<std::uint32_t> table(slots, kFree);
  std::vector<Eigen::Vector3f> normal_sum = cloud.normals;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const auto key = bits_of(cloud.points[i]);
    std::size_t slot = hash_of(key) & (slots - 1);
    while (table[slot] != kFree && bits_of(cloud.points[table[slot]]) != key) slot = (slot + 1) & (slots - 1);
    if (table[slot] != kFree) {
      const std::size_t first = table[slot];
      if (cloud.has_normals()) normal_sum[first] += cloud.normals[i];
      if (!cloud.confidence.empty()) cloud.confidence[first] = std::max(cloud.confidence[first], cloud.confidence[i]);
      if (!cloud.sheets_apart.empty())
        cloud.sheets_apart[first] = std::max(cloud.sheets_apart[first], cloud.sheets_apart[i]);
      continue;
    }
    table[slot] = static_cast<std::uint32_t>(kept);
    cloud.copy_point(i, kept);
    if (cloud.has_normals()) normal_sum[kept] = cloud.normals[kept];
    ++kept;
  }
  cloud.shrink(kept);
  if (cloud.has_normals())
    for (std::size_t i = 0; i < kept; ++i)
      if (const float length = normal_sum[i].norm(); length > 0.1F) cloud.normals[i] = normal_sum[i] / length;
  return cloud;
}

Result<void> check_may_be_scan(std::span<const std::byte> beginning, std::string_view file_name) {
  const auto foreign = foreign_file(beginning);
  if (!foreign) return {};
  return fail_in(to_printable(file_name.substr(0, 200)),
                 Error{ErrorCode::InvalidInput,
                       fmt::format("is {}, and no scan ({}); {}", foreign->name, kReadableScans, foreign->instead)});
}

Result<ScanFile> read_scan_file(std::span<const std::byte> bytes, std::string_view file_name,
                                const ReadOptions& options, std::stop_token stop) {
  const auto within = [&](const Error& cause) {
    // What a file and its name quote may be anything.
    return fail_in(to_printable(file_name.substr(0, 200)), Error{cause.code, to_printable(cause.what)});
  };
  if (bytes.empty()) return within(Error{ErrorCode::InvalidInput, "the file is empty"});
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (as_text(bytes).starts_with(kByteOrderMark)) bytes = bytes.subspan(kByteOrderMark.size());
  if (auto may_be = check_may_be_scan(bytes, file_name); !may_be) return tl::unexpected{may_be.error()};
  const FormatRow& row = row_of(format_of(bytes, file_name));
  auto file = row.read(bytes, options, stop);
  if (!file) return within(file.error());
  for (ScanNote& note : file->cloud.notes) note.text = to_printable(note.text);
  return file;
}

PointCloud cloud_of(ScanFile file) {
  if (auto note = faces_without_points(file)) file.cloud.notes.push_back(std::move(*note));
  PointCloud cloud = std::move(file.cloud);
  drop_missing_normals(cloud);
  return without_duplicates(std::move(cloud));
}

Result<PointCloud> read_cloud(std::span<const std::byte> bytes, std::string_view file_name, const ReadOptions& options,
                              std::stop_token stop) {
  auto file = read_scan_file(bytes, file_name, options, stop);
  if (!file) return tl::unexpected{file.error()};
  return cloud_of(std::move(*file));
}

}  // namespace telefab::scan
