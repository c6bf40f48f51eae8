// SPDX-License-Identifier: GPL-3.0-or-later
#include "layer_tally.hpp"

#include <algorithm>
#include <telefab/scan/contour/specks.hpp>

namespace telefab::scan {
namespace {

/// Thinner rings than this no mask shows, and the lattices of the wire, a sixteenth of a pixel wide, keep all others.
constexpr double kThinnest_px = 0.125;

}  // namespace

tl::unexpected<Error> refused(const SliceReport& report, Error why) {
  const std::vector<std::string>& noticed = report.warnings;
  for (std::size_t i = 0; i < noticed.size(); ++i) why.what += (i == 0 ? " (noticed: " : "; ") + noticed[i];
  if (!noticed.empty()) why.what += ")";
  return fail_in(report.header.scan_name, why);
}

Result<void> LayerTally::take(CutLayer&& cut) {
  const StackHeader& header = report_.header;
  Layer& layer = cut.layer;
  const LeftOut specks = leave_specks_out(layer, {report_.specks.least_mm2, kThinnest_px * header.pixel_pitch_mm});
  if (specks.rings > 0) report_.specks.layers.push_back(layer.index);
  report_.specks.rings += specks.rings;
  report_.specks.largest_mm2 = std::max(report_.specks.largest_mm2, specks.largest_mm2);
  check_.look_at(layer);
  const LayerCertificate& certificate = layer.certificate;
  ++report_.layers_cut;
  report_.layer_evaluations.push_back(cut.evaluations);
  report_.contours += layer.contours.size();
  for (const Contour& c : layer.contours) report_.vertices += c.vertices().size();
  const SurfaceShares shares = surface_shares(layer);
  report_.shares += shares;
  if (certificate.is_certified()) {
    ++report_.certified;
    if (certificate.verdict == LayerCertificate::Verdict::Completed) ++report_.completed;
    if (certificate.method == LayerCertificate::Method::Reeb) ++report_.certified_by_march;
  } else {
    const double length = shares.length_mm();
    report_.flagged.push_back({layer.index, layer.z_mm, certificate, length > 0 ? shares.doubtful_mm / length : 1.0});
  }
  for (const ContourGap& gap : cut.gaps)
    report_.gaps.push_back({layer.index, layer.z_mm, gap.place, gap.size_mm, gap.bridged});
  if (auto ok = validate_layer(header, layer); !ok) return ok;
  return sink_(header, std::move(layer));
}

Result<void> LayerTally::finish() {
  auto verdict = check_.verdict(report_.header, report_.layers_cut == report_.header.layer_count);
  if (!verdict) return refused(report_, verdict.error());
  for (std::string& sentence : *verdict) report_.warnings.push_back(std::move(sentence));
  return {};
}

}  // namespace telefab::scan
