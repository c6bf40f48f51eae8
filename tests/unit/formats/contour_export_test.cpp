// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Model/COM/NMR_DLLInterfaces.h>

#include <bit>
#include <cstring>
#include <pugixml.hpp>
#include <sstream>
#include <telefab/fab/formats/contour_export.hpp>
#include <telefab/test/block_stack.hpp>
#include <telefab/test/random_stack.hpp>

#include "scratch_files.hpp"
#include "zip_entries.hpp"

namespace telefab::fab {
namespace {

/// Stars with holes as the part, two squares below and beside it as supports, the part two layers up.
ContourJob star_job() {
  const LayerStack stack = test::random_stack(5, 7);
  std::vector<std::vector<Contour>> supports(9, {test::rectangle(1, 1, 3, 3), test::rectangle(4, 1, 7, 3)});
  supports[8].clear();
  return contour_job(stack, {260, 160}, std::move(supports)).value();
}

struct ReadRing {
  int part = 0;
  bool hole = false;
  std::vector<Point2> vertices;
};
using ReadLayers = std::vector<std::pair<double, std::vector<ReadRing>>>;

/// Every vertex, direction and height of the job, within `tolerance_mm`.
void expect_same(const ReadLayers& read, const ContourJob& job, double tolerance_mm) {
  ASSERT_EQ(read.size(), job.layer_count);
  for (std::uint32_t i = 0; i < job.layer_count; ++i) {
    EXPECT_NEAR(read[i].first, (i + 1) * job.thickness_mm, 1e-5) << i;
    std::size_t at = 0;
    for (const ContourPart& part : job.parts)
      for (const Contour& ring : part.layers[i]) {
        ASSERT_LT(at, read[i].second.size()) << "layer " << i;
        const ReadRing& got = read[i].second[at++];
        EXPECT_EQ(got.part, static_cast<int>(part.kind));
        EXPECT_EQ(got.hole, ring.is_hole());
        ASSERT_EQ(got.vertices.size(), ring.vertices().size());
        for (std::size_t v = 0; v < got.vertices.size(); ++v) {
          EXPECT_NEAR(got.vertices[v].x_mm, ring.vertices()[v].x_mm, tolerance_mm);
          EXPECT_NEAR(got.vertices[v].y_mm, ring.vertices()[v].y_mm, tolerance_mm);
        }
      }
    EXPECT_EQ(at, read[i].second.size()) << "layer " << i;
  }
}

/// Takes the last vertex off, which has to be the first.
void open_ring(std::vector<Point2>& vertices) {
  ASSERT_GT(vertices.size(), 3U);
  ASSERT_EQ(vertices.front(), vertices.back());
  vertices.pop_back();
}

// Not independent of the writer's author: libraries that read CLI are not packaged. Written from the standard's text.
ReadLayers read_ascii_cli(const std::string& text) {
  ReadLayers layers;
  std::istringstream lines{text.substr(text.find("$$GEOMETRYSTART"))};
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("$$LAYER/")) layers.push_back({std::stod(line.substr(8)), {}});
    if (!line.starts_with("$$POLYLINE/")) continue;
    std::vector<double> numbers;
    std::istringstream fields{line.substr(11)};
    for (std::string field; std::getline(fields, field, ',');) numbers.push_back(std::stod(field));
    ReadRing ring{static_cast<int>(numbers.at(0)), numbers.at(1) == 0, {}};
    EXPECT_EQ(numbers.size(), 3 + 2 * static_cast<std::size_t>(numbers.at(2)));
    for (std::size_t i = 3; i + 1 < numbers.size(); i += 2) ring.vertices.push_back({numbers[i], numbers[i + 1]});
    open_ring(ring.vertices);
    layers.back().second.push_back(std::move(ring));
  }
  return layers;
}

ReadLayers read_binary_cli(const std::string& text) {
  ReadLayers layers;
  std::size_t at = text.find("$$HEADEREND") + std::strlen("$$HEADEREND");
  const auto number = [&](auto value) {
    std::memcpy(&value, text.data() + at, sizeof value);
    at += sizeof value;
    return value;
  };
  while (at < text.size()) {
    const auto command = number(std::uint16_t{});
    if (command == 127) {
      layers.push_back({number(float{}), {}});
      continue;
    }
    EXPECT_EQ(command, 130);
    const auto part = number(std::int32_t{});
    const auto direction = number(std::int32_t{});
    const auto count = number(std::int32_t{});
    ReadRing ring{part, direction == 0, {}};
    for (int i = 0; i < count; ++i) {
      const float x = number(float{});
      ring.vertices.push_back({x, number(float{})});
    }
    open_ring(ring.vertices);
    layers.back().second.push_back(std::move(ring));
  }
  return layers;
}

