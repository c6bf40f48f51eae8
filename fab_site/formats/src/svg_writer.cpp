// SPDX-License-Identifier: GPL-3.0-or-later
#include "svg_writer.hpp"

namespace telefab::fab {
namespace {

void append_attribute(std::string& out, std::string_view name, double value_mm, std::string_view unit = "") {
  out += ' ';
  out += name;
  out += "=\"";
  append_mm(out, value_mm);
  out += unit;
  out += '"';
}

}  // namespace

void SvgText::begin(std::string& out) {
  out +=
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\""
      " xmlns:slic3r=\"http://slic3r.org/namespaces/slic3r\"";
  append_attribute(out, "width", job_.platform_mm.x_mm, "mm");
  append_attribute(out, "height", job_.platform_mm.y_mm, "mm");
  out += " viewBox=\"0 0 ";
  append_mm(out, job_.platform_mm.x_mm);
  out += ' ';
  append_mm(out, job_.platform_mm.y_mm);
  out += "\">\n";
}

void SvgText::layer(std::string& out, std::uint32_t index) {
  out += " <g id=\"layer" + std::to_string(index) + '"';
  append_attribute(out, "slic3r:z", top_mm(job_, index));
  append_attribute(out, "slic3r:slice-z", cut_height_mm(LayerIndex{index}, job_.thickness_mm));
  append_attribute(out, "slic3r:layer-height", job_.thickness_mm);
  out += ">\n";
  for (const ContourPart& part : job_.parts) {
    if (part.layers[index].empty()) continue;
    out += "  <path slic3r:type=\"";
    out += part.kind == PartKind::Part ? "contour" : "support";
    out += "\" fill=\"white\" fill-rule=\"evenodd\" d=\"";
    for (const Contour& ring : part.layers[index]) {
      char lead = 'M';
      for (const Point2 p : ring.vertices()) {
        out += lead;
        append_mm(out, p.x_mm);
        out += ' ';
        append_mm(out, job_.platform_mm.y_mm - p.y_mm);
        lead = lead == 'M' ? 'L' : ' ';
      }
      out += 'z';
    }
    out += "\"/>\n";
  }
  out += " </g>\n";
}

void SvgText::end(std::string& out) { out += "</svg>\n"; }

}  // namespace telefab::fab
