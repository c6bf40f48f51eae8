// SPDX-License-Identifier: GPL-3.0-or-later
#include "foreign_file.hpp"

#include <algorithm>
#include <array>

#include "text_cursor.hpp"

namespace telefab::scan {
namespace {

using namespace std::string_view_literals;

constexpr std::string_view kPicture = "a picture has no points in space: export the scan from the scanner's software";
constexpr std::string_view kPacked = "unpack it and give the scan inside";
constexpr std::string_view kCad = "export a point cloud from it, or an STL and --sample-faces";
constexpr std::string_view kScene = "export its points or vertices as PLY";

struct Row {
  std::string_view magic;
  ForeignFile file;
};
constexpr std::array kRows{
    Row{"\x89PNG\r\n\x1a\n"sv, {"a PNG picture", kPicture}},
    Row{"\xFF\xD8\xFF"sv, {"a JPEG picture", kPicture}},
    Row{"GIF8"sv, {"a GIF picture", kPicture}},
    Row{"II*\0"sv, {"a TIFF picture", kPicture}},
    Row{"MM\0*"sv, {"a TIFF picture", kPicture}},
    Row{"%PDF-"sv, {"a PDF document", kPicture}},
    Row{"PK\x03\x04"sv, {"a ZIP archive (3MF, USDZ and others are such)", kPacked}},
    Row{"\x1F\x8B"sv, {"packed by gzip", kPacked}},
    Row{"\xFD"
        "7zXZ\0"sv,
        {"packed by xz", kPacked}},
    Row{"BZh"sv, {"packed by bzip2", kPacked}},
    Row{"7z\xBC\xAF\x27\x1C"sv, {"a 7z archive", kPacked}},
    Row{"Rar!\x1A\x07"sv, {"a RAR archive", kPacked}},
    Row{"TFC1\r\n"sv, {"a scan that is sliced already (.tfc)", "give it to telefab-fab plan"}},
    Row{"ISO-10303-21;"sv, {"a STEP model", kCad}},
    Row{"AC10"sv, {"a DWG drawing", kCad}},
    Row{"glTF"sv, {"a binary glTF scene", kScene}},
    Row{"Kaydara FBX Binary"sv, {"an FBX scene", kScene}},
    Row{"BLENDER"sv, {"a Blender scene", kScene}},
};
/// Texts that begin with a mark of their language.
constexpr std::array kMarkup{
    Row{"<"sv, {"a page or drawing in XML (HTML, SVG, X3D and others are such)", kScene}},
    Row{"{"sv, {"JSON (glTF and others are such)", kScene}},
};

std::optional<ForeignFile> begins(std::string_view text, std::span<const Row> rows) {
  const auto row = std::ranges::find_if(rows, [&](const Row& r) { return text.starts_with(r.magic); });
  return row != rows.end() ? std::optional{row->file} : std::nullopt;
}

}  // namespace

std::optional<ForeignFile> foreign_file(std::span<const std::byte> bytes) {
  const std::string_view text = as_text(bytes);
  if (auto file = begins(text, kRows)) return file;
  const std::size_t first = text.substr(0, 4096).find_first_not_of(" \t\r\n");
  return first == std::string_view::npos ? std::nullopt : begins(text.substr(first), kMarkup);
}

}  // namespace telefab::scan
