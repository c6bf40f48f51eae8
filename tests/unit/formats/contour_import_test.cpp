// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zip.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <random>
#include <telefab/fab/formats/contour_export.hpp>
#include <telefab/fab/formats/contour_import.hpp>
#include <telefab/test/block_stack.hpp>
#include <telefab/test/random_stack.hpp>

#include "scratch_files.hpp"

namespace telefab::fab {
namespace {

using testing::HasSubstr;

MachineProfile machine_a() {
  MachineProfile m = test::small_machine();
  m.name = "machine-a";
  m.platform = {260, 160, 200};
  m.projection.pixel_pitch_mm = 0.14;
  m.layers.thickness_mm = 0.15;
  return m;
}

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span{text}); }

Result<Import> read(const std::string& text, const MachineProfile& machine = test::small_machine(),
                    const ImportOptions& options = {}) {
  return import_contours(bytes_of(text), machine, options, {}, {});
}

std::string why(const std::string& text, const ImportOptions& options = {}) {
  const auto import = read(text, test::small_machine(), options);
  return import ? "it was taken" : import.error().what;
}

/// A text CLI file of the small machine, units of 0.01 mm; `geometry` stands between start and end.
std::string cli(const std::string& geometry, const std::string& units = "$$UNITS/0.01\n") {
  return "$$HEADERSTART\n// made by hand //\n$$ASCII\n" + units + "$$VERSION/200\n$$LABEL/1,a part\n$$HEADEREND\n" +
         "$$GEOMETRYSTART\n" + geometry + "$$GEOMETRYEND\n";
}
const std::string kSquare = "$$POLYLINE/1,1,5,100,100,900,100,900,900,100,900,100,100\n";

std::string svg(const std::string& body,
                const std::string& size = R"(width="40mm" height="30mm" viewBox="0 0 40 30")") {
  return "<?xml version=\"1.0\"?>\n<!DOCTYPE svg PUBLIC \"-//W3C//DTD SVG 1.0//EN\" \"x.dtd\">\n<svg " + size +
         " xmlns:slic3r=\"s\">\n" + body + "</svg>\n";
}
std::string svg_layer(const std::string& content) { return "<g id=\"layer0\" slic3r:z=\"0.1\">" + content + "</g>\n"; }

/// A 3MF package by libzip itself.
std::string package(const std::string& model, const std::string& target = "/3D/3dmodel.model") {
  const std::string relationships =
      "<Relationships><Relationship Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\" Target=\"" +
      target + "\"/></Relationships>";
  zip_error_t error;
  zip_source_t* out = zip_source_buffer_create(nullptr, 0, 0, &error);
  zip_source_keep(out);
  zip_t* zip = zip_open_from_source(out, ZIP_TRUNCATE, &error);
  zip_file_add(zip, "_rels/.rels", zip_source_buffer(zip, relationships.data(), relationships.size(), 0), 0);
  zip_file_add(zip, "3D/3dmodel.model", zip_source_buffer(zip, model.data(), model.size(), 0), 0);
  zip_close(zip);
  zip_source_open(out);
  zip_source_seek(out, 0, SEEK_END);
  std::string bytes(static_cast<std::size_t>(zip_source_tell(out)), '\0');
  zip_source_seek(out, 0, SEEK_SET);
  zip_source_read(out, bytes.data(), bytes.size());
  zip_source_close(out);
  zip_source_free(out);
  return bytes;
}

std::string slices(const std::string& content) {
  return "<s:slicestack id=\"1\" zbottom=\"0\"><s:slice ztop=\"0.1\">" + content + "</s:slice></s:slicestack>";
}
const std::string kSliceSquare =
    "<s:vertices><s:vertex x=\"1\" y=\"1\"/><s:vertex x=\"3\" y=\"1\"/><s:vertex x=\"3\" y=\"4\"/></s:vertices>"
    "<s:polygon startv=\"0\"><s:segment v2=\"1\"/><s:segment v2=\"2\"/><s:segment v2=\"0\"/></s:polygon>";
