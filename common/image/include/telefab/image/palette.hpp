// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/image/canvas.hpp>

/// The colours of all pictures, by what they mean. Those that stand side by side in a picture are told apart with any
/// of the three kinds of colour-blindness too; a test computes it.
namespace telefab::palette {

inline constexpr Colour kPaper{255, 255, 255};
inline constexpr Colour kInk{40, 44, 52};
inline constexpr Colour kPaleInk{120, 124, 132};
inline constexpr Colour kRule{214, 216, 220};

// What a contour rests on.
inline constexpr Colour kMeasured{150, 154, 160};
inline constexpr Colour kCompleted{86, 180, 233};
inline constexpr Colour kDoubtful{200, 40, 20};

// What holds a layer.
inline constexpr Colour kAttached{196, 200, 206};
inline constexpr Colour kSelfSupported{86, 180, 233};
inline constexpr Colour kToSupport{213, 94, 0};
inline constexpr Colour kAnchor{20, 30, 50};

// A part on its supports.
inline constexpr Colour kPart{205, 210, 218};
inline constexpr Colour kSupport{230, 130, 20};

// Kinds of critical points, lines between them, arcs of the Reeb graph.
inline constexpr Colour kMinimum{0, 80, 170};
inline constexpr Colour kBottomSaddle{86, 200, 190};
inline constexpr Colour kTopSaddle{240, 180, 30};
inline constexpr Colour kMaximum{190, 30, 30};
inline constexpr Colour kAscending{213, 94, 0};
inline constexpr Colour kDescending{0, 114, 178};
inline constexpr Colour kOuterArc{0, 95, 75};
inline constexpr Colour kHoleArc{170, 60, 150};
inline constexpr Colour kLink{205, 210, 206};

// What became of the points of a cloud.
inline constexpr Colour kKept{200, 200, 205};
inline constexpr Colour kDuplicate{0, 114, 178};
inline constexpr Colour kOutlier{190, 30, 30};
inline constexpr Colour kSmallCluster{240, 180, 30};

// How far something is off: too little, right, too much; mixed in between.
inline constexpr Colour kMissing{33, 102, 172};
inline constexpr Colour kFits{190, 190, 186};
inline constexpr Colour kBeyond{213, 94, 0};

/// `share` of the way from a to b, 0 to 1.
[[nodiscard]] Colour mixed(Colour a, Colour b, double share);
/// kMissing at -1, kFits at 0, kBeyond at 1.
[[nodiscard]] Colour deviation_colour(double share);

}  // namespace telefab::palette
