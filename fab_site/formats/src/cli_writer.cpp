// SPDX-License-Identifier: GPL-3.0-or-later
#include "cli_writer.hpp"

#include <bit>

#include "cli_commands.hpp"

namespace telefab::fab {
namespace {

void put16(std::string& out, std::uint16_t value) {
  out += static_cast<char>(value & 0xFFU);
  out += static_cast<char>(value >> 8U);
}
void put32(std::string& out, std::uint32_t value) {
  for (unsigned shift = 0; shift < 32; shift += 8) out += static_cast<char>((value >> shift) & 0xFFU);
}
void put_real(std::string& out, double value) { put32(out, std::bit_cast<std::uint32_t>(static_cast<float>(value))); }

void append_number(std::string& out, std::uint64_t value) { out += std::to_string(value); }

}  // namespace

void CliText::begin(std::string& out) {
  out += "$$HEADERSTART\n";
  out += binary_ ? "$$BINARY\n" : "$$ASCII\n";
  out += "$$UNITS/1\n$$VERSION/200\n";
  for (const ContourPart& part : job_.parts) {
    out += "$$LABEL/" + std::to_string(static_cast<int>(part.kind)) + ",";
    out += name_of(part.kind);
    out += '\n';
  }
  const Bounds2 bounds = bounds_of(job_);
  out += "$$DIMENSION/";
  for (const double v : {bounds.min.x_mm, bounds.min.y_mm, 0.0, bounds.max.x_mm, bounds.max.y_mm}) {
    append_mm(out, v);
    out += ',';
  }
  append_mm(out, job_.layer_count * job_.thickness_mm);
  out += "\n$$LAYERS/" + std::to_string(job_.layer_count + 1) + "\n$$HEADEREND";
  // Binary commands follow without a byte between.
  if (!binary_) out += "\n$$GEOMETRYSTART\n";
  start_layer(out, 0);
}

void CliText::start_layer(std::string& out, double z_mm) const {
  if (binary_) {
    put16(out, kCliLayerLong);
    put_real(out, z_mm);
    return;
  }
  out += "$$LAYER/";
  append_mm(out, z_mm);
  out += '\n';
}

void CliText::layer(std::string& out, std::uint32_t index) {
  start_layer(out, top_mm(job_, index));
  for (const ContourPart& part : job_.parts)
    for (const Contour& ring : part.layers[index]) {
      const auto vertices = ring.vertices();
      const auto count = static_cast<std::uint32_t>(vertices.size() + 1);  // the first one closes the ring
      const auto id = static_cast<std::uint32_t>(part.kind);
      const std::uint32_t direction = ring.is_hole() ? kCliClockwise : kCliCounterClockwise;
      if (binary_) {
        put16(out, kCliPolylineLong);
        put32(out, id);
        put32(out, direction);
        put32(out, count);
      } else {
        out += "$$POLYLINE/";
        append_number(out, id);
        out += ',';
        append_number(out, direction);
        out += ',';
        append_number(out, count);
      }
      for (std::size_t i = 0; i <= vertices.size(); ++i) {
        const Point2 p = vertices[i == vertices.size() ? 0 : i];
        if (binary_) {
          put_real(out, p.x_mm);
          put_real(out, p.y_mm);
        } else {
          out += ',';
          append_mm(out, p.x_mm);
          out += ',';
          append_mm(out, p.y_mm);
        }
      }
      if (!binary_) out += '\n';
    }
}

void CliText::end(std::string& out) {
  if (!binary_) out += "$$GEOMETRYEND\n";
}

}  // namespace telefab::fab
