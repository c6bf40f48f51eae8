// SPDX-License-Identifier: GPL-3.0-or-later
#include "threemf_writer.hpp"

#include <fmt/format.h>

namespace telefab::fab {
namespace {

constexpr std::string_view kContentTypes =
    R"(<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
 <Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
 <Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
)";

constexpr std::string_view kRelationships =
    R"(<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
 <Relationship Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/3D/3dmodel.model"/>
</Relationships>
)";

/// Shortest decimals that read back to the same single.
void append_single(std::string& out, double value) {
  char digits[40];
  const auto* end = std::to_chars(digits, digits + sizeof digits, static_cast<float>(value)).ptr;
  out.append(digits, static_cast<std::size_t>(end - digits));
}

int stack_id(std::size_t part) { return static_cast<int>(2 * part + 1); }
int object_id(std::size_t part) { return static_cast<int>(2 * part + 2); }

/// Twelve triangles, outward.
void append_box(std::string& out, Bounds2 bounds, double height_mm) {
  // A job without rings still needs a body.
  if (!(bounds.max.x_mm > bounds.min.x_mm)) bounds.max.x_mm = bounds.min.x_mm + 1;
  if (!(bounds.max.y_mm > bounds.min.y_mm)) bounds.max.y_mm = bounds.min.y_mm + 1;
  out += "<mesh><vertices>\n";
  for (const double z : {0.0, height_mm})
    for (const Point2 p :
         {bounds.min, Point2{bounds.max.x_mm, bounds.min.y_mm}, bounds.max, Point2{bounds.min.x_mm, bounds.max.y_mm}}) {
      out += "<vertex x=\"";
      append_single(out, p.x_mm);
      out += "\" y=\"";
      append_single(out, p.y_mm);
      out += "\" z=\"";
      append_single(out, z);
      out += "\"/>\n";
    }
  out += "</vertices><triangles>\n";
  constexpr int triangles[12][3] = {{0, 2, 1}, {0, 3, 2}, {4, 5, 6}, {4, 6, 7}, {0, 1, 5}, {0, 5, 4},
                                    {1, 2, 6}, {1, 6, 5}, {2, 3, 7}, {2, 7, 6}, {3, 0, 4}, {3, 4, 7}};
  for (const auto& t : triangles) out += fmt::format("<triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>\n", t[0], t[1], t[2]);
  out += "</triangles></mesh>";
}

Bounds2 bounds_of_part(const ContourJob& job, std::size_t part) {
  ContourJob alone;
  alone.parts.push_back(job.parts[part]);
  return bounds_of(alone);
}

}  // namespace

void ThreeMfModel::begin(std::string& out) {
  out += R"(<?xml version="1.0" encoding="UTF-8"?>
<model unit="millimeter" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02")"
         R"( xmlns:s="http://schemas.microsoft.com/3dmanufacturing/slice/2015/07" requiredextensions="s">
<resources>
)";
}

void ThreeMfModel::layer(std::string& out, std::uint32_t index) {
  const std::size_t part = index / job_.layer_count;
  const std::uint32_t layer = index % job_.layer_count;
  if (layer == 0) out += fmt::format("<s:slicestack id=\"{}\" zbottom=\"0\">\n", stack_id(part));
  out += "<s:slice ztop=\"";
  append_single(out, top_mm(job_, layer));
  const auto& rings = job_.parts[part].layers[layer];
  if (rings.empty()) {
    out += "\"/>\n";
  } else {
    out += "\">\n<s:vertices>\n";
    for (const Contour& ring : rings)
      for (const Point2 p : ring.vertices()) {
        out += "<s:vertex x=\"";
        append_single(out, p.x_mm);
        out += "\" y=\"";
        append_single(out, p.y_mm);
        out += "\"/>\n";
      }
    out += "</s:vertices>\n";
    std::size_t first = 0;
    for (const Contour& ring : rings) {
      const std::size_t count = ring.vertices().size();
      const std::string start = std::to_string(first);
      out += "<s:polygon startv=\"" + start + "\">\n";
      for (std::size_t i = 1; i < count; ++i) out += "<s:segment v2=\"" + std::to_string(first + i) + "\"/>\n";
      out += "<s:segment v2=\"" + start + "\"/>\n</s:polygon>\n";
      first += count;
    }
    out += "</s:slice>\n";
  }
  if (layer + 1 == job_.layer_count) out += "</s:slicestack>\n";
}

void ThreeMfModel::end(std::string& out) {
  for (std::size_t i = 0; i < job_.parts.size(); ++i) {
    const bool supports = job_.parts[i].kind == PartKind::Supports;
    out += fmt::format("<object id=\"{}\" name=\"{}\" type=\"{}\" s:slicestackid=\"{}\" s:meshresolution=\"lowres\">",
                       object_id(i), name_of(job_.parts[i].kind), supports ? "support" : "model", stack_id(i));
    append_box(out, bounds_of_part(job_, i), job_.layer_count * job_.thickness_mm);
    out += "</object>\n";
  }
  out += "</resources>\n<build>\n";
  for (std::size_t i = 0; i < job_.parts.size(); ++i) out += fmt::format("<item objectid=\"{}\"/>\n", object_id(i));
  out += "</build>\n</model>\n";
}

Result<void> add_threemf_frame(ZipWriter& zip) {
  if (auto ok = zip.add("[Content_Types].xml", kContentTypes, Packing::Deflated); !ok) return ok;
  return zip.add("_rels/.rels", kRelationships, Packing::Deflated);
}

Result<void> write_threemf(const ContourJob& job, const std::filesystem::path& path, const ProgressSink& progress,
                           std::stop_token stop) {
  auto zip = ZipWriter::create(path);
  if (!zip) return tl::unexpected{zip.error()};
  if (auto ok = add_threemf_frame(*zip); !ok) return ok;
  const auto model = [&]() -> Result<std::vector<std::byte>> {
    ThreeMfModel text{job};
    std::string out;
    text.begin(out);
    const auto total = static_cast<std::uint32_t>(job.layer_count * job.parts.size());
    for (std::uint32_t i = 0; i < total; ++i) {
      if (stop.stop_requested()) return fail(ErrorCode::Cancelled, "the export was cancelled; nothing was written");
      text.layer(out, i);
      report(progress, WorkStage::WritingSlices, (i + 1.0) / total);
    }
    text.end(out);
    const auto bytes = std::as_bytes(std::span{out});
    return std::vector<std::byte>(bytes.begin(), bytes.end());
  };
  if (auto ok = zip->add("3D/3dmodel.model", model, Packing::Deflated); !ok) return ok;
  return zip->finish(WorkStage::PackingSlices, progress, stop);
}

}  // namespace telefab::fab
