// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/fab/formats/mesh_export.hpp>

#include "threemf_writer.hpp"
#include "zip_writer.hpp"

namespace telefab::fab {
namespace {

void append_object(std::string& out, int id, std::string_view name, std::string_view type, int colour,
                   const TriangleMesh& mesh) {
  out += fmt::format("<object id=\"{}\" name=\"{}\" type=\"{}\" pid=\"1\" pindex=\"{}\">\n<mesh><vertices>\n", id, name,
                     type, colour);
  for (const auto& v : mesh.vertices)
    fmt::format_to(std::back_inserter(out), "<vertex x=\"{}\" y=\"{}\" z=\"{}\"/>\n", v[0], v[1], v[2]);
  out += "</vertices><triangles>\n";
  for (const auto& t : mesh.triangles)
    fmt::format_to(std::back_inserter(out), "<triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>\n", t[0], t[1], t[2]);
  out += "</triangles></mesh></object>\n";
}

}  // namespace

Result<void> export_threemf(const StructureMesh& mesh, const std::filesystem::path& path, const ProgressSink& progress,
                            std::stop_token stop) {
  auto zip = ZipWriter::create(path);
  if (!zip) return tl::unexpected{zip.error()};
  if (auto ok = add_threemf_frame(*zip); !ok) return ok;
  const auto model = [&]() -> Result<std::vector<std::byte>> {
    std::string out = R"(<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<resources>
<basematerials id="1"><base name="part" displaycolor="#C6CCD6"/><base name="supports" displaycolor="#F09628"/></basematerials>
)";
    std::string items;
    int id = 2;
    for (const auto& [name, type, colour, body] :
         {std::tuple{"part", "model", 0, &mesh.part}, {"supports", "support", 1, &mesh.supports}}) {
      if (body->triangles.empty()) continue;
      append_object(out, id, name, type, colour, *body);
      items += fmt::format("<item objectid=\"{}\"/>\n", id++);
    }
    out += "</resources>\n<build>\n" + items + "</build>\n</model>\n";
    const auto bytes = std::as_bytes(std::span{out});
    return std::vector<std::byte>(bytes.begin(), bytes.end());
  };
  if (auto ok = zip->add("3D/3dmodel.model", model, Packing::Deflated); !ok) return ok;
  return zip->finish(WorkStage::PackingModel, progress, std::move(stop));
}

}  // namespace telefab::fab
