// SPDX-License-Identifier: GPL-3.0-or-later
// The size table of the codings over contour files, with the error reached on every layer, measured apart from the
// encoder: codec_sizes --pitch-mm 0.14 --layer-mm 0.15 a.jsonl b.jsonl ... (telefab-scan slice --contours a.jsonl)
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <string>
#include <telefab/codec/stack_codec.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <unordered_map>

namespace telefab {
namespace {

double seconds_since(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

/// The edges of a layer in square cells, so that the distance of a point to them is quickly found.
class Edges {
 public:
  Edges(const std::vector<Contour>& contours, double cell_mm) : cell_{cell_mm} {
    for (const Contour& contour : contours) {
      const auto v = contour.vertices();
      for (std::size_t i = 0; i < v.size(); ++i) add(v[i], v[i + 1 == v.size() ? 0 : i + 1]);
    }
  }
  /// Two cells where nothing is nearer.
  [[nodiscard]] double distance(Point2 p) const {
    double best = 4 * cell_ * cell_;
    const long cx = std::lround(std::floor(p.x_mm / cell_));
    const long cy = std::lround(std::floor(p.y_mm / cell_));
    for (long x = cx - 1; x <= cx + 1; ++x)
      for (long y = cy - 1; y <= cy + 1; ++y)
        if (const auto found = cells_.find(key(x, y)); found != cells_.end())
          for (const auto& [a, b] : found->second) best = std::min(best, square_distance(p, a, b));
    return std::sqrt(best);
  }

 private:
  static std::uint64_t key(long x, long y) {
    return (static_cast<std::uint64_t>(static_cast<std::uint32_t>(x)) << 32U) | static_cast<std::uint32_t>(y);
  }
  static double square_distance(Point2 p, Point2 a, Point2 b) {
    const double dx = b.x_mm - a.x_mm;
    const double dy = b.y_mm - a.y_mm;
    const double length = dx * dx + dy * dy;
    const double along =
        length > 0 ? std::clamp(((p.x_mm - a.x_mm) * dx + (p.y_mm - a.y_mm) * dy) / length, 0.0, 1.0) : 0;
    const double ex = p.x_mm - a.x_mm - along * dx;
    const double ey = p.y_mm - a.y_mm - along * dy;
    return ex * ex + ey * ey;
  }
  void add(Point2 a, Point2 b) {
    const auto parts = static_cast<int>(std::ceil(distance_mm(a, b) / cell_)) + 1;
    std::uint64_t before = ~std::uint64_t{0};
    for (int i = 0; i <= parts; ++i) {
      const double t = static_cast<double>(i) / parts;
      const std::uint64_t here = key(std::lround(std::floor((a.x_mm + t * (b.x_mm - a.x_mm)) / cell_)),
                                     std::lround(std::floor((a.y_mm + t * (b.y_mm - a.y_mm)) / cell_)));
      if (here != before) cells_[here].push_back({a, b});
      before = here;
    }
  }
  double cell_;
  std::unordered_map<std::uint64_t, std::vector<std::pair<Point2, Point2>>> cells_;
};

/// Largest distance of vertices and points on the edges (every 1/8 of one) of one layer to the edges of the other.
double farthest(const std::vector<Contour>& from, const Edges& to) {
  double worst = 0;
  for (const Contour& contour : from) {
    const auto v = contour.vertices();
    for (std::size_t i = 0; i < v.size(); ++i) {
      const Point2 a = v[i];
      const Point2 b = v[i + 1 == v.size() ? 0 : i + 1];
      for (int k = 0; k < 8; ++k)
        worst = std::max(worst, to.distance({a.x_mm + k * (b.x_mm - a.x_mm) / 8, a.y_mm + k * (b.y_mm - a.y_mm) / 8}));
    }
  }
  return worst;
}

Result<LayerStack> read_stack(const std::string& path, double pitch_mm, double layer_mm) {
  std::ifstream file{path};
  std::vector<Layer> layers;
  Bounds2 bounds = Bounds2::nothing();
  for (std::string line; std::getline(file, line);) {
    auto layer = layer_from_json_line(line);
    if (!layer) return tl::unexpected{layer.error()};
    for (const Contour& contour : layer->contours) bounds.include(contour.bounds());
    layer->certificate.verdict = LayerCertificate::Verdict::Measured;  // so that crossings are looked for
    layers.push_back(std::move(*layer));
  }
  StackHeader header;
  header.machine = "any";
  header.layer_thickness_mm = layer_mm;
  header.pixel_pitch_mm = pitch_mm;
  header.layer_count = static_cast<std::uint32_t>(layers.size());
  header.bounds = {{bounds.min.x_mm - pitch_mm, bounds.min.y_mm - pitch_mm},
                   {bounds.max.x_mm + pitch_mm, bounds.max.y_mm + pitch_mm}};
  header.scan_name = path;
  for (std::uint32_t i = 0; i < layers.size(); ++i) layers[i].z_mm = cut_height_mm(LayerIndex{i}, layer_mm);
  return LayerStack::from_layers(header, std::move(layers));
}

struct Row {
  double kb = 0;
  double worst_pitch = 0;
  std::uint32_t worst_layer = 0;
  double encode_s = 0;
  double decode_s = 0;
  std::size_t vertices = 0;
  int left_out = 0;         ///< rings smaller than the coding's grid; their layers say so
  double left_out_mm2 = 0;  ///< area of the largest of them
};

/// The rings given that are not among the decoded ones: none of their vertices lies near one.
std::vector<Contour> take_left_out(std::vector<Contour>& given, const Edges& decoded, double near_mm) {
  std::vector<Contour> out;
  std::vector<Contour> kept;
  for (Contour& contour : given) {
    const auto v = contour.vertices();
    const bool is_out = std::all_of(v.begin(), v.end(), [&](Point2 p) { return decoded.distance(p) > near_mm; });
    (is_out ? out : kept).push_back(std::move(contour));
  }
  given = std::move(kept);
  return out;
}

Result<Row> measure(const LayerStack& stack, const CodecOptions& options) {
  Row row;
  auto encoder = StackEncoder::start(stack.header(), options);
  if (!encoder) return tl::unexpected{encoder.error()};
  std::vector<Chunk> chunks;
  auto began = std::chrono::steady_clock::now();
  for (const Layer& layer : stack.layers()) {
    auto chunk = encoder->add(layer);
    if (!chunk) return tl::unexpected{chunk.error()};
    if (*chunk) chunks.push_back(std::move(**chunk));
  }
  auto last = encoder->finish();
  if (!last) return tl::unexpected{last.error()};
  if (*last) chunks.push_back(std::move(**last));
  row.encode_s = seconds_since(began);
  const auto decoder = StackDecoder::start(stack.header());
  if (!decoder) return tl::unexpected{decoder.error()};
  std::vector<std::vector<Layer>> decoded;
  began = std::chrono::steady_clock::now();
  for (const Chunk& chunk : chunks) {
    auto layers = decoder->decode(chunk);
    if (!layers) return tl::unexpected{layers.error()};
    row.kb += static_cast<double>(chunk.payload.size()) / 1000;
    decoded.push_back(std::move(*layers));
  }
  row.decode_s = seconds_since(began);
  const double pitch = stack.header().pixel_pitch_mm;
  for (const auto& chunk : decoded)
    for (const Layer& layer : chunk) {
      std::vector<Contour> given = stack.layers()[layer.index.count()].contours;
      const Edges edges{layer.contours, 5 * pitch};
      if (layer.contours.size() < given.size())
        for (const Contour& lost : take_left_out(given, edges, pitch)) {
          ++row.left_out;
          row.left_out_mm2 = std::max(row.left_out_mm2, std::abs(lost.signed_area_mm2()));
        }
      for (const Contour& contour : layer.contours) row.vertices += contour.vertices().size();
      const double error = std::max(farthest(layer.contours, Edges{given, 5 * pitch}), farthest(given, edges)) / pitch;
      if (error > row.worst_pitch) row.worst_layer = layer.index.count();
      row.worst_pitch = std::max(row.worst_pitch, error);
    }
  return row;
}

int run(const std::vector<std::string>& words) {
  double pitch_mm = 0.14;
  double layer_mm = 0.15;
  CodecOptions options;
  std::vector<std::string> files;
  std::string coding;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const bool more = i + 1 < words.size();
    if (words[i] == "--pitch-mm" && more)
      pitch_mm = std::stod(words[++i]);
    else if (words[i] == "--layer-mm" && more)
      layer_mm = std::stod(words[++i]);
    else if (words[i] == "--chord-pitch" && more)
      options.chord_error_pitch = std::stod(words[++i]);
    else if (words[i] == "--coding" && more)
      coding = words[++i];
    else
      files.push_back(words[i]);
  }
  fmt::print(
      "| file | layers | contour m | vertices | float64 kB | coding | kB | of float64 | bits/mm | bits/vertex given "
      "| vertices kept | worst error pitch (layer) | rings left out (largest mm2) | encode layers/s | decode layers/s "
      "|\n");
  fmt::print("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n");
  for (const std::string& file : files) {
    const auto stack = read_stack(file, pitch_mm, layer_mm);
    if (!stack) {
      fmt::print(stderr, "{}: {}\n", file, stack.error().what);
      return 2;
    }
    double length_mm = 0;
    std::size_t vertices = 0;
    for (const Layer& layer : stack->layers())
      for (const Contour& contour : layer.contours) {
        const auto v = contour.vertices();
        vertices += v.size();
        for (std::size_t i = 0; i < v.size(); ++i) {
          const Point2 b = v[i + 1 == v.size() ? 0 : i + 1];
          length_mm += distance_mm(v[i], b);
        }
      }
    for (const Coding each : {Coding::Exact, Coding::Curve}) {
      const char* name = each == Coding::Exact ? "exact" : "curve";
      if (!coding.empty() && coding != name) continue;
      options.coding = each;
      const auto row = measure(*stack, options);
      if (!row) {
        fmt::print(stderr, "{}: {}: {}\n", file, name, row.error().what);
        return 5;
      }
      const double raw_kb = static_cast<double>(vertices) * 16 / 1000;
      const double layers = static_cast<double>(stack->layers().size());
      fmt::print(
          "| {} | {} | {:.1f} | {} | {:.0f} | {} | {:.1f} | 1/{:.0f} | {:.2f} | {:.2f} | {} | {:.4f} ({}) | {} "
          "({:.1g}) | {:.0f} | "
          "{:.0f} |\n",
          file.substr(file.find_last_of('/') + 1), stack->layers().size(), length_mm / 1000, vertices, raw_kb, name,
          row->kb, raw_kb / row->kb, row->kb * 8000 / length_mm, row->kb * 8000 / static_cast<double>(vertices),
          row->vertices, row->worst_pitch, row->worst_layer, row->left_out, row->left_out_mm2, layers / row->encode_s,
          layers / row->decode_s);
      std::fflush(stdout);
    }
  }
  return 0;
}

}  // namespace
}  // namespace telefab

int main(int count, char** words) { return telefab::run({words + 1, words + count}); }
