// SPDX-License-Identifier: GPL-3.0-or-later
#include "written_check.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace telefab::scan {
namespace {

constexpr double kLeastSpan = 0.5;  ///< of the height: less is another part than the one asked for
constexpr double kNarrower = 0.1;   ///< of the size: contours this much narrower than the scan are said

}  // namespace

void WrittenCheck::look_at(Layer& layer) {
  const std::uint32_t index = layer.index.count();
  if (layer.contours.empty()) {
    empty_.push_back(index);
    LayerCertificate& certificate = layer.certificate;
    const bool inside = layer.z_mm > spacing_mm_ && layer.z_mm < size_mm_.z() - spacing_mm_;
    if (inside && certificate.is_certified()) certificate.flag({.reason = DoubtReason::ContourMissing});
    return;
  }
  if (!first_) first_ = index;
  last_ = index;
  for (const Contour& ring : layer.contours) bounds_.include(ring.bounds());
}

Result<std::vector<std::string>> WrittenCheck::verdict(const StackHeader& header, bool whole) const {
  std::vector<std::string> sentences;
  if (!whole) return sentences;
  if (!first_)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("none of the {} layers has a contour: the points show no closed surface of {:.4g} x {:.4g} x "
                    "{:.4g} mm; look at the scan with inspect",
                    header.layer_count, size_mm_.x(), size_mm_.y(), size_mm_.z()));
  const double layer_mm = header.layer_thickness_mm;
  const double span_mm = layer_mm * (*last_ - *first_ + 1);
  if (span_mm < kLeastSpan * size_mm_.z() - 2 * layer_mm)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the contours span {:.4g} mm of the height of {:.4g} mm, from layer {} to {}: points far from "
                    "the object set its size; leave them out with --crop or --pieces largest",
                    span_mm, size_mm_.z(), *first_, *last_));
  const double below_mm = layer_mm * *first_, above_mm = layer_mm * (header.layer_count - 1 - *last_);
  const auto many = [&](double mm) { return mm > spacing_mm_ + layer_mm; };
  if (many(below_mm)) sentences.push_back(fmt::format("the lowest {} layers ({:.3g} mm) are empty", *first_, below_mm));
  if (many(above_mm))
    sentences.push_back(
        fmt::format("the highest {} layers ({:.3g} mm) are empty", header.layer_count - 1 - *last_, above_mm));
  std::uint32_t inner = 0;
  std::optional<std::uint32_t> lowest;
  for (const std::uint32_t i : empty_)
    if (i > *first_ && i < *last_) {
      ++inner;
      if (!lowest) lowest = i;
    }
  if (lowest)
    sentences.push_back(
        fmt::format("{} layers inside the part have no contour; the lowest is layer {}", inner, *lowest));
  const double width_mm = bounds_.width_mm(), depth_mm = bounds_.depth_mm();
  const auto narrower = [&](double is, double wanted) { return wanted - is > kNarrower * wanted + 2 * spacing_mm_; };
  if (narrower(width_mm, size_mm_.x()) || narrower(depth_mm, size_mm_.y()))
    sentences.push_back(
        fmt::format("the contours are {:.4g} x {:.4g} mm wide, the scan is {:.4g} x {:.4g} mm: part of it is "
                    "missing",
                    width_mm, depth_mm, size_mm_.x(), size_mm_.y()));
  return sentences;
}

}  // namespace telefab::scan
