// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/formats/read_cloud.hpp>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <bit>
#include <cstring>
#include <string>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/formats/write_cloud.hpp>

namespace telefab::scan {
namespace {

using testing::AllOf;
using testing::HasSubstr;

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span{text}); }

Result<ScanFile> read(const std::string& content, std::string_view name = "scan") {
  return read_scan_file(bytes_of(content), name, {}, {});
}

template <class T>
void put(std::string& out, T value, bool big = false) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (big) std::reverse(raw, raw + sizeof(T));
  out.append(raw, sizeof(T));
}

std::string ply_head(std::string_view format, std::string_view elements) {
  return "ply\nformat " + std::string{format} + " 1.0\ncomment made in a test\n" + std::string{elements} +
         "end_header\n";
}
constexpr std::string_view kXyz = "property float x\nproperty float y\nproperty float z\n";

std::string pcd_head(std::string_view fields, std::string_view sizes, std::string_view types, int width, int height,
                     std::string_view encoding) {
  std::string count;
  for (std::size_t i = 0; i < sizes.size(); i += 2) count += " 1";
  const int points = width * height;
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS " + std::string{fields} + "\nSIZE " + std::string{sizes} + "\nTYPE " +
         std::string{types} + "\nCOUNT" + count + "\nWIDTH " + std::to_string(width) + "\nHEIGHT " +
         std::to_string(height) + "\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS " + std::to_string(points) + "\nDATA " +
         std::string{encoding} + "\n";
}

