// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "contour_texts.hpp"

namespace telefab::fab {

/// Common Layer Interface 2.00. A layer is named by its upper side; a first layer without contours gives the lower side
/// of the one above. Label 1 is the part, label 2 its supports.
class CliText final : public LayerText {
 public:
  CliText(const ContourJob& job, bool binary) : job_{job}, binary_{binary} {}
  void begin(std::string& out) override;
  void layer(std::string& out, std::uint32_t index) override;
  void end(std::string& out) override;

 private:
  void start_layer(std::string& out, double z_mm) const;
  const ContourJob& job_;
  bool binary_;
};

}  // namespace telefab::fab
