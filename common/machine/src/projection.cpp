// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <telefab/machine/machine_profile.hpp>

namespace telefab {

std::array<double, 256> tone_of(const MachineProfile::Projection& projection) {
  std::array<double, 256> tone{};
  for (std::size_t grey = 0; grey < tone.size(); ++grey) {
    const double share = static_cast<double>(grey) / 255;
    double h = std::pow(share, projection.gamma);
    if (const auto& curve = projection.curve; !curve.empty()) {
      const double at = share * static_cast<double>(curve.size() - 1);
      const std::size_t left = std::min(static_cast<std::size_t>(at), curve.size() - 2);
      h = std::lerp(curve[left], curve[left + 1], at - static_cast<double>(left));
    }
    tone[grey] = projection.leak + (1 - projection.leak) * h;
  }
  return tone;
}

double field_at(const MachineProfile::Projection& projection, double across, double down) {
  const auto& field = projection.field;
  if (field.empty()) return 1;
  struct Place {
    std::size_t from, to;
    double share;
  };
  const auto place = [](double along, std::size_t cells) -> Place {
    const double most = static_cast<double>(cells - 1);
    const double at = std::clamp(along * static_cast<double>(cells) - 0.5, 0.0, most);
    const auto from = static_cast<std::size_t>(at);
    return {from, std::min(from + 1, cells - 1), at - static_cast<double>(from)};
  };
  const Place row = place(down, field.size());
  const Place column = place(across, field.front().size());
  const auto along = [&](std::size_t r) { return std::lerp(field[r][column.from], field[r][column.to], column.share); };
  return std::lerp(along(row.from), along(row.to), row.share);
}

}  // namespace telefab
