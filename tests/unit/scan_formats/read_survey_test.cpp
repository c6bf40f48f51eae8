// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <bit>
#include <cmath>
#include <numeric>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/test/e57_file.hpp>
#include <telefab/test/las_file.hpp>

// E57 and LAS, the formats of survey scanners.
namespace telefab::scan {
namespace {

using test::E57Column;
using test::E57File;
using testing::HasSubstr;

Result<ScanFile> read(const std::string& content, const ReadOptions& options = {}) {
  return read_scan_file(std::as_bytes(std::span{content}), "scan", options, {});
}

std::string why(const std::string& content) {
  const auto file = read(content);
  return file ? "no error" : file.error().what;
}

constexpr std::array kX{1., -4., 7.}, kY{2., 5.5, 8.}, kZ{3., 6., -9.};
constexpr std::string_view kQuarterTurn =
    "<rotation type=\"Structure\"><w type=\"Float\">0.70710678118654752</w><z "
    "type=\"Float\">7.0710678118654752e-01</z></rotation><translation type=\"Structure\"><x "
    "type=\"Float\">10</x><y type=\"Float\"/></translation>";

void expect_three_points(const Result<ScanFile>& file) {
  ASSERT_TRUE(file) << file.error().what;
  ASSERT_EQ(file->cloud.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_LT((file->cloud.points[i].cast<double>() + file->cloud.origin - Vec3{kX[i], kY[i], kZ[i]}).norm(), 1e-5);
}

std::vector<E57Column> three_doubles() {
  return {test::e57_doubles("cartesianX", kX), test::e57_doubles("cartesianY", kY),
          test::e57_doubles("cartesianZ", kZ)};
}

std::string e57_of(const std::vector<E57Column>& columns, std::uint64_t records, std::string_view pose = "") {
  E57File file;
  file.add_scan(columns, records, pose);
  return file.bytes();
}

TEST(ReadE57, TakesFloatsOfBothLengthsAndStatesMetres) {
  const auto file = read(e57_of(
      {test::e57_doubles("cartesianX", kX), test::e57_floats("cartesianY", kY), test::e57_floats("cartesianZ", kZ)},
      3));
  expect_three_points(file);
  EXPECT_EQ(file->cloud.unit_mm, 1000);
  EXPECT_EQ(name_of(file->format), "E57");
}

TEST(ReadE57, UnpacksIntegersOfEveryWidthAcrossPacketsAndPages) {
  constexpr std::size_t kPoints = 1000;
  for (const unsigned bits : {3U, 8U, 13U, 31U, 33U, 57U, 61U, 63U, 64U}) {
    const std::int64_t least = -(std::int64_t{1} << (bits - 2U));
    const std::int64_t most =
        bits == 64 ? INT64_MAX
                   : static_cast<std::int64_t>(static_cast<std::uint64_t>(least) + ((std::uint64_t{1} << bits) - 1));
    std::vector<std::int64_t> values;
    for (std::size_t i = 0; i < kPoints; ++i)
      values.push_back(i % 2 ? least + static_cast<std::int64_t>(i % 5) : most - static_cast<std::int64_t>(i % 3));
    const double scale = std::exp2(-static_cast<double>(bits));
    const std::vector<double> height(kPoints, 1);
    E57File file;
    file.add_scan(
        {test::e57_integers("intensity", values, least, most),
         test::e57_scaled("cartesianX", values, least, most, scale, 0.5),
         test::e57_scaled("cartesianY", values, least, most, scale, 0), test::e57_floats("cartesianZ", height)},
        kPoints, "", 61);
    const auto scan = read(file.bytes());
    ASSERT_TRUE(scan) << scan.error().what;
    ASSERT_EQ(scan->cloud.size(), kPoints);
    for (std::size_t i = 0; i < kPoints; ++i) {
      const Vec3 p = scan->cloud.points[i].cast<double>() + scan->cloud.origin;
      ASSERT_NEAR(p.y(), static_cast<double>(values[i]) * scale, 1e-6) << bits << " bits, point " << i;
      ASSERT_NEAR(p.x(), p.y() + 0.5, 1e-6);
    }
  }
}

TEST(ReadE57, MovesPointsAndNormalsByThePoseOfTheirScan) {
  const std::array<double, 3> one{1, 1, 1}, none{0, 0, 0};
  auto columns = three_doubles();
  columns.push_back(test::e57_floats("nor:normalX", one));
  columns.push_back(test::e57_floats("nor:normalY", none));
  columns.push_back(test::e57_floats("nor:normalZ", none));
  const auto file = read(e57_of(columns, 3, kQuarterTurn));
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_LT((file->cloud.points[0] - Eigen::Vector3f{8, 1, 3}).norm(), 1e-5F);
  ASSERT_TRUE(file->cloud.has_normals());
  EXPECT_LT((file->cloud.normals[0] - Eigen::Vector3f::UnitY()).norm(), 1e-5F);
}

TEST(ReadE57, JoinsScansAndDropsNormalsThatOnlySomeHave) {
  const std::array<double, 3> one{1, 1, 1};
  E57File file;
  auto columns = three_doubles();
  file.add_scan(columns, 3);
  columns.push_back(test::e57_floats("nor:normalX", one));
  columns.push_back(test::e57_floats("nor:normalY", one));
  columns.push_back(test::e57_floats("nor:normalZ", one));
  file.add_scan(columns, 3);
  file.add_scan({}, 0);  // a scan without points is none
  const auto scan = read(file.bytes());
  ASSERT_TRUE(scan) << scan.error().what;
  EXPECT_EQ(scan->cloud.size(), 6U);
  EXPECT_FALSE(scan->cloud.has_normals());
}

TEST(ReadE57, TakesSphericalCoordinates) {
  const std::array<double, 1> range{2}, azimuth{std::acos(0.)}, elevation{std::asin(0.5)};
  const auto file =
      read(e57_of({test::e57_doubles("sphericalRange", range), test::e57_doubles("sphericalAzimuth", azimuth),
                   test::e57_doubles("sphericalElevation", elevation)},
                  1));
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_LT((file->cloud.points[0].cast<double>() + file->cloud.origin - Vec3{0, std::sqrt(3.), 1}).norm(), 1e-6);
}

TEST(ReadE57, LeavesOutInvalidPointsAndKeepsTheGrid) {
  const std::vector<std::int64_t> invalid{0, 2, 0}, row{0, 1, 1}, column{0, 1, 1};
  auto columns = three_doubles();
  columns.push_back(test::e57_integers("cartesianInvalidState", invalid, 0, 2));
  columns.push_back(test::e57_integers("rowIndex", row, 0, 1));
  columns.push_back(test::e57_integers("columnIndex", column, 0, 1));
  const auto file = read(e57_of(columns, 3, kQuarterTurn));
  ASSERT_TRUE(file) << file.error().what;
  EXPECT_EQ(file->cloud.size(), 2U);
  EXPECT_EQ(file->empty_returns, 1U);
  ASSERT_EQ(file->views.size(), 1U);
  EXPECT_EQ(file->views[0].at(0, 0), 0);
  EXPECT_EQ(file->views[0].at(1, 1), 1);
  EXPECT_EQ(file->views[0].at(0, 1), RangeView::kEmpty);
  ASSERT_TRUE(file->views[0].scanner);
  EXPECT_EQ(*file->views[0].scanner, Vec3(10, 0, 0));
}

TEST(ReadE57, NamesThePageThatIsDamaged) {
  std::string bytes = e57_of(three_doubles(), 3);
  bytes[bytes.size() - 600] = static_cast<char>(bytes[bytes.size() - 600] ^ 1);
  EXPECT_THAT(why(bytes), HasSubstr("checksum"));
  EXPECT_THAT(why(bytes), HasSubstr("E57 page " + std::to_string(bytes.size() / 1024 - 1)));
}

TEST(ReadE57, RefusesEveryTruncation) {
  const std::string bytes = e57_of(three_doubles(), 3);
  for (std::size_t length = 9; length < bytes.size(); length += 7)
    EXPECT_THAT(why(bytes.substr(0, length)), HasSubstr("truncated")) << length;
}

TEST(ReadE57, SaysWhatIsWrong) {
  const auto damaged = [](std::string_view from, std::string_view to) {
    E57File file;
    file.add_scan(three_doubles(), 3, kQuarterTurn);
    std::string logical = file.logical();
    const std::size_t at = logical.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    EXPECT_EQ(from.size(), to.size());
    return why(test::on_e57_pages(logical.replace(at, from.size(), to)));
  };
  EXPECT_THAT(damaged("recordCount=\"3\"", "recordCount=\"4\""), HasSubstr("only 3 values"));
  EXPECT_THAT(damaged("recordCount=\"3\"", "recordCount=\"x\""), HasSubstr("not a number"));
  EXPECT_THAT(damaged("fileOffset=\"48\"", "fileOffset=\"56\""), HasSubstr("begins no section"));
  EXPECT_THAT(damaged("fileOffset=\"48\"", "fileOffset=\"1e\""), HasSubstr("not a number"));
  EXPECT_THAT(damaged("<cartesianX", "<cartesianA"), HasSubstr("without cartesian or spherical"));
  EXPECT_THAT(damaged("0.70710678118654752", "1.70710678118654752"), HasSubstr("quaternion"));
  EXPECT_THAT(damaged("</e57Root>", "</e57Roof>"), HasSubstr("XML section is damaged"));
  EXPECT_THAT(damaged("type=\"Float\"/><cartesianY", "type=\"Fleet\"/><cartesianY"), HasSubstr("Fleet"));
}

TEST(ReadE57, RefusesSectionsThatOverlapAndClaimsBeyondTheFile) {
  E57File file;
  file.add_scan(three_doubles(), 3);
  std::string logical = file.logical();
  EXPECT_THAT(
      why(test::on_e57_pages(std::string{logical}.replace(logical.find("recordCount=\"3\""), 15, "recordCount=\"9\""))),
      HasSubstr("only 3 values"));
  E57File huge;
  huge.add_scan(three_doubles(), UINT64_MAX);
  EXPECT_THAT(why(huge.bytes()), HasSubstr("claims"));
  // one section named by many scans
  const std::vector<double> many(1000, 1);
  E57File one;
  one.add_scan({test::e57_doubles("cartesianX", many), test::e57_doubles("cartesianY", many),
                test::e57_doubles("cartesianZ", many)},
               many.size());
  logical = one.logical();
  const std::size_t from = logical.find("<vectorChild"), to = logical.find("</data3D>");
  const std::string child = logical.substr(from, to - from);
  std::string bomb = logical.substr(0, to);
  for (int i = 0; i < 100; ++i) bomb += child;
  bomb += logical.substr(to);
  const auto length = std::bit_cast<std::array<char, 8>>(std::uint64_t{bomb.size() - logical.find("<?xml")});
  std::copy(length.begin(), length.end(), bomb.begin() + 32);
  EXPECT_THAT(why(test::on_e57_pages(bomb)), HasSubstr("longer than the file"));
}

TEST(ReadE57, RefusesPositionsWithoutBits) {
  const std::vector<std::int64_t> zeros(3, 0);
  EXPECT_THAT(why(e57_of({test::e57_integers("cartesianX", zeros, 0, 0), test::e57_integers("cartesianY", zeros, 0, 0),
                          test::e57_integers("cartesianZ", zeros, 0, 1)},
                         3)),
              HasSubstr("hold no scan"));
}

constexpr std::array<std::array<std::int32_t, 3>, 3> kLas{
    {{1000, 2000, 3000}, {-4000, 5500, 6000}, {7000, 8000, -9000}}};

TEST(ReadLas, TakesEveryPointFormatOfEveryVersion) {
  for (std::uint8_t minor = 0; minor <= 4; ++minor)
    for (std::uint8_t format = 0; format <= 10; ++format) {
      const auto file = read(test::las_file(kLas, {.minor = minor, .format = format, .extra_bytes = 7}));
      expect_three_points(file);
      EXPECT_EQ(file->cloud.unit_mm, 1000);
    }
}

TEST(ReadLas, ScalesAndShiftsAndKeepsMillimetresFarFromTheOrigin) {
  const auto file = read(test::las_file(kLas, {.scale = {0.001, 0.01, 0.1}, .offset = {600000, 5000000, -20}}));
  ASSERT_TRUE(file) << file.error().what;
  const Vec3 p = file->cloud.points[1].cast<double>() + file->cloud.origin;
  EXPECT_LT((p - Vec3{599996, 5000055, 580}).norm(), 1e-3);
}

TEST(ReadLas, LeavesOutWithheldPoints) {
  for (const std::uint8_t format : {std::uint8_t{3}, std::uint8_t{7}}) {
    const auto file = read(test::las_file(kLas, {.minor = 4, .format = format, .withheld = 1}));
    ASSERT_TRUE(file) << file.error().what;
    EXPECT_EQ(file->cloud.size(), 2U);
    EXPECT_EQ(file->empty_returns, 1U);
  }
}

TEST(ReadLas, SaysWhatIsWrong) {
  const std::string good = test::las_file(kLas, {.minor = 4, .format = 6});
  const auto with = [&](std::size_t at, std::string_view bytes) {
    std::string out = good;
    return why(out.replace(at, bytes.size(), bytes));
  };
  EXPECT_THAT(with(104, "\x86"), HasSubstr("LAZ"));
  EXPECT_THAT(with(104, "\x0B"), HasSubstr("point format 11"));
  EXPECT_THAT(with(25, "\x05"), HasSubstr("LAS 1.5"));
  EXPECT_THAT(with(105, std::string_view{"\x04\x00", 2}), HasSubstr("records of 4 bytes"));
  EXPECT_THAT(with(96, "\xFF\xFF\xFF\x7F"), HasSubstr("puts the points"));
  EXPECT_THAT(with(131, std::string_view{"\0\0\0\0\0\0\0\0", 8}), HasSubstr("scale not 0"));
  EXPECT_THAT(with(247, "\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF"), HasSubstr("truncated"));
  EXPECT_THAT(why(good.substr(0, 100)), HasSubstr("truncated"));
  EXPECT_THAT(why(good.substr(0, good.size() - 1)), HasSubstr("truncated"));
}

}  // namespace
}  // namespace telefab::scan
