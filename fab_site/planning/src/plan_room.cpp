// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <telefab/fab/planning/plan_room.hpp>

namespace telefab::fab {
namespace {

constexpr double kElevation_mm = 10;          // supports below the part: print layers beside its own
constexpr double kFileBlock_bytes = 4096;     // what a mask's last block wastes
constexpr double kLayer_bytes = 8192;         // rows of the plan, rings of the supports
constexpr double kContourPixel_bytes = 8;     // of a mask, for every pixel that a contour runs through
constexpr double kKeptPart_bytes = 8;         // of part.tfc, coded exactly, for every byte of the chunks
constexpr double kWhole_bytes = 4U << 20U;    // pictures and reports
constexpr double kOfferedLayer_bytes = 1024;  // of chunks, for every layer of an offer

std::uint64_t room_bytes(const StackHeader& header, double contours_px, double contour_bytes) {
  const double layers = header.layer_count + std::ceil(kElevation_mm / header.layer_thickness_mm);
  return static_cast<std::uint64_t>(layers * (kFileBlock_bytes + kLayer_bytes) + contours_px * kContourPixel_bytes +
                                    contour_bytes * kKeptPart_bytes + kWhole_bytes);
}

}  // namespace

std::uint64_t offer_room_bytes(const StackHeader& header) {
  const Bounds2& box = header.bounds;
  const double outline_mm = 2 * (box.max.x_mm - box.min.x_mm + box.max.y_mm - box.min.y_mm);
  const double layers = header.layer_count;
  const double chunks_bytes = layers * kOfferedLayer_bytes;
  return static_cast<std::uint64_t>(chunks_bytes) +
         room_bytes(header, layers * 2 * outline_mm / header.pixel_pitch_mm, chunks_bytes);
}

std::uint64_t plan_room_bytes(const LayerStack& stack, std::uint64_t contour_bytes) {
  double length_mm = 0;
  for (const Layer& layer : stack.layers())
    for (const Contour& contour : layer.contours) length_mm += contour.length_mm();
  return room_bytes(stack.header(), length_mm / stack.header().pixel_pitch_mm, static_cast<double>(contour_bytes));
}

}  // namespace telefab::fab
