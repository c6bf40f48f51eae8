// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/image/canvas.hpp>
#include <telefab/scan/topology/height_topology.hpp>

namespace telefab::scan {

// One set of colours for the picture and the viewer's files.
inline constexpr Colour kAscending{214, 96, 77};
inline constexpr Colour kDescending{67, 120, 190};
inline constexpr Colour kOuterArc{30, 100, 60};
inline constexpr Colour kHoleArc{160, 60, 160};
inline constexpr Colour kLink{150, 170, 160};
inline constexpr Colour kPlateau{90, 90, 90};

inline Colour colour_of(CriticalKind kind) {
  switch (kind) {
    case CriticalKind::Minimum:
      return {30, 80, 200};
    case CriticalKind::BottomSaddle:
      return {40, 160, 60};
    case CriticalKind::TopSaddle:
      return {235, 150, 20};
    case CriticalKind::Maximum:
      return {210, 30, 40};
  }
  return {0, 0, 0};
}

}  // namespace telefab::scan
