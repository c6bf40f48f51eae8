// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/image/palette.hpp>
#include <telefab/scan/topology/height_topology.hpp>

namespace telefab::scan {

// One set of colours for the picture and the viewer's files.
using palette::kAscending, palette::kDescending, palette::kOuterArc, palette::kHoleArc, palette::kLink;
inline constexpr Colour kPlateau{90, 90, 90};

inline Colour colour_of(CriticalKind kind) {
  switch (kind) {
    case CriticalKind::Minimum:
      return palette::kMinimum;
    case CriticalKind::BottomSaddle:
      return palette::kBottomSaddle;
    case CriticalKind::TopSaddle:
      return palette::kTopSaddle;
    case CriticalKind::Maximum:
      return palette::kMaximum;
  }
  return {0, 0, 0};
}

}  // namespace telefab::scan
