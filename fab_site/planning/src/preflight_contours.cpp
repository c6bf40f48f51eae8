// SPDX-License-Identifier: GPL-3.0-or-later
#include "preflight_contours.hpp"

#include <fmt/format.h>

namespace telefab::fab {

using Verdict = PreflightItem::Verdict;

PreflightItem certificates_of(const LayerStack& stack, const PlanSummary& summary) {
  std::size_t flagged = 0, unchecked = 0, lacking = 0;
  const Layer* first = nullptr;
  for (const Layer& layer : stack.layers()) {
    unchecked += layer.certificate.verdict == LayerCertificate::Verdict::Unchecked;
    if (layer.certificate.verdict != LayerCertificate::Verdict::Doubtful) continue;
    ++flagged;
    const bool lacks = layer.certificate.is_incomplete();
    // What is missing says more than what is doubtful.
    if (!first || (lacks && lacking == 0)) first = &layer;
    lacking += lacks;
  }
  PreflightItem item{"certificates", Verdict::Passed, {}, static_cast<double>(flagged), "layers", {}, {}};
  if (first) {
    item.verdict = lacking > 0 ? Verdict::Held : Verdict::Warning;
    item.layer = LayerIndex{first->index.count() + summary.elevation_layers};
    item.place = first->certificate.doubt->place;
    item.text = fmt::format("{} of {} layers are flagged by the slicer; the first, layer {}: {}", flagged,
                            stack.layers().size(), item.layer->count(), sentence_of(first->certificate));
    if (lacking > 0)
      item.text = fmt::format(
          "{} of {} layers lack contours of the object; the first, layer {}: {}; scan it there again, or slice "
          "with --complete auto",
          lacking, stack.layers().size(), item.layer->count(), sentence_of(first->certificate));
  } else if (unchecked > 0) {
    item.verdict = Verdict::NotKnown;
    item.text = fmt::format("{} layers carry no certificate: their contours come from elsewhere", unchecked);
  } else {
    item.text = fmt::format("all {} layers are certified", stack.layers().size());
  }
  return item;
}

PreflightItem empty_layers_of(const LayerStack& stack, const PlanSummary& summary) {
  const auto layers = stack.layers();
  std::size_t low = 0, high = layers.size();
  while (low < high && layers[low].contours.empty()) ++low;
  while (high > low && layers[high - 1].contours.empty()) --high;
  std::size_t empty = 0;
  PreflightItem item{"empty-layers", Verdict::Passed, {}, 0.0, "layers", {}, {}};
  for (std::size_t i = low; i < high; ++i) {
    if (!layers[i].contours.empty()) continue;
    if (++empty == 1) item.layer = LayerIndex{layers[i].index.count() + summary.elevation_layers};
  }
  item.value = static_cast<double>(empty);
  item.text = "no layer inside the part is empty";
  if (empty == 0) return item;
  item.verdict = Verdict::Held;
  item.text = fmt::format(
      "{} layers inside the part have no contour, the first is layer {}: what lies above them is not connected with "
      "what "
      "lies below. If the object is not in two pieces there, slice it again with a wider --kernel-mm, or scan it "
      "closer",
      empty, item.layer->count());
  return item;
}

PreflightItem surface_of(const LayerStack& stack, const PlanSummary& summary) {
  SurfaceShares all;
  const Layer* widest = nullptr;
  double widest_mm = 0;
  for (const Layer& layer : stack.layers()) {
    const SurfaceShares shares = surface_shares(layer);
    if (shares.largest_gap_mm > widest_mm) {
      widest = &layer;
      widest_mm = shares.largest_gap_mm;
    }
    all += shares;
  }
  const double length = all.length_mm() > 0 ? all.length_mm() : 1;
  const double completed = all.completed_mm / length;
  const double doubtful = all.doubtful_mm / length;
  PreflightItem item{"surface", Verdict::Passed, {}, 100 * completed, "%", {}, {}};
  if (widest) item.layer = LayerIndex{widest->index.count() + summary.elevation_layers};
  if (completed + doubtful == 0) {
    item.text = "no stretch of a contour is completed or doubtful";
    return item;
  }
  item.text = fmt::format(
      "{:.1f} % of the contours are completed where the scan shows nothing, up to {:.2f} mm from its samples, and may "
      "be "
      "wrong there by up to {:.2f} mm; {:.1f} % are doubtful",
      100 * completed, all.largest_gap_mm, all.largest_error_mm, 100 * doubtful);
  item.verdict = Verdict::Warning;
  const auto exceeds = [&](double value, const std::optional<double>& limit, double scale, std::string_view option) {
    if (!limit || value <= *limit) return;
    item.verdict = Verdict::Held;
    item.text += fmt::format("; more than {} {:.3g} allows", option, scale * *limit);
  };
  const ContourLimits& limits = summary.contour_limits;
  exceeds(completed, limits.completed_share, 100, "--most-completed");
  exceeds(doubtful, limits.doubtful_share, 100, "--most-doubtful");
  exceeds(all.largest_gap_mm, limits.gap_mm, 1, "--most-gap-mm");
  exceeds(all.largest_error_mm, limits.error_mm, 1, "--most-error-mm");
  return item;
}

}  // namespace telefab::fab