/// The markup by pugixml; the path by hand: M, L, numbers and z are all the writer uses.
ReadLayers read_svg(const std::string& text) {
  pugi::xml_document document;
  EXPECT_TRUE(document.load_string(text.c_str()));
  ReadLayers layers;
  for (const auto& group : document.child("svg").children("g")) {
    auto& layer = layers.emplace_back(group.attribute("slic3r:z").as_double(), std::vector<ReadRing>{});
    for (const auto& path : group.children("path")) {
      std::string d = path.attribute("d").value();
      for (char& c : d)
        if (c == 'M' || c == 'L') c = ' ';
      std::istringstream rings{d};
      for (std::string one; std::getline(rings, one, 'z');) {
        ReadRing ring;
        ring.part = std::string_view{path.attribute("slic3r:type").value()} == "contour" ? 1 : 2;
        std::istringstream numbers{one};
        for (double x = 0, y = 0; numbers >> x >> y;) ring.vertices.push_back({x, 160 - y});
        ring.hole = signed_area_mm2(ring.vertices) < 0;
        layer.second.push_back(std::move(ring));
      }
    }
  }
  return layers;
}

/// By lib3mf, strict: every warning is an error. `problem` holds what it says.
ReadLayers read_threemf(const std::filesystem::path& path, std::string& problem) {
  using namespace NMR;
  ReadLayers layers;
  const auto check = [&](LIB3MFRESULT result, const char* what) {
    if (result != 0 && problem.empty()) problem = std::string{what} + " gives " + std::to_string(result);
    return result == 0;
  };
  PLib3MFModel* model = nullptr;
  PLib3MFModelReader* reader = nullptr;
  check(lib3mf_createmodel(&model), "createmodel");
  check(lib3mf_model_queryreader(model, "3mf", &reader), "queryreader");
  check(lib3mf_reader_setstrictmodeactive(reader, true), "strict");
  check(lib3mf_reader_readfromfileutf8(reader, path.c_str()), "read");
  DWORD warnings = 0;
  check(lib3mf_reader_getwarningcount(reader, &warnings), "warnings");
  if (warnings != 0) problem += std::to_string(warnings) + " warnings";
  PLib3MFModelResourceIterator* objects = nullptr;
  check(lib3mf_model_getmeshobjects(model, &objects), "objects");
  BOOL more = 0;
  while (check(lib3mf_resourceiterator_movenext(objects, &more), "next") && more) {
    PLib3MFModelResource* object = nullptr;
    check(lib3mf_resourceiterator_getcurrent(objects, &object), "current");
    DWORD type = 0, stack_id = 0, slices = 0;
    check(lib3mf_object_gettype(object, &type), "type");
    check(lib3mf_meshobject_getslicestackid(object, &stack_id), "stack id");
    eModelSlicesMeshResolution resolution{};
    check(lib3mf_meshobject_getslicesmeshresolution(object, &resolution), "resolution");
    EXPECT_EQ(resolution, MODELSLICESMESHRESOLUTION_LOW);
    PLib3MFSliceStack* stack = nullptr;
    check(lib3mf_model_getslicestackById(model, stack_id, &stack), "stack");
    check(lib3mf_slicestack_getslicecount(stack, &slices), "slices");
    layers.resize(slices);
    for (DWORD s = 0; s < slices; ++s) {
      PLib3MFSlice* slice = nullptr;
      check(lib3mf_slicestack_getslice(stack, s, &slice), "slice");
      float top = 0;
      check(lib3mf_slice_gettopz(slice, &top), "top");
      layers[s].first = top;
      DWORD vertex_count = 0, polygons = 0;
      check(lib3mf_slice_getvertexcount(slice, &vertex_count), "vertex count");
      check(lib3mf_slice_getpolygoncount(slice, &polygons), "polygon count");
      std::vector<MODELSLICEVERTEX> vertices(vertex_count);
      if (vertex_count != 0) check(lib3mf_slice_getvertices(slice, vertices.data(), vertex_count), "vertices");
      for (DWORD p = 0; p < polygons; ++p) {
        DWORD count = 0;
        check(lib3mf_slice_getpolygonindexcount(slice, p, &count), "index count");
        std::vector<DWORD> indices(count);
        check(lib3mf_slice_getpolygonindices(slice, p, indices.data(), count), "indices");
        ReadRing ring;
        ring.part = type == MODELOBJECTTYPE_SUPPORT ? 2 : 1;
        for (const DWORD i : indices)
          ring.vertices.push_back({vertices.at(i).m_fPosition[0], vertices.at(i).m_fPosition[1]});
        open_ring(ring.vertices);
        ring.hole = signed_area_mm2(ring.vertices) < 0;
        layers[s].second.push_back(std::move(ring));
      }
      lib3mf_release(slice);
    }
    lib3mf_release(stack);
    lib3mf_release(object);
  }
  lib3mf_release(objects);
  lib3mf_release(reader);
  lib3mf_release(model);
  return layers;
}

