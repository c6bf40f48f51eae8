// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <telefab/geometry/certificate.hpp>

namespace telefab {
namespace {

std::string text(ContourCount count) { return fmt::format("{} outer and {} hole contours", count.outers, count.holes); }

}  // namespace

bool LayerCertificate::is_incomplete() const {
  return doubt && (doubt->reason == DoubtReason::ContoursLeftOut || doubt->reason == DoubtReason::ContourMissing);
}

void LayerCertificate::flag(Doubt why) {
  verdict = Verdict::Doubtful;
  doubt = why;
}

std::string_view name_of(LayerCertificate::Verdict verdict) {
  switch (verdict) {
    case LayerCertificate::Verdict::Unchecked:
      return "unchecked";
    case LayerCertificate::Verdict::Measured:
      return "measured";
    case LayerCertificate::Verdict::Doubtful:
      return "doubtful";
    case LayerCertificate::Verdict::Completed:
      return "completed";
  }
  return "unknown";
}

std::string_view name_of(LayerCertificate::Ground ground) {
  switch (ground) {
    case LayerCertificate::Ground::None:
      return "none";
    case LayerCertificate::Ground::Graph:
      return "graph";
    case LayerCertificate::Ground::TwoMethods:
      return "two-methods";
    case LayerCertificate::Ground::WindingTest:
      return "winding-test";
  }
  return "unknown";
}

std::string_view name_of(DoubtReason reason) {
  switch (reason) {
    case DoubtReason::ContoursLeftOut:
      return "contours-left-out";
    case DoubtReason::GapBridged:
      return "gap-bridged";
    case DoubtReason::ContourOpen:
      return "contour-open";
    case DoubtReason::RepeatsLayer:
      return "repeats-layer";
    case DoubtReason::ContoursCross:
      return "contours-cross";
    case DoubtReason::NestingWrong:
      return "nesting-wrong";
    case DoubtReason::ContourMissing:
      return "contour-missing";
    case DoubtReason::SurfaceUncovered:
      return "surface-uncovered";
    case DoubtReason::SamplesOffSurface:
      return "samples-off-surface";
    case DoubtReason::KernelsDisagree:
      return "kernels-disagree";
    case DoubtReason::EdgeTooSharp:
      return "edge-too-sharp";
    case DoubtReason::EulerDiffers:
      return "euler-differs";
    case DoubtReason::MethodsDisagree:
      return "methods-disagree";
    case DoubtReason::NotCrossChecked:
      return "not-cross-checked";
    case DoubtReason::RingTooSmall:
      return "ring-too-small";
    case DoubtReason::CrossOnLattice:
      return "cross-on-lattice";
    case DoubtReason::WindingDisagrees:
      return "winding-disagrees";
    case DoubtReason::EarlierRelease:
      return "earlier-release";
    case DoubtReason::CoordinatesRounded:
      return "coordinates-rounded";
    case DoubtReason::FacesEmpty:
      return "faces-empty";
    case DoubtReason::CriticalInGap:
      return "critical-in-gap";
    case DoubtReason::SheetsDoubled:
      return "sheets-doubled";
  }
  return "unknown";
}

std::string sentence_of(const LayerCertificate& certificate) {
  if (!certificate.doubt) return {};
  const Doubt& d = *certificate.doubt;
  switch (d.reason) {
    case DoubtReason::ContoursLeftOut:
      if (d.size_mm == 0) return "open contours were left out";
      return fmt::format("open contour, left out: the scan has a gap of {:.3g} mm here", d.size_mm);
    case DoubtReason::GapBridged:
      return fmt::format("open contour: the scan has a gap of {:.3g} mm here, closed by the side that all samples tell",
                         d.size_mm);
    case DoubtReason::ContourOpen:
      return "a contour does not close: the scan has a gap here";
    case DoubtReason::RepeatsLayer:
      return fmt::format("closed at the platform as asked: repeats layer {}, the lowest that is closed", d.number);
    case DoubtReason::ContoursCross:
      return "contours cross or touch";
    case DoubtReason::NestingWrong:
      return "contours do not nest as solid and hole";
    case DoubtReason::ContourMissing:
      if (certificate.specks > 0)
        return fmt::format("nothing is left: the {} contours found are too small to be printed", certificate.specks);
      return "the surface passes below and above the plane, but no contour was found";
    case DoubtReason::SurfaceUncovered:
      return fmt::format("the surface at {} samples reaches the plane beside every contour", d.number);
    case DoubtReason::SamplesOffSurface:
      return fmt::format("{} samples near the plane lie on no surface and beside no contour", d.number);
    case DoubtReason::KernelsDisagree:
      return fmt::format(
          "a kernel of {:.3g} mm finds {}, one of {:.3g} mm {}: details here are as small as the scan "
          "is uncertain",
          d.size_mm, text(d.found), d.other_mm, text(d.other));
    case DoubtReason::EdgeTooSharp:
      return "an edge sharper than the scan shows begins or ends near this height";
    case DoubtReason::EulerDiffers:
      return fmt::format("the critical points predict an Euler number of {}, the contours have {}",
                         certificate.predicted_euler.value_or(0), certificate.measured_euler);
    case DoubtReason::MethodsDisagree:
      if (d.found == d.other)
        return fmt::format(
            "marching and grid find {}, but the scan is too sparse for that to prove them at this height",
            text(d.found));
      return fmt::format("at a critical height marching finds {}, the grid {}", text(d.found), text(d.other));
    case DoubtReason::NotCrossChecked:
      return "too near to a critical height to be checked by one method alone";
    case DoubtReason::RingTooSmall:
      return "a ring smaller than the coding lattice was left out";
    case DoubtReason::CrossOnLattice:
      return "contours cross or touch on the coding lattice";
    case DoubtReason::WindingDisagrees:
      return fmt::format(
          "at {} points of its contours the winding number of the scan tells inside and outside "
          "otherwise",
          d.number);
    case DoubtReason::EarlierRelease:
      return "flagged by an earlier release, which said why in words that are not kept";
    case DoubtReason::CoordinatesRounded:
      return fmt::format("the coordinates of the scan are rounded to {:.2g} mm", d.size_mm);
    case DoubtReason::CriticalInGap:
      return fmt::format(
          "contours begin, end, part or join in a gap of the scan here, at a height known to {:.3g} mm only",
          d.size_mm);
    case DoubtReason::SheetsDoubled:
      return fmt::format(
          "the scan shows two sheets {:.2g} mm apart where one surface ought to be; register its views again",
          d.size_mm);
    case DoubtReason::FacesEmpty:
      return "the faces of the file carry no points, and points are all that is taken";
  }
  return "flagged for a reason unknown here";
}

}  // namespace telefab