std::string model(const std::string& resources, const std::string& item = "<item objectid=\"2\"/>",
                  const std::string& unit = "millimeter") {
  return "<model unit=\"" + unit + "\" xmlns:s=\"s\"><resources>" + resources +
         "<object id=\"2\" slicestackid=\"1\"><mesh/></object></resources><build>" + item + "</build></model>";
}

class ContourRoundTrip : public test::ScratchFiles, public testing::WithParamInterface<const char*> {};

TEST_P(ContourRoundTrip, GivesTheRingsBackThatWereExported) {
  const auto format = contour_format_from_name(GetParam()).value();
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const LayerStack stack = test::random_stack(seed, 12);
    ASSERT_TRUE(export_contours(format, contour_job(stack, {260, 160}), folder / "x", {}, {}));
    const auto import = import_contours(bytes("x"), machine_a(), {}, {}, {});
    ASSERT_TRUE(import) << import.error().what;
    ASSERT_EQ(import->stack.layers().size(), stack.layers().size());
    EXPECT_EQ(import->report.turned_rings + import->report.dropped_rings + import->report.rebuilt_layers, 0U);
    for (std::size_t i = 0; i < stack.layers().size(); ++i) {
      const auto want = sorted_canonically(stack.layers()[i].contours);
      const auto& got = import->stack.layers()[i].contours;
      ASSERT_EQ(got.size(), want.size());
      for (std::size_t r = 0; r < want.size(); ++r) {
        ASSERT_EQ(got[r].vertices().size(), want[r].vertices().size());
        for (std::size_t v = 0; v < want[r].vertices().size(); ++v) {
          EXPECT_NEAR(got[r].vertices()[v].x_mm, want[r].vertices()[v].x_mm, 260 * 0x1p-24);
          EXPECT_NEAR(got[r].vertices()[v].y_mm, want[r].vertices()[v].y_mm, 260 * 0x1p-24);
        }
      }
    }
    EXPECT_EQ(import->stack.layers()[0].certificate.verdict, LayerCertificate::Verdict::Unchecked);
  }
}

TEST_P(ContourRoundTrip, UnitesAPartWithItsSupports) {
  const LayerStack stack = test::stack_of({{test::rectangle(5, 5, 15, 15)}});
  const auto job = contour_job(stack, {40, 30}, {{test::rectangle(7, 7, 9, 9)}, {test::rectangle(3, 7, 9, 9)}});
  ASSERT_TRUE(export_contours(contour_format_from_name(GetParam()).value(), *job, folder / "x", {}, {}));
  const auto import = import_contours(bytes("x"), test::small_machine(), {}, {}, {});
  ASSERT_TRUE(import) << import.error().what;
  ASSERT_EQ(import->stack.layers().size(), 2U);
  ASSERT_EQ(import->stack.layers()[1].contours.size(), 1U);
  EXPECT_NEAR(import->stack.layers()[1].contours[0].signed_area_mm2(), 100 + 2 * 2, 1e-4);
  EXPECT_EQ(import->report.rebuilt_layers, 1U);
}

TEST_P(ContourRoundTrip, RefusesEveryTruncationWithoutACrash) {
  const LayerStack stack = test::random_stack(3, 4);
  ASSERT_TRUE(export_contours(contour_format_from_name(GetParam()).value(), contour_job(stack, {260, 160}),
                              folder / "x", {}, {}));
  const std::string whole = text("x");
  std::size_t taken = 0;
  for (std::size_t size = 0; size < whole.size(); size += 1 + whole.size() / 400) {
    const auto import = import_contours(bytes_of(whole.substr(0, size)), machine_a(), {}, {}, {});
    // Only binary CLI has no end to miss: it may stop behind a command.
    taken += import.has_value();
  }
  const bool has_an_end = std::string_view{GetParam()} != "cli-binary";
  EXPECT_EQ(has_an_end ? taken : 0U, 0U);
}

