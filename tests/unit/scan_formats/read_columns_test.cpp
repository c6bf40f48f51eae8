// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fmt/format.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <telefab/scan/formats/read_cloud.hpp>
#include <vector>

// What people's exports look like: marks between columns, titles, colours, decimal commas, cells that saw nothing.
namespace telefab::scan {
namespace {

using testing::HasSubstr;

Result<ScanFile> read(const std::string& content, std::string_view name = "scan") {
  return read_scan_file(std::as_bytes(std::span{content}), name, {}, {});
}

std::string why(const std::string& content) {
  const auto file = read(content);
  return file ? "no error" : file.error().what;
}

bool has(const Result<ScanFile>& file, ScanRemark remark) {
  return std::any_of(file->cloud.notes.begin(), file->cloud.notes.end(),
                     [&](const ScanNote& n) { return n.remark == remark; });
}

/// Points of a ball about (12, -34, 5), so that no column is like another and all signs occur.
struct Ball {
  std::vector<Vec3> points, normals;
};
Ball ball(std::size_t count = 60) {
  Ball made;
  std::mt19937_64 dice{5};
  for (std::size_t i = 0; i < count; ++i) {
    Vec3 n;
    for (int axis = 0; axis < 3; ++axis) n[axis] = static_cast<double>(dice() % 2001) / 1000 - 1;
    n.normalize();
    made.normals.push_back(n);
    made.points.push_back(Vec3{12, -34, 5} + 3.5 * n);
  }
  return made;
}

std::string with_comma(std::string number) {
  std::replace(number.begin(), number.end(), '.', ',');
  return number;
}

void expect_ball(const Result<ScanFile>& file, const Ball& truth, const std::string& what) {
  ASSERT_TRUE(file) << what << ": " << file.error().what;
  ASSERT_EQ(file->cloud.size(), truth.points.size()) << what;
  for (std::size_t i = 0; i < truth.points.size(); ++i)
    ASSERT_LT((file->cloud.origin + file->cloud.points[i].cast<double>() - truth.points[i]).norm(), 1e-3)
        << what << ", point " << i;
}

struct Column {
  std::string title;
  char what;  ///< x y z: position; u v w: normal; i: id; c: colour; t: text; s: a share
};

/// A table of the ball with the columns in the order given.
std::string table(const Ball& truth, const std::vector<Column>& columns, const std::string& mark, bool titled,
                  bool comma = false) {
  std::string text;
  const auto end_of = [&](std::size_t k) { return k + 1 < columns.size() ? mark : std::string{"\n"}; };
  for (std::size_t k = 0; titled && k < columns.size(); ++k) text += columns[k].title + end_of(k);
  for (std::size_t i = 0; i < truth.points.size(); ++i)
    for (std::size_t k = 0; k < columns.size(); ++k) {
      const Vec3 &p = truth.points[i], &n = truth.normals[i];
      std::string cell;
      switch (columns[k].what) {
        case 'x':
          cell = fmt::format("{:.4f}", p.x());
          break;
        case 'y':
          cell = fmt::format("{:.4f}", p.y());
          break;
        case 'z':
          cell = fmt::format("{:.4f}", p.z());
          break;
        case 'u':
          cell = fmt::format("{:.4f}", n.x());
          break;
        case 'v':
          cell = fmt::format("{:.4f}", n.y());
          break;
        case 'w':
          cell = fmt::format("{:.4f}", n.z());
          break;
        case 'i':
          cell = std::to_string(i + 1);
          break;
        case 'c':
          cell = std::to_string((37 * i) % 256);
          break;
        case 't':
          cell = fmt::format("P{}", i);
          break;
        default:
          cell = fmt::format("{:.2f}", static_cast<double>(i % 10) / 10);
      }
      text += (comma ? with_comma(cell) : cell) + end_of(k);
    }
  return text;
}

const Column kX{"x", 'x'}, kY{"y", 'y'}, kZ{"z", 'z'}, kU{"nx", 'u'}, kV{"ny", 'v'}, kW{"nz", 'w'}, kId{"id", 'i'},
    kIntensity{"intensity", 's'}, kRed{"r", 'c'}, kGreen{"g", 'c'}, kBlue{"b", 'c'}, kName{"name", 't'};

TEST(TitledColumns, AreFoundInEveryOrderAndBehindEveryMark) {
  const Ball truth = ball();
  std::vector<Column> columns{kX, kY, kZ, kU, kV, kW, kId, kIntensity, kRed, kGreen, kBlue, kName};
  std::mt19937_64 dice{11};
  for (int round = 0; round < 40; ++round) {
    for (std::size_t k = columns.size() - 1; k > 0; --k) std::swap(columns[k], columns[dice() % (k + 1)]);
    for (const std::string mark : {",", ";", "\t", " ", ", "}) {
      const std::string text = table(truth, columns, mark, true);
      const auto file = read(text);
      expect_ball(file, truth, text.substr(0, 200));
      ASSERT_TRUE(file->cloud.has_normals());
      for (std::size_t i = 0; i < truth.points.size(); ++i)
        ASSERT_LT((file->cloud.normals[i].cast<double>() - truth.normals[i]).norm(), 1e-3);
    }
  }
}

TEST(TitledColumns, GoByManyNames) {
  const Ball truth = ball();
  using Names = std::array<std::string, 3>;
  for (const Names& names :
       {Names{"X", "Y", "Z"}, Names{"X [mm]", "Y [mm]", "Z [mm]"}, Names{"Point X", "Point Y", "Point Z"},
        Names{"//X", "Y", "Z"}, Names{"Points:0", "Points:1", "Points:2"}, Names{"\"x\"", "\"y\"", "\"z\""},
        Names{"Easting", "Northing", "Elevation"}, Names{"x_coord", "y_coord", "z_coord"},
        Names{"pos_x", "pos_y", "pos_z"}, Names{"X(m)", "Y(m)", "Z(m)"}}) {
    const std::vector<Column> columns{{"n", 'i'}, {names[0], 'x'}, {names[2], 'z'}, {names[1], 'y'}};
    if (names[0].starts_with("//")) continue;
    for (const std::string mark : {",", ";", "\t"})
      expect_ball(read(table(truth, columns, mark, true)), truth, names[0]);
  }
  expect_ball(read("//X Z Y\n" + table(truth, {kX, kZ, kY}, " ", false)), truth, "a title behind two strokes");
  expect_ball(read("# x z y\n" + table(truth, {kX, kZ, kY}, " ", false)), truth, "a title in a comment");
  expect_ball(read("Point X Point Z Point Y\n" + table(truth, {kX, kZ, kY}, " ", false)), truth, "two words a title");
  expect_ball(read("sep=;\n" + table(truth, {kX, kZ, kY}, ";", true)), truth, "a line for spreadsheets");
  EXPECT_EQ(read("X [m],Y [m],Z [m]\n0.1,0.2,0.3\n")->cloud.unit_mm, 1000) << "the titles state the unit";
}

TEST(TitledColumns, AreRefusedWhereTheyDoNotTell) {
  const std::string rows = "1.5,2.5,3.5,4.5\n5.5,6.5,7.5,8.5\n";
  EXPECT_THAT(why("a,b,c,d\n" + rows), HasSubstr("do not name x, y and z"));
  EXPECT_THAT(why("x,y,z,x\n" + rows), HasSubstr("once each"));
  EXPECT_THAT(why("latitude,longitude,altitude,id\n" + rows), HasSubstr("do not name x, y and z"));
  EXPECT_THAT(why("x,y,z\n" + rows), HasSubstr("3 titles"));
  EXPECT_THAT(why("x,y,z\n1,five,3\n2,4,5\n"), HasSubstr("'five' is not a number"));
}

TEST(UntitledColumns, LeaveOutARunningNumber) {
  const Ball truth = ball();
  for (const std::string mark : {",", " ", ";", "\t"}) {
    const auto file = read(table(truth, {kId, kX, kY, kZ}, mark, false));
    expect_ball(file, truth, mark);
    EXPECT_TRUE(has(file, ScanRemark::GuessedColumns));
  }
}

TEST(UntitledColumns, TellNormalsFromColours) {
  const Ball truth = ball();
  const auto colours = [&](const std::string& triple) {
    std::string text;
    for (const Vec3& p : truth.points) text += fmt::format("{:.4f} {:.4f} {:.4f} {}\n", p.x(), p.y(), p.z(), triple);
    return read(text);
  };
  for (const std::string triple : {"1 0 0", "0 1 0", "0.577 0.577 0.577", "1 0 0 0.5", "-1 0 0"}) {
    const auto file = colours(triple);
    expect_ball(file, truth, triple);
    EXPECT_FALSE(file->cloud.has_normals()) << triple;
    EXPECT_TRUE(has(file, ScanRemark::NotNormals)) << triple;
  }
  for (const std::string triple : {"255 0 0", "0.2 0.4 0.1", "255 255 255"})
    EXPECT_FALSE(colours(triple)->cloud.has_normals());
  const auto given = read(table(truth, {kX, kY, kZ, kU, kV, kW}, " ", false));
  expect_ball(given, truth, "normals");
  EXPECT_TRUE(given->cloud.has_normals());
  EXPECT_TRUE(read(table(truth, {kX, kY, kZ, kRed, kGreen, kBlue, kU, kV, kW}, " ", false))->cloud.has_normals());

  std::string pure;  // every point red, green or blue
  for (std::size_t i = 0; i < truth.points.size(); ++i)
    pure += fmt::format("{:.4f} {:.4f} {:.4f} {} {} {}\n", truth.points[i].x(), truth.points[i].y(),
                        truth.points[i].z(), i % 3 == 0 ? 1 : 0, i % 3 == 1 ? 1 : 0, i % 3 == 2 ? 1 : 0);
  EXPECT_FALSE(read(pure)->cloud.has_normals());
}

TEST(GivenNormals, AreDroppedWhereAllAreTheSame) {
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 60\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\nend_header\n";
  for (const Vec3& p : ball().points) text += fmt::format("{:.4f} {:.4f} {:.4f} 0 0 1\n", p.x(), p.y(), p.z());
  const auto file = read(text);
  expect_ball(file, ball(), "constant normals");
  EXPECT_FALSE(file->cloud.has_normals());
  EXPECT_TRUE(has(file, ScanRemark::NotNormals));
}

TEST(DecimalCommas, AreReadBehindEveryMarkThatIsNoComma) {
  const Ball truth = ball();
  for (const std::string mark : {";", " ", "\t", "; ", "  ", ", "})
    for (const bool titled : {true, false})
      for (const auto& columns : {std::vector<Column>{kX, kY, kZ}, {kX, kY, kZ, kU, kV, kW}, {kX, kY, kZ, kRed}}) {
        const auto file = read(table(truth, columns, mark, titled, true));
        expect_ball(file, truth, "'" + mark + "'");
        EXPECT_TRUE(has(file, ScanRemark::DecimalComma));
        EXPECT_EQ(file->cloud.has_normals(), columns.size() == 6);
      }
}

TEST(DecimalCommas, AreReadInEveryFormatThatPartsNumbersByBlanks) {
  const Ball truth = ball();
  const std::string rows = table(truth, {kX, kY, kZ}, " ", false, true);
  const auto behind = [&](const std::string& word) {
    std::string text;
    for (std::size_t at = 0; at < rows.size();) {
      const std::size_t end = rows.find('\n', at);
      text += word + rows.substr(at, end - at) + "\n";
      at = end + 1;
    }
    return text;
  };
  const std::string xyz = "property float x\nproperty float y\nproperty float z\n";
  for (const std::string& text :
       {"ply\nformat ascii 1.0\nelement vertex 60\n" + xyz + "end_header\n" + rows,
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA ascii\n" +
            rows,
        "OFF\n60 0 0\n" + rows, behind("v "), "60\n" + rows,
        "6\n10\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1,0 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n" + rows}) {
    const auto file = read(text);
    expect_ball(file, truth, text.substr(0, 60));
    EXPECT_TRUE(has(file, ScanRemark::DecimalComma)) << text.substr(0, 60);
  }
}

TEST(DecimalCommas, AreRefusedByNameWhereTheyCannotBeTold) {
  const Ball truth = ball();
  for (const bool titled : {true, false}) {
    const std::string text = table(truth, {kX, kY, kZ}, ",", titled, true);
    EXPECT_THAT(why(text), HasSubstr("decimal comma")) << text.substr(0, 80);
  }
  EXPECT_THAT(why("1.234,56 2.345,67 3.456,78\n1.234,56 2.345,67 3.456,78\n"), HasSubstr("decimal comma"));
  EXPECT_THAT(why("1,234.56 2,345.67 3,456.78\n1,234.56 2,345.67 3,456.78\n"), HasSubstr("decimal comma"));
  EXPECT_THAT(why("1,5 2.5 3,5\n1,5 2.5 3,5\n"), HasSubstr("decimal comma"));
  EXPECT_THAT(why("ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float "
                  "z\nend_header\n1,5,2,5,3,5\n4,5,5,5,6,5\n"),
              HasSubstr("decimal comma"));
}

TEST(Commas, StillPartColumns) {
  const Ball truth = ball();
  expect_ball(read(table(truth, {kX, kY, kZ, kRed, kGreen, kBlue}, ",", false)), truth, "comma");
  expect_ball(read(table(truth, {kX, kY, kZ}, ", ", false)), truth, "comma and blank");
  const auto whole = read("10,20,30,255,0,0\n11,21,31,255,0,0\n12,20,33,1,2,3\n");
  ASSERT_TRUE(whole) << whole.error().what;
  EXPECT_EQ(whole->cloud.origin + whole->cloud.points[1].cast<double>(), Vec3(11, 21, 31));
  const auto mixed = read("1.5,2.5,3.5 255 0 0\n4.5,5.5,6.5 0 255 0\n");
  ASSERT_TRUE(mixed) << mixed.error().what;
  EXPECT_EQ(mixed->cloud.points[1], Eigen::Vector3f(4.5F, 5.5F, 6.5F));
}

TEST(PointsOfNaN, AreLeftOutAndCounted) {
  const Ball truth = ball();
  std::string rows = table(truth, {kX, kY, kZ, kU, kV, kW}, " ", false);
  rows = "nan nan nan nan nan nan\n" + rows + "1 NaN 2 0 0 1\n";
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 62\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\nend_header\n";
  std::string noff = "NOFF\n62 0 0\n" + rows;
  for (const std::string& text :
       {rows, "62\n" + rows, head + rows, noff, "x,y,z\n,,\n" + table(truth, {kX, kY, kZ}, ",", false) + "1,NA,2\n"}) {
    const auto file = read(text);
    expect_ball(file, truth, text.substr(0, 40));
    EXPECT_EQ(file->empty_returns, 2U);
    EXPECT_TRUE(has(file, ScanRemark::PointsLeftOut));
    if (file->cloud.has_normals()) {
      EXPECT_LT((file->cloud.normals[0].cast<double>() - truth.normals[0]).norm(), 1e-3) << "normals stay with points";
    }
  }
}

TEST(CellsOfZero, AreNoPoints) {
  const Ball truth = ball();
  const std::string rows = "0 0 0\n" + table(truth, {kX, kY, kZ}, " ", false) + "0 0 0\n0 0 0\n0 0 0\n";
  const auto grid = read(
      "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 16\nHEIGHT 4\nPOINTS 64\nDATA ascii\n" +
      rows);
  expect_ball(grid, truth, "organised PCD");
  EXPECT_EQ(grid->views.at(0).at(0, 0), RangeView::kEmpty);
  EXPECT_EQ(grid->views.at(0).at(0, 1), 0);
  std::string heap;
  for (int i = 0; i < 30; ++i) heap += "0 0 0\n";
  expect_ball(read(heap + rows.substr(6)), truth, "a heap of zeros in plain text");
  const auto lone = read("0 0 0\n" + table(truth, {kX, kY, kZ}, " ", false));
  EXPECT_EQ(lone->cloud.size(), truth.points.size() + 1) << "one point may lie there";
}

TEST(Pts, HoldsSeveralScans) {
  const Ball truth = ball();
  const std::string rows = table(truth, {kX, kY, kZ, kIntensity, kRed, kGreen, kBlue}, " ", false);
  const std::size_t half = [&] {
    std::size_t at = 0;
    for (int i = 0; i < 25; ++i) at = rows.find('\n', at) + 1;
    return at;
  }();
  const auto file = read("25\n" + rows.substr(0, half) + "35\n" + rows.substr(half));
  expect_ball(file, truth, "two scans");
  EXPECT_TRUE(has(file, ScanRemark::SeveralScans));
  EXPECT_THAT(why("25\n" + rows.substr(0, half) + "36\n" + rows.substr(half)), HasSubstr("truncated"));
  EXPECT_THAT(why("24\n" + rows.substr(0, half) + "35\n" + rows.substr(half)), HasSubstr("more lines"));
}

TEST(Pcd, IsReadInAnyLettersAndWithPadding) {
  const Ball truth = ball();
  const std::string rows = table(truth, {kX, kY, kZ}, " ", false);
  for (const std::string head :
       {"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE f f f\nCOUNT 1 1 1\nWIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA ascii\n",
        "version 0.7\nfields X Y Z\nsize 4 4 4\ntype F f F\ncount 1 1 1\nwidth 60\nheight 1\npoints 60\ndata ASCII\n",
        "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 60\nHEIGHT 1\nPOINTS 60\nDATA ascii\n",
        "# my own\n# .PCD v.7\nVERSION .7\nFIELDS x y z _\nSIZE 4 4 4 1\nTYPE F F F U\nCOUNT 1 1 1 0\nWIDTH 60\nHEIGHT "
        "1\nPOINTS 60\nDATA ascii\n"})
    expect_ball(read(head + rows, "a.pcd"), truth, head);

  std::string binary =
      "VERSION .7\nFIELDS _ x _ y z _\nSIZE 1 4 2 4 4 1\nTYPE U F U F F U\nCOUNT 0 1 1 1 1 15\nWIDTH "
      "60\nHEIGHT 1\nPOINTS 60\nDATA binary\n";
  const auto put = [&](double value) {
    const auto f = static_cast<float>(value);
    binary.append(reinterpret_cast<const char*>(&f), 4);
  };
  for (const Vec3& p : truth.points) {
    put(p.x()), binary += "ab", put(p.y()), put(p.z()), binary += std::string(15, 'c');
  }
  expect_ball(read(binary), truth, "padding");
}

TEST(CoarseCoordinates, AreSaidOfFarClouds) {
  const Ball truth = ball(2000);
  const auto cloud_at = [&](const Vec3& origin, auto&& write) {
    std::string text;
    for (const Vec3& p : truth.points) {
      const Vec3 at = origin + p;
      text += write(at.x()) + " " + write(at.y()) + " " + write(at.z()) + "\n";
    }
    return read(text);
  };
  const auto as_float = [](double v) { return fmt::format("{:.9g}", static_cast<double>(static_cast<float>(v))); };
  const auto as_double = [](double v) { return fmt::format("{:.4f}", v); };
  const auto six_digits = [](double v) { return fmt::format("{:.6g}", v); };
  const Vec3 map{500000, 5400000, 120};
  const auto coarse = cloud_at(map, as_float);
  ASSERT_TRUE(coarse) << coarse.error().what;
  EXPECT_TRUE(has(coarse, ScanRemark::CoarseCoordinates));
  EXPECT_EQ(coarse->cloud.rounding, 0.5);
  EXPECT_THAT(coarse->cloud.notes.front().text, HasSubstr("0.5 in y"));
  EXPECT_TRUE(has(cloud_at({50000, 100, 7}, six_digits), ScanRemark::CoarseCoordinates));
  for (const auto& fine :
       {cloud_at(map, as_double), cloud_at({0, 0, 0}, as_float), cloud_at({500, 5400, 120}, as_float)}) {
    ASSERT_TRUE(fine);
    EXPECT_FALSE(has(fine, ScanRemark::CoarseCoordinates));
    EXPECT_EQ(fine->cloud.rounding, 0);
  }
  std::string grid;  // exact, though its step is its spacing
  for (int i = 0; i < 40; ++i)
    for (int k = 0; k < 40; ++k) grid += fmt::format("{} {} {}\n", 0.25 * i, 0.25 * k, 0.25 * ((i * k) % 7));
  EXPECT_FALSE(has(read(grid), ScanRemark::CoarseCoordinates));
}

}  // namespace
}  // namespace telefab::scan