void expect_two_points(const Result<ScanFile>& file) {
  ASSERT_TRUE(file) << file.error().what;
  ASSERT_EQ(file->cloud.size(), 2U);
  EXPECT_EQ(file->cloud.points[0], Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(file->cloud.points[1], Eigen::Vector3f(-4, 5.5F, 6));
}

TEST(ReadPly, TakesTextWithAnyPropertyOrderAndSkipsFaces) {
  const auto file =
      read(ply_head("ascii",
                    "element vertex 2\nproperty uchar red\nproperty double z\nproperty double y\nproperty "
                    "double x\nelement face 1\nproperty list uchar int vertex_indices\n") +
           "9 3 2 1\n7 6 5.5 -4\n3 0 1 0\n");
  expect_two_points(file);
  EXPECT_FALSE(file->cloud.has_normals());
}

TEST(ReadPly, TakesBothByteOrdersWithMixedTypesAndLists) {
  for (const bool big : {false, true}) {
    std::string content = ply_head(big ? "binary_big_endian" : "binary_little_endian",
                                   "element first 1\nproperty list uchar short extra\nelement vertex 2\nproperty short "
                                   "z\nproperty list uchar float more\nproperty double x\nproperty float y\n");
    put<std::uint8_t>(content, 2), put<std::int16_t>(content, 7, big), put<std::int16_t>(content, 7, big);
    put<std::int16_t>(content, 3, big), put<std::uint8_t>(content, 1), put(content, 9.F, big), put(content, 1., big),
        put(content, 2.F, big);
    put<std::int16_t>(content, 6, big), put<std::uint8_t>(content, 0), put(content, -4., big), put(content, 5.5F, big);
    expect_two_points(read(content));
  }
}

TEST(ReadPly, TakesBinaryRecordsWithNormalsAndConfidence) {
  std::string content =
      ply_head("binary_little_endian",
               "element vertex 2\n" + std::string{kXyz} +
                   "property float nx\nproperty float ny\nproperty float nz\nproperty float confidence\n");
  for (const float f : {1.F, 2.F, 3.F, 0.F, 0.F, 2.F, 0.5F, -4.F, 5.5F, 6.F, 1.F, 0.F, 0.F, 1.F}) put(content, f);
  const auto file = read(content);
  expect_two_points(file);
  EXPECT_EQ(file->cloud.normals[0], Eigen::Vector3f(0, 0, 1)) << "made a unit vector";
  EXPECT_EQ(file->cloud.confidence, (std::vector<float>{0.5F, 1.F}));
}

TEST(ReadPly, TakesBackTheSheetsThatRegisteringFound) {
  PointCloud cloud;
  cloud.points = {{1, 2, 3}, {-4, 5.5F, 6}, {1, 2, 3}};
  cloud.confidence = {1, 0.5F, 1};
  cloud.sheets_apart = {0, 0.25F, 0.5F};
  const auto bytes = write_ply(cloud, {}, "x");
  const auto whole = read_scan_file(bytes, "a.ply", {}, {});
  ASSERT_TRUE(whole) << whole.error().what;
  EXPECT_EQ(whole->cloud.sheets_apart, cloud.sheets_apart);
  EXPECT_EQ(whole->cloud.confidence, cloud.confidence);
  EXPECT_EQ(without_duplicates(whole->cloud).sheets_apart, (std::vector<float>{0.5F, 0.25F})) << "the wider stays";
  EXPECT_EQ(scaled(whole->cloud, 2).sheets_apart, (std::vector<float>{0, 0.5F, 1}));
}

TEST(ReadPly, SkipsTriangleStripsAndRefusesStripsCutShort) {
  std::string content =
      ply_head("binary_little_endian", "element vertex 2\n" + std::string{kXyz} +
                                           "element tristrips 1\nproperty list int int vertex_indices\n");
  for (const float f : {1.F, 2.F, 3.F, -4.F, 5.5F, 6.F}) put(content, f);
  put<std::int32_t>(content, 3), put<std::int32_t>(content, 0), put<std::int32_t>(content, 1),
      put<std::int32_t>(content, -1);
  expect_two_points(read(content));
  content.resize(content.size() - 4);
  EXPECT_FALSE(read(content));
}

TEST(ReadPly, ReadsARangeGridIntoAView) {
  const std::string head =
      "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex 2\n" + std::string{kXyz} +
      "element range_grid 6\nproperty list uchar int vertex_indices\nend_header\n1 2 3\n-4 5.5 6\n";
  const auto file = read(head + "0\n1 1\n0\n1 0\n0\n0\n");
  expect_two_points(file);
  ASSERT_EQ(file->views.size(), 1U);
  EXPECT_EQ(file->views[0].at(0, 1), 1);
  EXPECT_EQ(file->views[0].at(1, 0), 0);
  EXPECT_EQ(file->views[0].at(1, 1), RangeView::kEmpty);
  EXPECT_FALSE(read(head + "0\n1 7\n0\n0\n0\n0\n")) << "the grid names a point that is not there";
}

TEST(ReadPly, SaysWhatIsWrong) {
  const std::string vertices = "element vertex 2\n" + std::string{kXyz};
  const std::pair<std::string, std::string> cases[] = {
      {"ply\nformat ascii 1.0\n", "end_header"},
      {ply_head("ascii", vertices), "truncated"},
      {ply_head("ascii", vertices) + "1 2 3\n4 5\n", "truncated"},
      {ply_head("ascii", vertices) + "1 2 3\n4 five 6\n", "'five' is not a number"},
      {ply_head("ascii", vertices) + "nan 2 3\n4 nan 6\n", "none of the 2 points is valid"},
      {ply_head("ascii", vertices) + "1 2\n3 4\n5 6\n", "line of its own"},
      {ply_head("ascii", vertices) + "1 2 3 4\n5 6\n", "more than the 3 values"},
      {ply_head("ascii", vertices) + "1 2 3\n1e300 5 6\n", "1e+300"},
      {ply_head("ascii", vertices) + "1 2 3\n1e999 5 6\n", "inf"},
      {ply_head("ascii", "element vertex 0\n" + std::string{kXyz}), "no point"},
      {ply_head("ascii", "element vertex 9223372036854775808\n" + std::string{kXyz}) + "1 2 3\n", "claims"},
      {ply_head("binary_little_endian", "element vertex 9223372036854775808\n" + std::string{kXyz}) + "123456789012",
       "claims"},
      {ply_head("binary_little_endian", "element vertex 99999999999999999999999\n" + std::string{kXyz}), "count"},
      {ply_head("ascii", "element vertex 1\nproperty float x\nproperty float y\n") + "1 2\n", "x, y and z"},
      {ply_head("ascii", "element vertex 1\nproperty quux x\n"), "unknown type 'quux'"},
      {ply_head("ascii", "element face 0\nproperty list uchar int i\n"), "vertex"},
      {ply_head("ternary", vertices), "unknown format"},
  };
  for (const auto& [content, message] : cases) {
    const auto file = read(content, "bad.ply");
    ASSERT_FALSE(file) << content;
    EXPECT_EQ(file.error().code, ErrorCode::InvalidInput);
    EXPECT_THAT(file.error().what, HasSubstr(message));
    EXPECT_THAT(file.error().what, HasSubstr("bad.ply"));
  }
}

TEST(ReadPly, RefusesEveryTruncationOfABinaryFile) {
  std::string content =
      ply_head("binary_little_endian",
               "element vertex 2\n" + std::string{kXyz} + "element face 1\nproperty list uchar int vertex_indices\n");
  for (const float f : {1.F, 2.F, 3.F, -4.F, 5.5F, 6.F}) put(content, f);
  put<std::uint8_t>(content, 2), put<std::int32_t>(content, 0), put<std::int32_t>(content, 1);
  ASSERT_TRUE(read(content));
  for (std::size_t size = 0; size < content.size(); ++size) EXPECT_FALSE(read(content.substr(0, size))) << size;
}

TEST(ReadPcd, TakesTextWithNormals) {
  const auto file = read(pcd_head("x y z normal_x normal_y normal_z", "4 4 4 4 4 4", "F F F F F F", 2, 1, "ascii") +
                         "1 2 3 0 0 1\n-4 5.5 6 0 1 0\n");
  expect_two_points(file);
  EXPECT_EQ(file->cloud.normals[1], Eigen::Vector3f(0, 1, 0));
}

TEST(ReadPcd, TakesBinaryWithPaddingFields) {
  std::string content = pcd_head("rgb z y x", "4 8 4 4", "U F F F", 2, 1, "binary");
  put<std::uint32_t>(content, 1), put(content, 3.), put(content, 2.F), put(content, 1.F);
  put<std::uint32_t>(content, 1), put(content, 6.), put(content, 5.5F), put(content, -4.F);
  expect_two_points(read(content));
}

std::string compressed_pcd(const std::string& packed, std::uint32_t size, int points) {
  std::string content = pcd_head("x y z", "4 4 4", "F F F", points, 1, "binary_compressed");
  put(content, static_cast<std::uint32_t>(packed.size())), put(content, size);
  return content + packed;
}

TEST(ReadPcd, ExpandsCompressedFields) {
  std::string raw;  // field by field; kept as literals, with one back reference at the end
  for (const float f : {1.F, -4.F, 2.F, 5.5F, 3.F, 3.F}) put(raw, f);
  std::string packed;
  packed += static_cast<char>(20 - 1);
  packed += raw.substr(0, 20);
  packed += static_cast<char>((4 - 2) << 5);
  packed += static_cast<char>(4 - 1);
  const auto file = read(compressed_pcd(packed, 24, 2));
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_EQ(file->cloud.points[0], Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(file->cloud.points[1], Eigen::Vector3f(-4, 5.5F, 3));
}

TEST(ReadPcd, RefusesDamagedCompression) {
  for (const auto& [packed, size] : {std::pair<std::string, std::uint32_t>{"\x1fshort", 24},
                                     {std::string(2, '\x40'), 24},
                                     {"", 24},
                                     {"x", 4294967295U},
                                     {std::string(1, '\xff'), 24}})
    EXPECT_FALSE(read(compressed_pcd(packed, size, 2)));
}

TEST(ReadPcd, LeavesOutPointsThatWereNotSeenAndKeepsTheGrid) {
  const auto file =
      read(pcd_head("x y z", "4 4 4", "F F F", 2, 2, "ascii") + "nan nan nan\n1 2 3\n-4 5.5 6\nnan nan nan\n");
  expect_two_points(file);
  EXPECT_EQ(file->empty_returns, 2U);
  ASSERT_EQ(file->views.size(), 1U);
  EXPECT_EQ(file->views[0].at(0, 0), RangeView::kEmpty);
  EXPECT_EQ(file->views[0].at(1, 0), 1);
  EXPECT_EQ(file->views[0].scanner, Vec3(1, 2, 3));
}

TEST(ReadPcd, RefusesHeadersThatDoNotAddUp) {
  EXPECT_FALSE(read(pcd_head("x y z", "4 4 4", "F F F", 1 << 30, 1, "binary") + "1234"));
  EXPECT_FALSE(read(pcd_head("x y z", "3 4 4", "F F F", 1, 1, "binary") + std::string(12, 'a')));
  EXPECT_FALSE(read(pcd_head("x y w", "4 4 4", "F F F", 1, 1, "ascii") + "1 2 3\n"));
  EXPECT_FALSE(read(pcd_head("x y z", "4 4 4", "F F F", 2, 1, "ascii") + "1 2 3\n"));
  EXPECT_FALSE(read(pcd_head("x y z", "4 4 4", "F F F", 1, 1, "ascii") + "nan nan nan\n")) << "no point left";
}

TEST(ReadText, TellsNormalsFromColours) {
  const auto with_normals = read("# a scan\n1 2 3 0 0 1\n-4 5.5 6 0.6 0.8 0\n");
  expect_two_points(with_normals);
  EXPECT_TRUE(with_normals->cloud.has_normals());
  const auto with_colours = read("x,y,z,r,g,b\n1,2,3,10,20,30\n-4,5.5,6,40,50,60\n");
  expect_two_points(with_colours);
  EXPECT_FALSE(with_colours->cloud.has_normals());
}

TEST(ReadText, ReadsACountThenPointsThenNormals) {
  const auto file = read("2\n1 2 3\n-4 5.5 6\n0 0 1\n0 1 0\n", "mask.pwn");
  expect_two_points(file);
  EXPECT_EQ(file->cloud.normals[1], Eigen::Vector3f(0, 1, 0));
  expect_two_points(read("2\n1 2 3 77\n-4 5.5 6 78\n", "cloud.pts"));
}

TEST(ReadText, SaysWhatIsWrongAndInWhichLine) {
  const std::pair<std::string, std::string> cases[] = {
      {"\n\n", "no point"},
      {"1 2 3\n4 5\n", "line 2"},
      {"1 2 3\n4 5 six\n", "'six'"},
      {"3\n1 2 3\n4 5 6\n", "truncated"},
      {"1 2\n", "3 or more"},
      {"2\n1 2 3\n4 5 6\n0 0 1\n", "normals"},
      {"-5\n1 2 3\n", "not a number of points"},
      {"1e18\n1 2 3\n", "not a number of points"},
      {"900000000000000\n1 2 3\n", "claims"},
      {std::string("\x7f"
                   "ELF\0\0",
                   6),
       "not known"},
      {"1 2 nan\n", "none of the 1 points"},
  };
  for (const auto& [content, message] : cases) {
    const auto file = read(content);
    ASSERT_FALSE(file) << content;
    EXPECT_THAT(file.error().what, HasSubstr(message)) << content;
  }
}

TEST(ReadCloud, NamesWhatPeopleTakeForAScanAndSaysWhatToDo) {
  const std::tuple<std::string, std::string, std::string> cases[] = {
      {"\x89PNG\r\n\x1a\n12345678", "a PNG picture", "export the scan"},
      {"\xFF\xD8\xFF\xE0 1 2 3", "a JPEG picture", "export the scan"},
      {"PK\x03\x04 1 2 3\n", "a ZIP archive", "unpack it"},
      {"\x1F\x8B\x08 1 2 3\n", "gzip", "unpack it"},
      {"ISO-10303-21;\nHEADER;\n", "a STEP model", "--sample-faces"},
      {"glTF\x02", "glTF scene", "PLY"},
      {"\xEF\xBB\xBF \n<?xml version=\"1.0\"?><svg/>", "XML", "PLY"},
      {"{\"asset\": {\"version\": \"2.0\"}}", "JSON", "PLY"},
      {"TFC1\r\n\x1a\n", "sliced already", "telefab-fab plan"},
  };
  for (const auto& [content, name, instead] : cases) {
    for (const char* file : {"a.ply", "a.xyz", "scan"}) {
      const auto refused = read(content, file);
      ASSERT_FALSE(refused) << content;
      EXPECT_THAT(refused.error().what, AllOf(HasSubstr(name), HasSubstr(instead), HasSubstr("E57"))) << content;
    }
  }
}

TEST(ReadOff, ReadsPlainColouredAndWithNormals) {
  expect_two_points(read("OFF\n# comment\n2 1 0\n1 2 3\n-4 5.5 6\n3 0 1 0\n"));
  expect_two_points(read("COFF 2 0 0\n1 2 3 255 0 0 255\n-4 5.5 6 255 0 0 255\n"));
  const auto file = read("NOFF\n2 0 0\n1 2 3 0 0 1\n-4 5.5 6 0 1 0\n");
  expect_two_points(file);
  EXPECT_EQ(file->cloud.normals[0], Eigen::Vector3f(0, 0, 1));
}

TEST(ReadOff, RefusesWhatItCannotHold) {
  EXPECT_FALSE(read("OFF\n9223372036854775807 0 0\n1 2 3\n"));
  EXPECT_FALSE(read("OFF\n2 1 0\n1 2 3\n-4 5.5 6\n"));
  EXPECT_FALSE(read("4OFF\n1 0 0\n1 2 3 4\n"));
  EXPECT_FALSE(read("OFF BINARY\n1 0 0\n"));
  EXPECT_FALSE(read("OFF\n"));
}

TEST(ReadObj, TakesVerticesAndNormalsThatBelongToThem) {
  const auto file = read("o part\nv 1 2 3\nvn 0 0 1\nv -4 5.5 6\nvn 0 1 0\nf 1//1 2//2 1//1\n");
  expect_two_points(file);
  EXPECT_TRUE(file->cloud.has_normals());
  const auto shared = read("v 1 2 3\nv -4 5.5 6\nvn 0 0 1\nvn 0 1 0\nf 1//2 2//2 1//1\n");
  expect_two_points(shared);
  EXPECT_FALSE(shared->cloud.has_normals()) << "normals by corner belong to no vertex";
  EXPECT_FALSE(read("v 1 2\n", "a.obj"));
}

std::string binary_stl(std::uint32_t claimed, int facets) {
  std::string content(80, ' ');
  put(content, claimed);
  for (int f = 0; f < facets; ++f) {
    for (const float v : {0.F, 0.F, 1.F, 1.F, 2.F, 3.F, -4.F, 5.5F, 6.F, 1.F, 2.F, 3.F}) put(content, v);
    put<std::uint16_t>(content, 0);
  }
  return content;
}

TEST(ReadStl, TakesCornersOfBinaryAndText) {
  const auto binary = read(binary_stl(2, 2));
  ASSERT_TRUE(binary) << binary.error().what;
  EXPECT_EQ(binary->cloud.size(), 6U);
  const std::string text =
      "solid s\nfacet normal 0 0 1\nouter loop\nvertex 1 2 3\nvertex -4 5.5 6\nvertex 1 2 "
      "3\nendloop\nendfacet\nendsolid s\n";
  const auto cloud = read_cloud(bytes_of(text), "s.stl", {}, {});
  ASSERT_TRUE(cloud) << cloud.error().what;
  EXPECT_EQ(cloud->size(), 2U) << "corners shared by facets are one point";
  EXPECT_FALSE(read(text.substr(0, 80), "s.stl")) << "cut short";
  EXPECT_FALSE(read(binary_stl(3, 2), "s.stl")) << "claims more than it holds";
  EXPECT_FALSE(read(std::string(20, ' ') + '\0', "s.stl"));
}

TEST(ReadPtx, PlacesEveryScanByItsMatrixAndKeepsItsGrid) {
  const std::string scan = "2\n2\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n";
  const auto file = read(scan + "1 0 0 0.5\n0 0 0 0\n0 2 0 0.5\n0 0 3 0.5\n");
  ASSERT_TRUE(file) << file.error().what;
  ASSERT_EQ(file->cloud.size(), 3U);
  EXPECT_EQ(file->cloud.origin + file->cloud.points[0].cast<double>(), Vec3(10, 21, 30));
  EXPECT_EQ(file->cloud.origin + file->cloud.points[1].cast<double>(), Vec3(8, 20, 30));
  EXPECT_EQ(file->views.at(0).at(0, 1), 1) << "a PTX grid runs column by column";
  EXPECT_EQ(file->views.at(0).scanner, Vec3(10, 20, 30));
  EXPECT_FALSE(read(scan + "1 0 0 0.5\n0 0 0 0\n0 2 0 0.5\n"));
}

TEST(ReadCloud, MergesDuplicatesAndAveragesTheirNormals) {
  const std::string text = "1 2 3 0 0 1\n-4 5.5 6 0 1 0\n1 2 3 0 1 0\n";
  const auto cloud = read_cloud(bytes_of(text), "a.xyz", {}, {});
  ASSERT_TRUE(cloud);
  ASSERT_EQ(cloud->size(), 2U);
  EXPECT_TRUE(cloud->normals[0].isApprox(Eigen::Vector3f(0, 1, 1).normalized()));
}

TEST(ReadCloud, DropsNormalsThatAreMostlyMissing) {
  const std::string text = ply_head("ascii", "element vertex 2\n" + std::string{kXyz} +
                                                 "property float nx\nproperty float ny\nproperty float nz\n") +
                           "1 2 3 0 0 1\n-4 5.5 6 0 0 0\n";
  const auto cloud = read_cloud(bytes_of(text), "a.ply", {}, {});
  ASSERT_TRUE(cloud);
  EXPECT_FALSE(cloud->has_normals());
}

TEST(ReadCloud, KeepsMicrometresOfCoordinatesFarFromTheOrigin) {
  const auto cloud = read_cloud(
      bytes_of(std::string{"637012.240001 849028.310000 431.66\n637012.240002 849029.31 432.66\n"}), "far.xyz", {}, {});
  ASSERT_TRUE(cloud);
  const Vec3 first = cloud->origin + cloud->points[0].cast<double>();
  EXPECT_NEAR(first.x(), 637012.240001, 1e-6);
}

TEST(ReadCloud, StopsWhenAsked) {
  std::stop_source stop;
  stop.request_stop();
  const auto cloud = read_cloud(bytes_of(std::string{"1 2 3\n"}), "a.xyz", {}, stop.get_token());
  ASSERT_FALSE(cloud);
  EXPECT_EQ(cloud.error().code, ErrorCode::Cancelled);
}

TEST(ReadCloud, RefusesMorePointsThanAllowed) {
  const auto cloud = read_cloud(bytes_of(std::string{"1 2 3\n4 5 6\n"}), "a.xyz", {.max_points = 1}, {});
  ASSERT_FALSE(cloud);
  EXPECT_EQ(cloud.error().code, ErrorCode::TooLarge);
}

TEST(ReadCloud, RefusesAnEmptyFile) {
  const auto cloud = read_cloud({}, "a.ply", {}, {});
  ASSERT_FALSE(cloud);
  EXPECT_THAT(cloud.error().what, HasSubstr("empty"));
}

}  // namespace
}  // namespace telefab::scan