TEST_P(ContourRoundTrip, SurvivesDamageAnywhere) {
  const LayerStack stack = test::random_stack(4, 3);
  ASSERT_TRUE(export_contours(contour_format_from_name(GetParam()).value(), contour_job(stack, {260, 160}),
                              folder / "x", {}, {}));
  const std::string whole = text("x");
  std::mt19937_64 rng{7};
  for (int i = 0; i < 300; ++i) {
    std::string damaged = whole;
    for (int k = 0; k < 3; ++k) damaged[rng() % damaged.size()] = static_cast<char>(rng());
    const auto import = import_contours(bytes_of(damaged), machine_a(), {}, {}, {});
    if (!import) {
      EXPECT_NE(import.error().what, "");
      EXPECT_NE(import.error().code, ErrorCode::Internal) << import.error().what;
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Formats, ContourRoundTrip, testing::Values("cli", "cli-binary", "svg", "3mf"));

TEST(ImportCli, TakesUnitsFromTheFileOrFromTheUserButNoContradiction) {
  const std::string layers = "$$LAYER/0\n$$LAYER/10\n" + kSquare;
  const auto import = read(cli(layers));
  ASSERT_TRUE(import) << import.error().what;
  EXPECT_NEAR(import->stack.layers()[0].contours.at(0).signed_area_mm2(), 64, 1e-9);
  EXPECT_THAT(why(cli(layers, "")), HasSubstr("--units"));
  EXPECT_TRUE(read(cli(layers, ""), test::small_machine(), {.unit_mm = 0.01}));
  EXPECT_THAT(why(cli(layers), {.unit_mm = 1}), HasSubstr("leave --units out"));
  EXPECT_THAT(why(cli(layers, "$$UNITS/0\n")), HasSubstr("(0, 1000]"));
  EXPECT_THAT(why(cli(layers, "$$UNITS/nan\n")), HasSubstr("number"));
}

TEST(ImportCli, ReadsTheShortBinaryCommandsOfSmallFiles) {
  std::string file = "$$HEADERSTART\n$$BINARY\n$$UNITS/0.01\n$$VERSION/200\n$$HEADEREND";
  const auto put = [&](std::initializer_list<int> values) {
    for (const int v : values) {
      file += static_cast<char>(v & 255);
      file += static_cast<char>(v >> 8);
    }
  };
  put({128, 0, 128, 10, 129, 1, 1, 4, 100, 100, 900, 100, 900, 900, 100, 900});
  put({131, 1, 1, 0, 0, 5, 5});  // a hatch, left out
  const auto import = read(file);
  ASSERT_TRUE(import) << import.error().what;
  EXPECT_NEAR(import->stack.layers()[0].contours.at(0).signed_area_mm2(), 64, 1e-9);
  EXPECT_EQ(import->report.skipped_hatches, 1U);
}

TEST(ImportCli, RefusesCountsThatTheFileCannotHold) {
  EXPECT_THAT(why(cli("$$LAYER/0\n$$LAYER/10\n$$POLYLINE/1,1,4000000000,1,1\n")), HasSubstr("whole number"));
  std::string file = "$$HEADERSTART\n$$BINARY\n$$UNITS/1\n$$HEADEREND";
  file += std::string("\x7f\0\xcd\xcc\xcc\x3d\x82\0\x01\0\0\0\x01\0\0\0\xff\xff\xff\x7f", 20);
  EXPECT_THAT(why(file), HasSubstr("cut off"));
}

TEST(ImportCli, RefusesWhatHasNoInsideOrCannotBeRead) {
  EXPECT_THAT(why(cli("$$LAYER/0\n$$LAYER/10\n$$POLYLINE/1,2,3,1,1,2,2,3,1\n")), HasSubstr("open line"));
  EXPECT_THAT(why(cli("$$LAYER/10\n" + kSquare + "$$LAYER/5\n" + kSquare)), HasSubstr("rise"));
  EXPECT_THAT(why(cli(kSquare)), HasSubstr("before the first layer"));
  EXPECT_THAT(why(cli("$$LAYER/10\n$$POLYLINE/1,1,3,1,1,2,2,inf,1\n")), HasSubstr("number"));
  EXPECT_THAT(why(cli("", "$$UNITS/1\n$$ALIGN\n")), HasSubstr("ALIGN"));
  EXPECT_THAT(why(cli("$$LAYER/10\n")), HasSubstr("no closed contour"));
}

TEST(ImportContours, RefusesLayersOfAnotherThicknessWithBothFigures) {
  EXPECT_THAT(why(cli("$$LAYER/0\n$$LAYER/5\n" + kSquare)),
              testing::AllOf(HasSubstr("0.0500 mm"), HasSubstr("0.1 mm"), HasSubstr("small")));
  EXPECT_THAT(why(cli("$$LAYER/0\n$$LAYER/10\n" + kSquare + "$$LAYER/30\n" + kSquare)), HasSubstr("layer 1"));
  // Two percent off in every layer adds up to another part.
  std::string drifting = "$$LAYER/0\n";
  for (int i = 1; i < 40; ++i) drifting += "$$LAYER/" + std::to_string(10.15 * i) + "\n" + kSquare;
  EXPECT_THAT(why(cli(drifting)), HasSubstr("off from layers"));
}

TEST(ImportContours, PutsThePartOnThePlatform) {
  const auto import = read(cli("$$LAYER/500\n$$LAYER/510\n" + kSquare));
  ASSERT_TRUE(import) << import.error().what;
  EXPECT_NEAR(import->report.lowered_mm, 5, 1e-9);
  EXPECT_EQ(import->stack.header().layer_count, 1U);
}

TEST(ImportContours, ReadsDirectionFromNestingAndSaysHowManyRingsItTurned) {
  // An outer ring, a hole and an island, all of them clockwise.
  const std::string layer =
      "$$LAYER/10\n$$POLYLINE/1,0,4,0,0,0,1000,1000,1000,1000,0\n$$POLYLINE/1,0,4,100,100,100,900,900,900,900,100\n"
      "$$POLYLINE/1,0,4,300,300,300,500,500,500,500,300\n";
  const auto import = read(cli("$$LAYER/0\n" + layer));
  ASSERT_TRUE(import) << import.error().what;
  double area = 0;
  for (const Contour& ring : import->stack.layers()[0].contours) area += ring.signed_area_mm2();
  EXPECT_NEAR(area, 100 - 64 + 4, 1e-9);
  EXPECT_EQ(import->report.turned_rings, 2U);
  EXPECT_EQ(import->stack.layers()[0].certificate.measured_euler, 1);
}

/// Stacks of rings in cells of 1 mm, each ring turned, of any direction and order; the nesting is known by making.
class ImportNesting : public testing::TestWithParam<std::uint64_t> {};
TEST_P(ImportNesting, TellsOuterRingsFromHolesHoweverManyAndDeep) {
  std::mt19937_64 rng{GetParam()};
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(rng() >> 11U) * 0x1p-53;
  };
  std::vector<std::string> lines;
  double area_mm2 = 0;
  int euler = 0;
  for (int cell = 0; cell < 900; ++cell) {
    const double x = 1 + cell % 36, y = 1 + cell / 36;
    const int deep = static_cast<int>(rng() % 7);
    for (int d = 0; d < deep; ++d) {
      const int n = 3 + static_cast<int>(rng() % 40);
      // So far apart that a chord of the outer ring never reaches the inner one.
      const double radius = 0.48 * std::pow(0.49, d), turn = uniform(0, 6);
      const bool clockwise = rng() % 2 != 0;
      std::string line = "$$POLYLINE/1," + std::to_string(clockwise ? 0 : 1) + "," + std::to_string(n);
      std::vector<Point2> ring;
      for (int k = 0; k < n; ++k) {
        const double angle = turn + 2 * std::numbers::pi * (clockwise ? n - k : k) / n;
        ring.push_back({x + radius * std::cos(angle), y + radius * std::sin(angle)});
        line += "," + std::to_string(ring.back().x_mm * 100) + "," + std::to_string(ring.back().y_mm * 100);
      }
      area_mm2 += (d % 2 == 0 ? 1 : -1) * std::abs(signed_area_mm2(ring));
      euler += d % 2 == 0 ? 1 : -1;
      lines.push_back(line + "\n");
    }
  }
  std::shuffle(lines.begin(), lines.end(), rng);
  std::string layer = "$$LAYER/0\n$$LAYER/10\n";
  for (const std::string& line : lines) layer += line;
  ASSERT_GT(lines.size(), 1000U);
  const auto import = read(cli(layer));
  ASSERT_TRUE(import) << import.error().what;
  double got = 0;
  for (const Contour& ring : import->stack.layers()[0].contours) got += ring.signed_area_mm2();
  EXPECT_NEAR(got, area_mm2, 1e-3);
  EXPECT_EQ(import->stack.layers()[0].certificate.measured_euler, euler);
  EXPECT_EQ(import->report.rebuilt_layers, 0U);
}
INSTANTIATE_TEST_SUITE_P(Seeds, ImportNesting, testing::Range<std::uint64_t>(0, 8));

TEST(ImportContours, RefusesCrossingRingsWithLayerAndPlace) {
  const std::string other = "$$POLYLINE/1,1,4,500,500,1500,500,1500,700,500,700\n";
  EXPECT_THAT(why(cli("$$LAYER/0\n$$LAYER/10\n" + kSquare + "$$LAYER/20\n" + kSquare + other)),
              testing::AllOf(HasSubstr("layer 1"), HasSubstr("(9.0000, 5.0000)")));
  EXPECT_THAT(why(cli("$$LAYER/0\n$$LAYER/10\n$$POLYLINE/1,1,4,0,0,900,900,900,0,0,900\n")), HasSubstr("cross"));
}

TEST(ImportContours, UnitesRingsThatOnlyTouch) {
  const std::string beside = "$$POLYLINE/1,1,4,900,100,1200,100,1200,900,900,900\n";
  const auto import = read(cli("$$LAYER/0\n$$LAYER/10\n" + kSquare + beside));
  ASSERT_TRUE(import) << import.error().what;
  ASSERT_EQ(import->stack.layers()[0].contours.size(), 1U);
  EXPECT_NEAR(import->stack.layers()[0].contours[0].signed_area_mm2(), 8 * 11, 1e-6);
}

TEST(ImportContours, RefusesAPartBesideThePlatformUnlessItMayBeCentred) {
  const std::string layers = "$$LAYER/0\n$$LAYER/10\n$$POLYLINE/1,1,4,-100,-100,100,-100,100,100,-100,100\n";
  EXPECT_THAT(why(cli(layers)), HasSubstr("--place centre"));
  const auto import = read(cli(layers), test::small_machine(), {.centre = true});
  ASSERT_TRUE(import) << import.error().what;
  const Bounds2 b = import->stack.layers()[0].contours[0].bounds();
  EXPECT_NEAR(b.min.x_mm, 19, 1e-9);
  EXPECT_NEAR(b.max.y_mm, 16, 1e-9);
  EXPECT_THAT(why(cli("$$LAYER/0\n$$LAYER/10\n$$POLYLINE/1,1,3,0,0,9000,0,0,100\n"), {.centre = true}),
              HasSubstr("smaller"));
}

TEST(ImportSvg, ReadsLinesOfEveryKindAndTurnsYAround) {
  const auto import =
      read(svg(svg_layer("<title>a</title><path d=\"M1,2 h4v3H1z m10 10 l2-1,.5.5z\"/>"
                         "<polygon points=\"20 20 22 20 22 22\"/>")));
  ASSERT_TRUE(import) << import.error().what;
  double area = 0;
  for (const Contour& ring : import->stack.layers()[0].contours) area += ring.signed_area_mm2();
  EXPECT_NEAR(area, 12 + 0.75 + 2, 1e-6);
  double highest = 0;
  for (const Contour& ring : import->stack.layers()[0].contours) highest = std::max(highest, ring.bounds().max.y_mm);
  EXPECT_NEAR(highest, 28, 1e-9);
}

TEST(ImportSvg, TakesMillimetresFromSizeAndViewBoxOrFromTheUser) {
  const std::string square = svg_layer("<path d=\"M0 0L10 0 10 10 0 10z\"/>");
  const auto area = [](const Result<Import>& import) {
    return import ? import->stack.layers()[0].contours.at(0).signed_area_mm2() : -1;
  };
  EXPECT_NEAR(area(read(svg(square, "width=\"4cm\" height=\"3cm\" viewBox=\"0 0 400 300\""))), 1, 1e-9);
  EXPECT_THAT(why(svg(square, "width=\"400\" height=\"300\"")), HasSubstr("--units"));
  EXPECT_NEAR(area(read(svg(square, "width=\"40\" height=\"30\""), test::small_machine(), {.unit_mm = 1})), 100, 1e-9);
  EXPECT_THAT(why(svg(square, "width=\"40mm\" height=\"30mm\" viewBox=\"0 0 40 60\"")), HasSubstr("same"));
  EXPECT_THAT(why(svg(square, "width=\"40mm\" height=\"30mm\"")), HasSubstr("viewBox"));
}

TEST(ImportSvg, RefusesWhatItWouldReadWrongly) {
  EXPECT_THAT(why(svg(svg_layer("<path d=\"M0 0C1 1 2 2 3 3z\"/>"))), HasSubstr("straight lines"));
  EXPECT_THAT(why(svg(svg_layer("<circle r=\"3\"/>"))), HasSubstr("circle"));
  EXPECT_THAT(why(svg("<g transform=\"scale(2)\">" + svg_layer("<path d=\"M0 0\"/>") + "</g>")),
              HasSubstr("transform"));
  EXPECT_THAT(why(svg("<g id=\"layer0\"><path d=\"M0 0L1 1 1 0z\"/></g>")), HasSubstr("slic3r:z"));
  EXPECT_THAT(why(svg(svg_layer("<path d=\"M0 0L1 nan 1 0z\"/>"))), HasSubstr("number"));
  EXPECT_THAT(why("<!DOCTYPE svg [<!ENTITY a \"aaaa\">]><svg/>"), HasSubstr("DOCTYPE"));
  std::string deep = "<svg width=\"40mm\" height=\"30mm\" viewBox=\"0 0 40 30\">";
  for (int i = 0; i < 100; ++i) deep += "<g>";
  EXPECT_THAT(why(deep), HasSubstr("levels"));
}

std::string layers_at(std::initializer_list<const char*> heights) {
  std::string body;
  for (const char* z : heights) body += std::string{"<g slic3r:z=\""} + z + "\"><path d=\"M1 1L9 1 9 9 1 9z\"/></g>\n";
  return svg(body);
}

TEST(ImportSvg, TakesHeightsInMillionthsAsSlic3rWritesThem) {
  for (const auto& heights : {std::initializer_list<const char*>{"1e-07", "2e-07", "3e-07"},
                              {"0.0000001", "0.0000002", "0.0000003"},
                              {"1e-7", "2e-7", "3e-7"}}) {
    const auto import = read(layers_at(heights));
    ASSERT_TRUE(import) << import.error().what;
    EXPECT_EQ(import->stack.header().layer_count, 3U);
    EXPECT_TRUE(import->report.heights_in_millionths);
    EXPECT_EQ(import->report.rings, 3U);
  }
  const auto plain = read(layers_at({"0.1", "0.2", "0.3"}));
  ASSERT_TRUE(plain) << plain.error().what;
  EXPECT_FALSE(plain->report.heights_in_millionths);
}

TEST(ImportSvg, RefusesHeightsInNoUnitAndPartsWithoutARing) {
  EXPECT_THAT(why(layers_at({"0.1", "0.10000001", "0.2"})), HasSubstr("slic3r:z"));
  EXPECT_THAT(why(layers_at({"0.0001", "0.0002", "0.0035"})), HasSubstr("layer 1 reaches"));
  EXPECT_THAT(why(svg(svg_layer("<path d=\"M1 1L9 1 9 9 1 9z M1 1L9 1 9 9 1 9z\"/>"))), HasSubstr("ring"));
  EXPECT_FALSE(read(svg(svg_layer(""))));
}

TEST(ImportThreeMf, PlacesObjectsAsTheBuildSays) {
  const auto import =
      read(package(model(slices(kSliceSquare), "<item objectid=\"2\" transform=\"0 1 0 -1 0 0 0 0 1 20 10 0\"/>")));
  ASSERT_TRUE(import) << import.error().what;
  const Contour& ring = import->stack.layers()[0].contours.at(0);
  EXPECT_NEAR(ring.signed_area_mm2(), 3, 1e-9);
  EXPECT_NEAR(ring.bounds().min.x_mm, 20 - 4, 1e-9);
  EXPECT_NEAR(ring.bounds().max.y_mm, 10 + 3, 1e-9);
}

TEST(ImportThreeMf, KnowsTheUnitOfTheModel) {
  const std::string micron =
      "<s:slicestack id=\"1\"><s:slice ztop=\"100\"><s:vertices><s:vertex x=\"1000\" y=\"1000\"/>"
      "<s:vertex x=\"30000\" y=\"1000\"/><s:vertex x=\"30000\" y=\"4000\"/></s:vertices>"
      "<s:polygon startv=\"0\"><s:segment v2=\"1\"/><s:segment v2=\"2\"/><s:segment v2=\"0\"/>"
      "</s:polygon></s:slice></s:slicestack>";
  const auto import = read(package(model(micron, "<item objectid=\"2\"/>", "micron")));
  ASSERT_TRUE(import) << import.error().what;
  EXPECT_NEAR(import->stack.layers()[0].contours.at(0).signed_area_mm2(), 29 * 3 / 2.0, 1e-9);
  EXPECT_THAT(why(package(model(micron, "", "parsec"))), HasSubstr("parsec"));
}

TEST(ImportThreeMf, RefusesWhatIsNotThere) {
  EXPECT_THAT(why(package(model(""))), HasSubstr("no slices"));
  EXPECT_THAT(why(package(model(slices("<s:polygon startv=\"7\"/>")))), HasSubstr("startv 7"));
  EXPECT_THAT(why(package(model(slices(kSliceSquare), "<item objectid=\"9\"/>"))), HasSubstr("object 9"));
  EXPECT_THAT(
      why(package(model(slices(kSliceSquare), "<item objectid=\"2\" transform=\"1 0 0 0 0 1 0 -1 0 0 0 0\"/>"))),
      HasSubstr("leans"));
  EXPECT_THAT(why(package(model(""), "/other.model")), HasSubstr("other.model"));
}

TEST(ImportThreeMf, RefusesAnArchiveThatUnpacksToFarMoreThanItsSize) {
  const std::string bomb = package(model("<!--" + std::string(80U << 20U, ' ') + "-->"));
  ASSERT_LT(bomb.size(), 200'000U);
  const auto import = read(bomb);
  ASSERT_FALSE(import);
  EXPECT_EQ(import.error().code, ErrorCode::TooLarge);
}

TEST(ImportContours, SaysWhichFilesItReadsWhereItKnowsNoneOfThem) {
  EXPECT_THAT(why("solid cube\n facet normal 0 0 1"), HasSubstr("CLI, SVG, 3MF"));
  EXPECT_THAT(why(""), HasSubstr("CLI, SVG, 3MF"));
}

TEST(ImportContours, StopsWhereItIsAskedTo) {
  std::stop_source stop;
  stop.request_stop();
  const std::string file = cli("$$LAYER/0\n$$LAYER/10\n" + kSquare);
  EXPECT_EQ(import_contours(bytes_of(file), test::small_machine(), {}, {}, stop.get_token()).error().code,
            ErrorCode::Cancelled);
}

}  // namespace
}  // namespace telefab::fab
