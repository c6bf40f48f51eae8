// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <functional>
#include <telefab/scan/contour/specks.hpp>

namespace telefab::scan {
namespace {

bool has_completed_stretch(const Layer& layer) {
  return std::ranges::any_of(layer.contours, [](const Contour& ring) {
    return std::ranges::any_of(ring.runs(), [](const SurfaceRun& r) { return r.kind == SurfaceClass::Completed; });
  });
}

}  // namespace

LeftOut leave_specks_out(Layer& layer, const SpeckRule& rule) {
  const auto is_small = [&](const Contour& ring) {
    const double area_mm2 = std::abs(ring.signed_area_mm2());
    return area_mm2 < rule.least_mm2 || 2 * area_mm2 < rule.thinnest_mm * ring.length_mm();
  };
  const auto first = std::stable_partition(layer.contours.begin(), layer.contours.end(), std::not_fn(is_small));
  if (first == layer.contours.end()) return {};
  // A speck that is thin, not small, may be wide enough somewhere to hold another ring.
  const std::vector<Contour> specks{first, layer.contours.end()};
  LeftOut out;
  const auto lies_in_a_speck = [&](const Contour& ring) {
    return std::ranges::any_of(specks, [&](const Contour& speck) { return contains(speck, ring.vertices()[0]); });
  };
  const auto gone = std::stable_partition(layer.contours.begin(), first, std::not_fn(lies_in_a_speck));
  for (auto ring = gone; ring != layer.contours.end(); ++ring) {
    ++out.rings;
    out.largest_mm2 = std::max(out.largest_mm2, std::abs(ring->signed_area_mm2()));
  }
  layer.contours.erase(gone, layer.contours.end());
  LayerCertificate& certificate = layer.certificate;
  certificate.specks += static_cast<std::uint32_t>(out.rings);
  if (certificate.verdict == LayerCertificate::Verdict::Completed && !has_completed_stretch(layer))
    certificate.verdict = LayerCertificate::Verdict::Measured;
  return out;
}

}  // namespace telefab::scan
