// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <unistd.h>

#include <Model/COM/NMR_DLLInterfaces.h>
#include <telefab/fab/formats/mesh_export.hpp>

namespace telefab::fab {
namespace {

TriangleMesh tetrahedron(float x) {
  return {{{x, 0, 0}, {x + 1, 0, 0}, {x, 1, 0}, {x, 0, 1}}, {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}}};
}

TEST(MeshExport, Writes3mfWithPartAndSupportsThatAStrictReaderTakes) {
  using namespace NMR;
  const auto path = std::filesystem::path{testing::TempDir()} / ("mesh-" + std::to_string(getpid()) + ".3mf");
  StructureMesh mesh{tetrahedron(0), tetrahedron(2)};
  mesh.supports.triangles.pop_back();  // of supports nobody asks that they are closed
  ASSERT_TRUE(export_threemf(mesh, path, {}, {}));
  PLib3MFModel* model = nullptr;
  PLib3MFModelReader* reader = nullptr;
  ASSERT_EQ(lib3mf_createmodel(&model), 0);
  ASSERT_EQ(lib3mf_model_queryreader(model, "3mf", &reader), 0);
  ASSERT_EQ(lib3mf_reader_setstrictmodeactive(reader, true), 0);
  EXPECT_EQ(lib3mf_reader_readfromfileutf8(reader, path.c_str()), 0);
  PLib3MFModelResourceIterator* objects = nullptr;
  ASSERT_EQ(lib3mf_model_getmeshobjects(model, &objects), 0);
  std::vector<std::pair<DWORD, DWORD>> found;  // type, triangles
  BOOL more = 0;
  while (lib3mf_resourceiterator_movenext(objects, &more) == 0 && more) {
    PLib3MFModelResource* object = nullptr;
    DWORD type = 0, triangles = 0;
    ASSERT_EQ(lib3mf_resourceiterator_getcurrent(objects, &object), 0);
    EXPECT_EQ(lib3mf_object_gettype(object, &type), 0);
    EXPECT_EQ(lib3mf_meshobject_gettrianglecount(object, &triangles), 0);
    found.emplace_back(type, triangles);
    lib3mf_release(object);
  }
  EXPECT_EQ(found, (std::vector<std::pair<DWORD, DWORD>>{{MODELOBJECTTYPE_MODEL, 4}, {MODELOBJECTTYPE_SUPPORT, 3}}));
  lib3mf_release(objects);
  lib3mf_release(reader);
  lib3mf_release(model);
  std::filesystem::remove(path);
}

TEST(MeshExport, SaysWhereItCannotWrite) {
  const auto written = export_threemf({tetrahedron(0), {}}, "/nowhere/at/all.3mf", {}, {});
  ASSERT_FALSE(written);
}

}  // namespace
}  // namespace telefab::fab
