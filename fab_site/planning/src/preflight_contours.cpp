// SPDX-License-Identifier: GPL-3.0-or-later
#include "preflight_contours.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <span>

namespace telefab::fab {

using Verdict = PreflightItem::Verdict;

namespace {

/// The surface may end by that much of the height within the outermost samples: edges and tips are rounded by about the
/// spacing of a scan. Chosen; the scans that were tried lack 0.8 to 1.8 %, one of 161 points 10 %.
constexpr double kRoundedEnds = 0.02;

/// First layer with contours, and the one behind the last.
struct Filled {
  std::size_t first = 0, behind = 0;
  [[nodiscard]] bool is_end(std::size_t layer) const { return layer < first || layer >= behind; }
};

Filled filled_of(std::span<const Layer> layers) {
  Filled filled{0, layers.size()};
  while (filled.first < filled.behind && layers[filled.first].contours.empty()) ++filled.first;
  while (filled.behind > filled.first && layers[filled.behind - 1].contours.empty()) --filled.behind;
  return filled;
}

/// Layers that lack contours of the object.
struct Lacking {
  std::size_t inside = 0;
  std::size_t ends = 0;          ///< above all contours, or below
  const Layer* first = nullptr;  ///< inside where there are such
  double ends_share = 0;         ///< of the height, from the outermost of them to the contours
};

Lacking lacking_of(std::span<const Layer> layers) {
  const Filled filled = filled_of(layers);
  Lacking lacking;
  std::size_t below = 0, above = 0;
  for (std::size_t i = 0; i < layers.size(); ++i) {
    const LayerCertificate& certificate = layers[i].certificate;
    if (certificate.verdict != LayerCertificate::Verdict::Doubtful || !certificate.is_incomplete()) continue;
    const bool is_end = filled.is_end(i);
    if (!lacking.first || (!is_end && lacking.inside == 0)) lacking.first = &layers[i];
    ++(is_end ? lacking.ends : lacking.inside);
    if (i < filled.first) below = std::max(below, filled.first - i);
    if (i >= filled.behind) above = std::max(above, i + 1 - filled.behind);
  }
  if (!layers.empty()) lacking.ends_share = static_cast<double>(below + above) / static_cast<double>(layers.size());
  return lacking;
}

}  // namespace

PreflightItem certificates_of(const LayerStack& stack, const PlanSummary& summary) {
  std::size_t flagged = 0, unchecked = 0;
  const Layer* first = nullptr;
  for (const Layer& layer : stack.layers()) {
    unchecked += layer.certificate.verdict == LayerCertificate::Verdict::Unchecked;
    if (layer.certificate.verdict != LayerCertificate::Verdict::Doubtful) continue;
    if (++flagged == 1) first = &layer;
  }
  const Lacking lacking = lacking_of(stack.layers());
  if (lacking.first) first = lacking.first;  // what is missing says more than what is doubtful
  PreflightItem item{"certificates", Verdict::Passed, {}, static_cast<double>(flagged), "layers", {}, {}};
  if (first) {
    const std::size_t all = stack.layers().size();
    item.verdict = Verdict::Warning;
    item.layer = LayerIndex{first->index.count() + summary.elevation_layers};
    item.place = first->certificate.doubt->place;
    item.text = fmt::format("{} of {} layers are flagged by the slicer; the first, layer {}: {}", flagged, all,
                            item.layer->count(), sentence_of(first->certificate));
    if (lacking.inside == 0 && lacking.ends > 0 && lacking.ends_share <= kRoundedEnds) {
      const double mm = lacking.ends_share * static_cast<double>(all) * stack.header().layer_thickness_mm;
      item.text += fmt::format("; the part ends {:.2f} mm within the outermost samples", mm);
    } else if (lacking.first) {
      item.verdict = Verdict::Held;
      item.text = fmt::format(
          "{} of {} layers lack contours of the object; the first, layer {}: {}; scan it there again, or slice "
          "with --complete auto",
          lacking.inside + lacking.ends, all, item.layer->count(), sentence_of(first->certificate));
    }
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
  const Filled filled = filled_of(layers);
  std::size_t empty = 0;
  PreflightItem item{"empty-layers", Verdict::Passed, {}, 0.0, "layers", {}, {}};
  for (std::size_t i = filled.first; i < filled.behind; ++i) {
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
  const auto percent = [](double share) {
    return share < 0.0005 ? std::string{"less than 0.1 %"} : fmt::format("{:.1f} %", 100 * share);
  };
  if (completed > 0)
    item.text = fmt::format(
        "{} of the contours are completed where the scan shows nothing, up to {:.2f} mm from its samples, and may be "
        "wrong there by up to {:.2f} mm",
        percent(completed), all.largest_gap_mm, all.largest_error_mm);
  if (doubtful > 0)
    item.text += fmt::format("{}{} {} doubtful", completed > 0 ? "; " : "", percent(doubtful),
                             completed > 0 ? "are" : "of the contours are");
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
