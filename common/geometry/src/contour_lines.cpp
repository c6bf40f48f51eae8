// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <telefab/geometry/limits.hpp>

namespace telefab {

std::string to_json_line(const Layer& layer) {
  std::string line;
  auto out = std::back_inserter(line);
  fmt::format_to(out, "{{\"layer\":{},\"z_mm\":{},\"contours\":[", layer.index.count(), layer.z_mm);
  for (std::size_t r = 0; r < layer.contours.size(); ++r) {
    line += r ? ",[" : "[";
    const auto vertices = layer.contours[r].vertices();
    for (std::size_t i = 0; i < vertices.size(); ++i)
      fmt::format_to(out, "{}[{},{}]", i ? "," : "", vertices[i].x_mm, vertices[i].y_mm);
    line += ']';
  }
  line += "]}";
  return line;
}

Result<Layer> layer_from_json_line(std::string_view line) {
  using Json = nlohmann::ordered_json;
  const auto bad = [](std::string what) { return fail(ErrorCode::InvalidInput, "contour line: " + std::move(what)); };
  const Json value = json_or_discarded(line);
  if (value.is_discarded() || !value.is_object()) return bad("not a JSON object");
  const auto index = value.find("layer");
  const auto z = value.find("z_mm");
  const auto rings = value.find("contours");
  if (index == value.end() || !index->is_number_unsigned() || *index >= kMaxLayers)
    return bad("\"layer\" is missing or no layer number");
  if (z == value.end() || !z->is_number() || !std::isfinite(z->get<double>()))
    return bad("\"z_mm\" is missing or not a number");
  if (rings == value.end() || !rings->is_array()) return bad("\"contours\" is missing or not a list");
  if (rings->size() > kMaxRingsPerLayer) return fail(ErrorCode::TooLarge, "contour line: too many contours");
  Layer layer;
  layer.index = LayerIndex{whole_number<std::uint32_t>(*index)};
  layer.z_mm = z->get<double>();
  for (const Json& ring : *rings) {
    if (!ring.is_array() || ring.size() > kMaxVerticesPerLayer) return bad("a contour is not a list of vertices");
    std::vector<Point2> vertices;
    vertices.reserve(ring.size());
    for (const Json& vertex : ring) {
      if (!vertex.is_array() || vertex.size() != 2 || !vertex[0].is_number() || !vertex[1].is_number())
        return bad("a vertex is not [x, y]");
      vertices.push_back({vertex[0].get<double>(), vertex[1].get<double>()});
    }
    auto contour = Contour::from_vertices(std::move(vertices));
    if (!contour) return bad(contour.error().what);
    layer.certificate.measured_euler += contour->is_hole() ? -1 : 1;
    layer.contours.push_back(std::move(*contour));
  }
  return layer;
}

Result<void> read_json_lines(std::string_view text, const std::function<Result<void>(Layer)>& take) {
  for (std::size_t number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    auto layer = layer_from_json_line(text.substr(0, end));
    const auto taken = layer ? take(std::move(*layer)) : tl::unexpected{layer.error()};
    if (!taken) return fail_in(fmt::format("line {}", number), taken.error());
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return {};
}

}  // namespace telefab
