// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <charconv>
#include <cmath>
#include <string>
#include <telefab/fab/formats/contour_job.hpp>

namespace telefab::fab {

/// A text or file that grows layer by layer.
class LayerText {
 public:
  virtual ~LayerText() = default;
  LayerText(const LayerText&) = delete;
  LayerText& operator=(const LayerText&) = delete;
  virtual void begin(std::string& out) = 0;
  virtual void layer(std::string& out, std::uint32_t index) = 0;
  virtual void end(std::string& out) = 0;

 protected:
  LayerText() = default;
};

/// Decimal millimetres in steps of a nanometre, without trailing zeros. Finite numbers below 10^9.
inline void append_mm(std::string& out, double value) {
  char digits[40];
  const auto whole = std::llround(value * 1e6);
  if (whole < 0) out += '-';
  const auto size = whole < 0 ? -whole : whole;
  const auto* end = std::to_chars(digits, digits + sizeof digits, size / 1'000'000).ptr;
  out.append(digits, static_cast<std::size_t>(end - digits));
  auto rest = size % 1'000'000;
  if (rest == 0) return;
  char fraction[7] = {'.', 0, 0, 0, 0, 0, 0};
  for (int i = 6; i > 0; --i, rest /= 10) fraction[i] = static_cast<char>('0' + rest % 10);
  int count = 7;
  while (fraction[count - 1] == '0') --count;
  out.append(fraction, static_cast<std::size_t>(count));
}

/// Upper side of a layer.
[[nodiscard]] inline double top_mm(const ContourJob& job, std::uint32_t layer) {
  return (layer + 1) * job.thickness_mm;
}

}  // namespace telefab::fab
