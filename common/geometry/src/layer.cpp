// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cmath>
#include <optional>
#include <string_view>
#include <telefab/geometry/layer.hpp>
#include <telefab/geometry/limits.hpp>

namespace telefab {
namespace {

bool lower(Point2 a, Point2 b) { return a.y_mm != b.y_mm ? a.y_mm < b.y_mm : a.x_mm < b.x_mm; }

bool holds(const Bounds2& box, Point2 p) {
  return p.x_mm >= box.min.x_mm && p.x_mm <= box.max.x_mm && p.y_mm >= box.min.y_mm && p.y_mm <= box.max.y_mm;
}

/// What the certificate says of the contours must be what their runs say.
std::optional<std::string_view> contradiction(const Layer& layer) {
  using Verdict = LayerCertificate::Verdict;
  const LayerCertificate& c = layer.certificate;
  bool runs = false, completed = false, doubtful = false;
  for (const Contour& contour : layer.contours)
    for (const SurfaceRun& run : contour.runs()) {
      runs = true;
      completed |= run.kind == SurfaceClass::Completed;
      doubtful |= run.kind == SurfaceClass::Doubtful;
    }
  if (c.doubt.has_value() != (c.verdict == Verdict::Doubtful))
    return c.doubt ? "a doubt in a layer that is not doubtful" : "a doubtful layer that does not say why";
  if (c.verdict == Verdict::Unchecked && runs) return "nobody looked at its contours, yet they say what they rest on";
  if (c.is_certified() && doubtful) return "certified, with doubtful stretches";
  if (c.verdict == Verdict::Measured && completed) return "certified as measured, with completed stretches";
  if (c.verdict == Verdict::Completed && !completed) return "certified as completed, with no completed stretch";
  return std::nullopt;
}

}  // namespace

std::vector<Contour> sorted_canonically(std::vector<Contour> contours) {
  std::vector<Contour> rotated;
  rotated.reserve(contours.size());
  for (const Contour& contour : contours) {
    std::vector<Point2> ring(contour.vertices().begin(), contour.vertices().end());
    const auto first = std::min_element(ring.begin(), ring.end(), lower);
    const auto turned = first - ring.begin();
    std::rotate(ring.begin(), first, ring.end());
    Contour made = *Contour::from_vertices(std::move(ring));
    if (!contour.runs().empty()) {
      auto runs = one_an_edge(contour.runs(), contour.vertices().size());
      std::rotate(runs.begin(), runs.begin() + turned, runs.end());
      made = *made.with_runs(runs);
    }
    rotated.push_back(std::move(made));
  }
  std::sort(rotated.begin(), rotated.end(), [](const Contour& a, const Contour& b) {
    const Point2 pa = a.vertices()[0];
    const Point2 pb = b.vertices()[0];
    if (!(pa == pb)) return lower(pa, pb);
    if (a.signed_area_mm2() != b.signed_area_mm2()) return a.signed_area_mm2() < b.signed_area_mm2();
    return std::lexicographical_compare(a.vertices().begin(), a.vertices().end(), b.vertices().begin(),
                                        b.vertices().end(), lower);
  });
  return rotated;
}

SurfaceShares& SurfaceShares::operator+=(const SurfaceShares& more) {
  measured_mm += more.measured_mm;
  completed_mm += more.completed_mm;
  doubtful_mm += more.doubtful_mm;
  largest_gap_mm = std::max(largest_gap_mm, more.largest_gap_mm);
  largest_error_mm = std::max(largest_error_mm, more.largest_error_mm);
  return *this;
}

SurfaceShares surface_shares(const Layer& layer) {
  SurfaceShares shares;
  for (const Contour& contour : layer.contours) {
    if (contour.runs().empty()) {
      shares.measured_mm += contour.length_mm();
      continue;
    }
    const auto v = contour.vertices();
    std::size_t edge = 0;
    for (const SurfaceRun& run : contour.runs()) {
      double& length = run.kind == SurfaceClass::Measured    ? shares.measured_mm
                       : run.kind == SurfaceClass::Completed ? shares.completed_mm
                                                             : shares.doubtful_mm;
      for (const std::size_t end = edge + run.edges; edge < end; ++edge) {
        const Point2 a = v[edge];
        const Point2 b = v[(edge + 1) % v.size()];
        length += distance_mm(a, b);
      }
      if (run.kind != SurfaceClass::Completed) continue;
      shares.largest_gap_mm = std::max(shares.largest_gap_mm, run.gap_mm);
      shares.largest_error_mm = std::max(shares.largest_error_mm, run.error_mm);
    }
  }
  return shares;
}

double cut_height_mm(LayerIndex index, double layer_thickness_mm) { return (index.count() + 0.5) * layer_thickness_mm; }

Result<void> StackHeader::validate() const {
  const auto positive = [](double v, double most) { return std::isfinite(v) && v > 0 && v <= most; };
  if (!positive(layer_thickness_mm, 10))
    return fail(ErrorCode::InvalidInput, fmt::format("layer thickness {} mm is not in (0, 10]", layer_thickness_mm));
  if (!positive(pixel_pitch_mm, 10))
    return fail(ErrorCode::InvalidInput, fmt::format("pixel pitch {} mm is not in (0, 10]", pixel_pitch_mm));
  if (layer_count == 0 || layer_count > kMaxLayers)
    return fail(ErrorCode::InvalidInput, fmt::format("layer count {} is not in 1..{}", layer_count, kMaxLayers));
  const auto fits = [](double v) { return std::isfinite(v) && std::abs(v) <= kMaxCoordinateMm; };
  if (!fits(bounds.min.x_mm) || !fits(bounds.min.y_mm) || !fits(bounds.max.x_mm) || !fits(bounds.max.y_mm) ||
      bounds.min.x_mm > bounds.max.x_mm || bounds.min.y_mm > bounds.max.y_mm)
    return fail(ErrorCode::InvalidInput, "the stack's bounds are not finite, ordered and below 10 m");
  for (const double t : scan_to_build)
    if (!std::isfinite(t)) return fail(ErrorCode::InvalidInput, "scan_to_build has an entry that is not finite");
  if (machine.size() > 256 || scan_name.size() > 1024)
    return fail(ErrorCode::InvalidInput, "machine or scan name is too long");
  return {};
}

Result<void> validate_layer(const StackHeader& header, const Layer& layer) {
  const auto where = [&] { return fmt::format("layer {}", layer.index.count()); };
  if (layer.index.count() >= header.layer_count)
    return fail(ErrorCode::InvalidInput, fmt::format("{}: the stack has {} layers", where(), header.layer_count));
  if (layer.z_mm != cut_height_mm(layer.index, header.layer_thickness_mm))
    return fail(ErrorCode::InvalidInput, fmt::format("{}: z {} mm is not its cut height", where(), layer.z_mm));
  if (layer.contours.size() > kMaxRingsPerLayer)
    return fail(ErrorCode::TooLarge, fmt::format("{}: {} rings", where(), layer.contours.size()));
  std::size_t vertices = 0;
  for (const Contour& contour : layer.contours) {
    vertices += contour.vertices().size();
    if (auto ok = validate_runs(contour.runs(), contour.vertices().size()); !ok) return fail_in(where(), ok.error());
    for (const Point2 p : contour.vertices())
      if (!holds(header.bounds, p))
        return fail(ErrorCode::InvalidInput,
                    fmt::format("{}: vertex ({}, {}) mm lies outside the stated bounds", where(), p.x_mm, p.y_mm));
  }
  if (vertices > kMaxVerticesPerLayer)
    return fail(ErrorCode::TooLarge, fmt::format("{}: {} vertices", where(), vertices));
  if (const auto what = contradiction(layer))
    return fail(ErrorCode::InvalidInput, fmt::format("{}: {}", where(), *what));
  return {};
}

Bounds2 bounds_of(std::span<const Layer> layers) {
  Bounds2 all = Bounds2::nothing();
  for (const Layer& layer : layers)
    for (const Contour& ring : layer.contours) all.include(ring.bounds());
  return all;
}

Result<LayerStack> LayerStack::from_layers(StackHeader header, std::vector<Layer> layers) {
  if (auto ok = header.validate(); !ok) return tl::unexpected{ok.error()};
  if (layers.size() != header.layer_count)
    return fail(ErrorCode::InvalidInput,
                fmt::format("the header says {} layers, there are {}", header.layer_count, layers.size()));
  for (std::size_t i = 0; i < layers.size(); ++i) {
    if (layers[i].index.count() != i)
      return fail(ErrorCode::InvalidInput, fmt::format("layer {} stands where {} belongs", layers[i].index.count(), i));
    if (auto ok = validate_layer(header, layers[i]); !ok) return tl::unexpected{ok.error()};
  }
  return LayerStack{std::move(header), std::move(layers)};
}

std::string canonical_text(const StackHeader& h) {
  std::string text = fmt::format("stack layers {} thickness {:a} pitch {:a} bounds {:a} {:a} {:a} {:a} transform",
                                 h.layer_count, h.layer_thickness_mm, h.pixel_pitch_mm, h.bounds.min.x_mm,
                                 h.bounds.min.y_mm, h.bounds.max.x_mm, h.bounds.max.y_mm);
  for (const double t : h.scan_to_build) text += fmt::format(" {:a}", t);
  text += fmt::format("\nmachine {} {}\nscan {} {}\n", h.machine.size(), h.machine, h.scan_name.size(), h.scan_name);
  return text;
}

std::string canonical_text(const Layer& layer) {
  const LayerCertificate& c = layer.certificate;
  std::string text = fmt::format("layer {} z {:a} rings {}\ncertificate {} {} {} euler {} predicted ",
                                 layer.index.count(), layer.z_mm, layer.contours.size(), static_cast<int>(c.verdict),
                                 static_cast<int>(c.method), static_cast<int>(c.ground), c.measured_euler);
  text += c.predicted_euler ? fmt::format("{}", *c.predicted_euler) : std::string{"-"};
  if (c.specks > 0) text += fmt::format(" specks {}", c.specks);
  if (c.doubt) {
    const Doubt& d = *c.doubt;
    text += fmt::format(" doubt {} {} {:a} {:a} {} {} {} {} place ", static_cast<int>(d.reason), d.number, d.size_mm,
                        d.other_mm, d.found.outers, d.found.holes, d.other.outers, d.other.holes);
    text += d.place ? fmt::format("{:a} {:a}", d.place->x_mm, d.place->y_mm) : std::string{"-"};
  }
  text += '\n';
  for (const Contour& contour : layer.contours) {
    text += fmt::format("ring {}", contour.vertices().size());
    for (const SurfaceRun& run : contour.runs())
      text += fmt::format(" {} {} {:a} {:a}", static_cast<int>(run.kind), run.edges, run.gap_mm, run.error_mm);
    text += '\n';
    for (const Point2 p : contour.vertices()) text += fmt::format("{:a} {:a}\n", p.x_mm, p.y_mm);
  }
  return text;
}

Digest digest_of(const LayerStack& stack) {
  Hasher hasher;
  hasher.feed(canonical_text(stack.header()));
  for (const Layer& layer : stack.layers()) hasher.feed(canonical_text(layer));
  return hasher.digest();
}

}  // namespace telefab
