// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <string>
#include <telefab/image/canvas.hpp>
#include <telefab/image/viewpoint.hpp>
#include <vector>

namespace telefab {

/// How a colour is shown in a legend, as it is in the picture.
enum class LegendMark : std::uint8_t { Area = 1, Line = 2, Disc = 3, Ring = 4 };

struct LegendEntry {
  Colour colour;
  std::string text;
  LegendMark mark = LegendMark::Area;
};

/// A direction of the thing shown, as it lies in the picture: to the right and up, at most 1 long.
struct PictureAxis {
  std::string name;
  double right = 0;
  double up = 0;
};
[[nodiscard]] std::vector<PictureAxis> axes_of(const Viewpoint& viewpoint);
/// Those of a layer seen from above.
[[nodiscard]] std::vector<PictureAxis> axes_of_plane();

/// What stands around a picture. What is empty or 0 is left out.
struct PictureCaption {
  std::string part;                 ///< name of scan or file
  std::string machine;              ///< name of its profile
  std::array<double, 3> size_mm{};  ///< of the part; as printed
  std::string detail;               ///< "layer 12, z = 1.80 mm", and other figures
  std::vector<LegendEntry> legend;
  double px_per_mm = 0;  ///< for a scale bar
  std::vector<PictureAxis> axes;
};

/// A stretch of colours in place of a legend: from -1 to 1, with the words at its ends.
struct DeviationScale {
  std::string least;
  std::string most;
};

/// The picture with its title above, and below it the legend, a scale bar and the axes. Long titles are cut off with an
/// ellipsis. The picture keeps its pixels; it is widened with paper where the legend needs more room.
[[nodiscard]] Image framed(const Image& picture, const PictureCaption& caption);
[[nodiscard]] Image framed(const Image& picture, const PictureCaption& caption, const DeviationScale& scale);

/// 1, 2 or 5 times a power of ten, as long as possible up to `most`, which is above 0.
[[nodiscard]] double round_length(double most);

}  // namespace telefab
