// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "contour_texts.hpp"

namespace telefab::fab {

/// One group a layer, as Slic3r writes them: id "layerN", slic3r:z its upper side. A viewer shows the platform from
/// above: x to the right, y turned around (SVG counts down).
class SvgText final : public LayerText {
 public:
  explicit SvgText(const ContourJob& job) : job_{job} {}
  void begin(std::string& out) override;
  void layer(std::string& out, std::uint32_t index) override;
  void end(std::string& out) override;

 private:
  const ContourJob& job_;
};

}  // namespace telefab::fab