class ContourExport : public test::ScratchFiles {
 protected:
  Result<void> write(ContourFormat format, const ContourJob& job, const std::string& name = "x",
                     std::stop_token stop = {}) {
    return export_contours(format, job, folder / name, {}, stop);
  }
};

constexpr double kNanometreRounding = 0.51e-6;
constexpr double kSinglePrecision = 260 * 0x1p-24;

TEST_F(ContourExport, AsciiCliHoldsEveryVertexToTheNanometre) {
  const ContourJob job = star_job();
  ASSERT_TRUE(write(ContourFormat::CliAscii, job));
  auto layers = read_ascii_cli(text("x"));
  ASSERT_EQ(layers.front().first, 0);  // gives the lower side of the first layer
  layers.erase(layers.begin());
  expect_same(layers, job, kNanometreRounding);
}

TEST_F(ContourExport, BinaryCliHoldsEveryVertexInSinglePrecision) {
  const ContourJob job = star_job();
  ASSERT_TRUE(write(ContourFormat::CliBinary, job));
  auto layers = read_binary_cli(text("x"));
  ASSERT_EQ(layers.front().first, 0);
  layers.erase(layers.begin());
  expect_same(layers, job, kSinglePrecision);
}

TEST_F(ContourExport, SvgHoldsEveryVertexToTheNanometre) {
  const ContourJob job = star_job();
  ASSERT_TRUE(write(ContourFormat::Svg, job));
  expect_same(read_svg(text("x")), job, kNanometreRounding);
}

TEST_F(ContourExport, ThreeMfHoldsEveryVertexThroughLib3mf) {
  const ContourJob job = star_job();
  ASSERT_TRUE(write(ContourFormat::ThreeMf, job, "x.3mf"));
  std::string problem;
  const ReadLayers layers = read_threemf(folder / "x.3mf", problem);
  EXPECT_EQ(problem, "");
  expect_same(layers, job, kSinglePrecision);
}

TEST_F(ContourExport, GivesTheSameBytesTwiceAndNothingElse) {
  const ContourJob job = star_job();
  for (const char* name : {"cli", "cli-binary", "svg", "3mf"}) {
    const auto format = contour_format_from_name(name);
    ASSERT_TRUE(format);
    ASSERT_TRUE(write(*format, job, "a"));
    ASSERT_TRUE(write(*format, job, "b"));
    EXPECT_EQ(bytes("a"), bytes("b")) << name;
  }
  EXPECT_EQ(files(), 2);
  EXPECT_FALSE(contour_format_from_name("stl"));
}

TEST_F(ContourExport, LeavesNothingWhereItIsStopped) {
  std::stop_source stop;
  stop.request_stop();
  for (const char* name : {"cli", "svg", "3mf"})
    EXPECT_EQ(write(*contour_format_from_name(name), star_job(), "x", stop.get_token()).error().code,
              ErrorCode::Cancelled);
  EXPECT_EQ(files(), 0);
}

TEST(ContourJob, CutsSupportsOffThePartTheyHold) {
  const LayerStack stack = test::stack_of({{test::rectangle(5, 5, 15, 15)}});
  const auto job = contour_job(stack, {40, 30}, {{test::rectangle(7, 7, 9, 9)}, {test::rectangle(3, 7, 9, 9)}});
  ASSERT_TRUE(job) << job.error().what;
  ASSERT_EQ(job->layer_count, 2U);
  EXPECT_TRUE(job->parts[0].layers[0].empty());
  ASSERT_EQ(job->parts[1].layers[1].size(), 1U);
  EXPECT_NEAR(job->parts[1].layers[1][0].signed_area_mm2(), 2 * 2, 1e-6);
}

TEST(ContourJob, RefusesSupportsOfAnotherJob) {
  const LayerStack stack = test::stack_of({{test::rectangle(5, 5, 15, 15)}, {}});
  EXPECT_FALSE(contour_job(stack, {40, 30}, std::vector<std::vector<Contour>>(1)));
}

}  // namespace
}  // namespace telefab::fab
