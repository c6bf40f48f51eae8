// SPDX-License-Identifier: GPL-3.0-or-later
#include "hostile_files.hpp"

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <telefab/test/e57_file.hpp>
#include <telefab/test/las_file.hpp>

namespace telefab::test {
namespace {

using Points = std::vector<std::array<double, 3>>;

constexpr std::size_t kCount = 240;
constexpr std::string_view kPlyXyz = "property float x\nproperty float y\nproperty float z\n";

Points ball() {
  Points points;
  for (std::size_t i = 0; i < kCount; ++i) {
    const double z = 1 - (2 * static_cast<double>(i) + 1) / kCount;
    const double turn = std::numbers::pi * (3 - std::sqrt(5.)) * static_cast<double>(i);
    const double r = std::sqrt(1 - z * z);
    points.push_back({10 * r * std::cos(turn), 10 * r * std::sin(turn), 10 * z});
  }
  return points;
}

template <class T>
std::string raw(T value, bool big = false) {
  auto bytes = std::bit_cast<std::array<char, sizeof(T)>>(value);
  if (big) std::reverse(bytes.begin(), bytes.end());
  return {bytes.data(), bytes.size()};
}

std::string lines_of(const Points& points, std::string_view before = "") {
  std::string out;
  for (const auto& p : points) out += fmt::format("{}{:.6f} {:.6f} {:.6f}\n", before, p[0], p[1], p[2]);
  return out;
}

std::string floats_of(const Points& points, bool big = false) {
  std::string out;
  for (const auto& p : points)
    for (const double v : p) out += raw(static_cast<float>(v), big);
  return out;
}

std::string ply_head(std::string_view format, std::string_view count, std::string_view properties = kPlyXyz,
                     std::string_view more = "") {
  return fmt::format("ply\nformat {} 1.0\nelement vertex {}\n{}{}end_header\n", format, count, properties, more);
}

std::string pcd_head(std::string_view data, std::string_view width, std::string_view points,
                     std::string_view sizes = "4 4 4", std::string_view counts = "1 1 1") {
  return fmt::format(
      "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE {}\nTYPE F F F\nCOUNT {}\nWIDTH {}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 "
      "0 "
      "0\nPOINTS {}\nDATA {}\n",
      sizes, counts, width, points, data);
}

/// LZF of literal runs only, fields one after the other.
std::string pcd_compressed(const Points& points) {
  std::string fields;
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (const auto& p : points) fields += raw(static_cast<float>(p[axis]));
  std::string packed;
  for (std::size_t at = 0; at < fields.size(); at += 32) {
    const std::string run = fields.substr(at, 32);
    packed += static_cast<char>(run.size() - 1);
    packed += run;
  }
  const std::string count = std::to_string(points.size());
  return pcd_head("binary_compressed", count, count) + raw(static_cast<std::uint32_t>(packed.size())) +
         raw(static_cast<std::uint32_t>(fields.size())) + packed;
}

std::string ptx_head(std::string_view columns, std::string_view rows, std::string_view corner = "1") {
  return fmt::format("{}\n{}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{} 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", columns, rows,
                     corner);
}

std::string stl_text(const Points& points) {
  std::string out = "solid a\n";
  for (std::size_t i = 0; i + 2 < points.size(); i += 3)
    out += "facet normal 0 0 1\nouter loop\n" + lines_of({points[i], points[i + 1], points[i + 2]}, "vertex ") +
           "endloop\nendfacet\n";
  return out + "endsolid a\n";
}

std::string stl_binary(const Points& points, std::uint32_t claimed) {
  std::string out(80, 'b');
  out += raw(claimed);
  for (std::size_t i = 0; i + 2 < points.size(); i += 3)
    out += std::string(12, '\0') + floats_of({points[i], points[i + 1], points[i + 2]}) + std::string(2, '\0');
  return out;
}

std::vector<E57Column> e57_columns(const Points& points) {
  std::array<std::vector<double>, 3> axes;
  for (const auto& p : points)
    for (std::size_t axis = 0; axis < 3; ++axis) axes[axis].push_back(p[axis] / 1000);
  return {e57_doubles("cartesianX", axes[0]), e57_floats("cartesianY", axes[1]), e57_floats("cartesianZ", axes[2])};
}

std::string e57_logical(const Points& points, std::string_view pose = "") {
  E57File file;
  file.add_scan(e57_columns(points), points.size(), pose, 1000);
  return file.logical();
}

std::string las(const Points& points, std::uint8_t minor) {
  std::vector<std::array<std::int32_t, 3>> whole;
  for (const auto& p : points) {
    whole.emplace_back();
    for (std::size_t axis = 0; axis < 3; ++axis) whole.back()[axis] = static_cast<std::int32_t>(p[axis] * 1000);
  }
  return las_file(whole, {.minor = minor, .format = 7, .scale = Eigen::Vector3d::Constant(1e-6)});
}

std::string with(std::string bytes, std::size_t at, std::string_view put) { return bytes.replace(at, put.size(), put); }

std::string instead(std::string text, std::string_view from, std::string_view to) {
  return text.replace(text.find(from), from.size(), to);
}

/// One good file a format that knows how long it is.
std::vector<HostileFile> good_files(const Points& points) {
  const std::string n = std::to_string(points.size());
  std::string indexed = "OFF\n" + n + " 1 0\n" + lines_of(points) + "3 0 1 2\n";
  return {
      {"text.ply", ply_head("ascii", n) + lines_of(points), kCount, ""},
      {"little.ply", ply_head("binary_little_endian", n) + floats_of(points), kCount, ""},
      {"big.ply", ply_head("binary_big_endian", n) + floats_of(points, true), kCount, ""},
      {"text.pcd", pcd_head("ascii", n, n) + lines_of(points), kCount, ""},
      {"binary.pcd", pcd_head("binary", n, n) + floats_of(points), kCount, ""},
      {"compressed.pcd", pcd_compressed(points), kCount, ""},
      {"counted.pts", n + "\n" + lines_of(points), kCount, ""},
      {"indexed.off", std::move(indexed), kCount, ""},
      {"text.stl", stl_text(points), kCount, ""},
      {"binary.stl", stl_binary(points, kCount / 3), kCount, ""},
      {"grid.ptx", ptx_head("24", "10") + lines_of(points), kCount, ""},
      {"survey.e57", on_e57_pages(e57_logical(points)), kCount, ""},
      {"survey12.las", las(points, 2), kCount, ""},
      {"survey14.las", las(points, 4), kCount, ""},
  };
}

void add_cuts(const Points& points, std::vector<HostileFile>& out) {
  for (const HostileFile& good : good_files(points)) {
    out.push_back(good);
    for (const double share : {0.02, 0.5, 0.9})
      out.push_back({fmt::format("cut_at_{}_{}", share, good.name),
                     good.bytes.substr(0, static_cast<std::size_t>(share * static_cast<double>(good.bytes.size()))),
                     std::nullopt, ""});
  }
}

void add_ply(const Points& points, std::vector<HostileFile>& out) {
  const std::string n = std::to_string(points.size());
  const std::string body = lines_of(points);
  const auto bad = [&](std::string name, std::string bytes, std::string says) {
    out.push_back({std::move(name), std::move(bytes), std::nullopt, std::move(says)});
  };
  bad("claims_1e18.ply", ply_head("binary_little_endian", "1000000000000000000") + floats_of(points), "claims");
  bad("claims_too_much_to_count.ply", ply_head("ascii", "99999999999999999999999") + body, "");
  bad("claims_minus_one.ply", ply_head("ascii", "-1") + body, "");
  bad("claims_none.ply", ply_head("ascii", "0"), "no point");
  out.push_back({"nan.ply", ply_head("ascii", "3") + "0 0 0\nnan 0 0\n1 1 1\n", 2, ""});
  bad("rows_over_line_ends.ply", ply_head("ascii", "3") + "0 0 0 1\n0 0 1 1\n1\n", "more than the 3 values");
  bad("infinite.ply", ply_head("ascii", "3") + "0 0 0\n0 inf 0\n1 1 1\n", "point 1");
  bad("all_nan.ply", ply_head("binary_little_endian", "8") + std::string(96, '\xFF'), "none of the 8 points");
  bad("beyond_any_object.ply", ply_head("ascii", "2") + "0 0 0\n1e300 0 0\n", "1e+12");
  bad("word_for_number.ply", ply_head("ascii", "2") + "0 0 0\n1 one 1\n", "");
  bad("unknown_type.ply", ply_head("ascii", n, "property quux x\nproperty float y\nproperty float z\n") + body, "");
  bad("unknown_format.ply", ply_head("binary_middle_endian", n) + body, "binary_middle_endian");
  bad("no_z.ply", ply_head("ascii", n, "property float x\nproperty float y\n") + body, "");
  bad("endless_header.ply", "ply\nformat ascii 1.0\ncomment " + std::string(4U << 20U, 'c'), "");
  bad(
      "million_header_lines.ply",
      "ply\nformat ascii 1.0\n" +
          [] {
            std::string lines;
            for (int i = 0; i < 200000; ++i) lines += "comment\n";
            return lines;
          }(),
      "");
  std::string properties{kPlyXyz};
  for (int i = 0; i < 50000; ++i) properties += fmt::format("property float p{}\n", i);
  bad("fifty_thousand_properties.ply", ply_head("binary_little_endian", n, properties) + floats_of(points), "");
  bad("list_of_4e9.ply",
      ply_head("binary_little_endian", "1", std::string{kPlyXyz} + "property list uint float more\n") +
          std::string(12, '\0') + "\xFF\xFF\xFF\xFF",
      "");
  bad("list_before_the_points.ply",
      "ply\nformat binary_little_endian 1.0\nelement face 1000000000\nproperty list uchar int i\nelement vertex " + n +
          "\n" + std::string{kPlyXyz} + "end_header\n" + std::string(1000, '\0'),
      "");
  bad("escapes_in_a_name.ply", ply_head("ascii", n, "property \x1b[31mfloat\x07 x\n") + body, "");
  bad("grid_beyond_points.ply",
      ply_head("ascii", "2", kPlyXyz, "element range_grid 1\nproperty list uchar int vertex_indices\n") +
          "0 0 0\n1 1 1\n1 77\n",
      "");
  out.push_back({"bad_utf8_comment.ply",
                 instead(ply_head("ascii", n), "element", "comment \xFF\xC0\x80\nelement") + body, kCount, ""});
  out.push_back({"face_of_no_point.ply",
                 ply_head("ascii", n, kPlyXyz, "element face 1\nproperty list uchar int vertex_indices\n") + body +
                     "3 0 1 4000000000\n",
                 kCount, ""});
}

void add_pcd(const Points& points, std::vector<HostileFile>& out) {
  const std::string n = std::to_string(points.size());
  const auto bad = [&](std::string name, std::string bytes, std::string says) {
    out.push_back({std::move(name), std::move(bytes), std::nullopt, std::move(says)});
  };
  bad("zero_size.pcd", pcd_head("binary", n, n, "0 4 4") + floats_of(points), "size 0");
  bad("count_4e9.pcd", pcd_head("binary", n, n, "4 4 4", "4294967295 1 1") + floats_of(points), "");
  bad("claims_1e15.pcd", pcd_head("binary", "4294967295", "4294967295") + floats_of(points), "");
  bad("width_is_not_points.pcd", pcd_head("ascii", n, "7") + lines_of(points), "POINTS");
  bad("unknown_data.pcd", pcd_head("zipped", n, n) + floats_of(points), "zipped");
  bad("nothing_seen.pcd", pcd_head("ascii", "2", "2") + "nan nan nan\nnan nan nan\n", "not seen");
  bad("expands_to_4e9.pcd",
      pcd_head("binary_compressed", n, n) + raw(std::uint32_t{8}) + raw(UINT32_MAX) + std::string(8, '\x01'), "");
  bad("refers_before_its_start.pcd",
      pcd_head("binary_compressed", "1", "1") + raw(std::uint32_t{6}) + raw(std::uint32_t{12}) +
          "\xFF\xFF\x20\x20\x20\x20",
      "damaged");
}

void add_text(const Points& points, std::vector<HostileFile>& out) {
  const std::string body = lines_of(points);
  const auto bad = [&](std::string name, std::string bytes, std::string says) {
    out.push_back({std::move(name), std::move(bytes), std::nullopt, std::move(says)});
  };
  bad("empty.xyz", "", "empty");
  bad("blanks.xyz", std::string(1U << 20U, ' '), "");
  bad("comments_alone.xyz", "# a\n# b\n", "no point");
  bad("prose.xyz", "It was a dark and stormy night.\n", "line 1");
  bad("one_line_of_8_MiB.xyz", std::string(8U << 20U, '7'), "");
  bad("ragged.xyz", body + "1 2\n", "line 241");
  bad("number_1e999.xyz", body + "1e999 0 0\n", "");
  bad("nul_bytes.xyz", with(body, 10, std::string_view{"\0\0\0", 3}), "");
  bad("bad_utf8.xyz", body + "\xC3\x28 \xFF 3\n", "line 241");
  bad("count_1e15.pts", "1000000000000000\n" + body, "claims");
  bad("count_and_half.pts", "2.5\n" + body, "not a number of points");
  bad("picture.png", "\x89PNG\r\n\x1a\n" + std::string(100, '\0'), "");
  bad("page.html", "<!DOCTYPE html><html><body>404</body></html>", "");
  bad("archive.zip", "PK\x03\x04" + std::string(200, '\x14'), "");
  std::mt19937_64 dice{7};
  std::string noise;
  for (int i = 0; i < 65536; ++i) noise += static_cast<char>(dice());
  bad("noise.bin", noise, "");
  bad("noise.stl", noise, "");
  out.push_back({"byte_order_mark.xyz", "\xEF\xBB\xBF" + body, kCount, ""});
  out.push_back({"dos_lines.xyz",
                 [&] {
                   std::string dos;
                   for (const char c : body) dos += c == '\n' ? std::string{"\r\n"} : std::string(1, c);
                   return dos;
                 }(),
                 kCount, ""});
  out.push_back({"units_of_a_nanometre.xyz",
                 [&] {
                   Points tiny = points;
                   for (auto& p : tiny)
                     for (double& v : p) v *= 1e-6;
                   std::string text;
                   for (const auto& p : tiny) text += fmt::format("{} {} {}\n", p[0], p[1], p[2]);
                   return text;
                 }(),
                 kCount, ""});
  out.push_back({"far_away.xyz",
                 [&] {
                   Points far = points;
                   for (auto& p : far) p[0] += 1e9;
                   return lines_of(far);
                 }(),
                 kCount, ""});
  out.push_back({"one_point_far_off.xyz", body + "1e11 0 0\n", kCount + 1, ""});
  std::string same;
  for (int i = 0; i < 1000; ++i) same += "1 2 3\n";
  out.push_back({"all_in_one_place.xyz", same, 1, ""});
  out.push_back({"on_a_line.xyz",
                 [] {
                   std::string line;
                   for (int i = 0; i < 200; ++i) line += fmt::format("{} 0 0\n", i);
                   return line;
                 }(),
                 200, ""});
  out.push_back({"on_a_plane.xyz",
                 [] {
                   std::string plane;
                   for (int i = 0; i < 400; ++i) plane += fmt::format("{} {} 0\n", i % 20, i / 20);
                   return plane;
                 }(),
                 400, ""});
  out.push_back({"two_points.xyz", "0 0 0\n1 1 1\n", 2, ""});
}

void add_meshes(const Points& points, std::vector<HostileFile>& out) {
  const auto bad = [&](std::string name, std::string bytes, std::string says) {
    out.push_back({std::move(name), std::move(bytes), std::nullopt, std::move(says)});
  };
  bad("claims_1e18.off", "OFF\n1000000000000000000 1 0\n" + lines_of(points), "");
  bad("minus_one.off", "OFF\n-1 0 0\n" + lines_of(points), "");
  out.push_back({"face_of_4e9_corners.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4000000000 0 1 2\n", 3, ""});
  bad("unknown_kind.off", "4DOFF\n3 1 0\n0 0 0 0\n", "4DOFF");
  bad("two_numbers.obj", "v 1 2\n", "");
  bad("no_vertex.obj", "o nothing\nvn 0 0 1\n", "");
  bad("claims_4e9.stl", stl_binary(points, UINT32_MAX), "");
  bad("nan.stl", stl_binary(Points(3, {std::nan(""), 0, 0}), 1), "none of the 3 points");
  bad("no_end.stl", instead(stl_text(points), "endsolid a\n", ""), "endsolid");
  bad("claims_1e19_cells.ptx", ptx_head("4294967295", "4294967295") + lines_of(points), "");
  bad("matrix_of_nan.ptx", ptx_head("24", "10", "nan") + lines_of(points), "");
  bad("second_scan_is_prose.ptx", ptx_head("24", "10") + lines_of(points) + "and so on\n", "PTX scan 1");
}

void add_surveys(const Points& points, std::vector<HostileFile>& out) {
  const std::string logical =
      e57_logical(points, "<translation type=\"Structure\"><x type=\"Float\">1.5</x></translation>");
  const auto bad = [&](std::string name, std::string bytes, std::string says) {
    out.push_back({std::move(name), std::move(bytes), std::nullopt, std::move(says)});
  };
  const auto e57 = [&](std::string name, const std::string& content, std::string says) {
    bad(std::move(name), on_e57_pages(content), std::move(says));
  };
  const std::string paged = on_e57_pages(logical);
  bad("wrong_checksum.e57", with(paged, 700, "!"), "checksum");
  bad("last_page_missing.e57", paged.substr(0, paged.size() - 1024), "truncated");
  bad("page_size.e57", with(paged, 40, raw(std::uint64_t{1})), "pages");
  e57("version_2.e57", with(logical, 8, raw(std::uint32_t{2})), "version 2");
  e57("xml_beyond_the_end.e57", with(logical, 24, raw(UINT64_MAX - 9)), "");
  e57("xml_of_1e19_bytes.e57", with(logical, 32, raw(UINT64_MAX)), "");
  e57("claims_1e18.e57", instead(logical, "recordCount=\"240\"", "recordCount=\"1e9\""), "not a number");
  e57("not_xml.e57", instead(logical, "<e57Root", "<e57Root<"), "XML");
  e57("pose_of_nan.e57", instead(logical, ">1.5<", ">nan<"), "");
  e57("packet_of_no_kind.e57", with(logical, 80, "\x7F"), "kind 127");
  e57("packet_too_long.e57", with(logical, 82, "\xFF\xFF"), "");
  e57("stream_too_long.e57", with(logical, 86, "\xFF\xFF"), "");
  const std::string deep = [&] {
    std::string xml;
    for (int i = 0; i < 100000; ++i) xml += "<a>";
    return xml;
  }();
  std::string nested = instead(logical, "<data3D", deep + "<data3D");
  e57("nested_100000_deep.e57", with(nested, 32, raw(std::uint64_t{nested.size() - nested.find("<?xml")})), "XML");
  std::string laughs = instead(logical, "<e57Root", "<!DOCTYPE l [<!ENTITY a \"ha\"><!ENTITY b \"&a;&a;\">]><e57Root");
  out.push_back({"a_billion_laughs.e57",
                 on_e57_pages(with(laughs, 32, raw(std::uint64_t{laughs.size() - laughs.find("<?xml")}))), kCount, ""});

  const std::string good = las(points, 4);
  bad("compressed.laz", with(good, 104, "\x87"), "LAZ");
  bad("claims_1e19.las", with(good, 247, raw(UINT64_MAX)), "");
  bad("scale_of_nan.las", with(good, 131, raw(std::nan(""))), "scale");
  bad("scale_of_1e300.las", with(good, 131, raw(1e300)), "finite");
  bad("records_of_no_bytes.las", with(good, 105, raw(std::uint16_t{0})), "records of 0");
  bad("points_beyond_the_end.las", with(good, 96, raw(UINT32_MAX)), "");
  bad("points_within_the_header.las", with(good, 96, raw(std::uint32_t{10})), "");
  bad("version_9.las", with(good, 24, "\x09"), "LAS 9");
}

}  // namespace

std::vector<HostileFile> hostile_files() {
  const Points points = ball();
  std::vector<HostileFile> files;
  add_cuts(points, files);
  add_ply(points, files);
  add_pcd(points, files);
  add_text(points, files);
  add_meshes(points, files);
  add_surveys(points, files);
  return files;
}

}  // namespace telefab::test
