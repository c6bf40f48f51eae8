// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <telefab/test/toy.hpp>

namespace telefab::test {

void write_torus(const std::filesystem::path& file, int around, int across) {
  std::ofstream cloud{file};
  for (int i = 0; i < around; ++i)
    for (int k = 0; k < across; ++k) {
      const double u = 2 * std::numbers::pi * i / around;
      const double v = 2 * std::numbers::pi * k / across;
      const double nx = std::cos(v) * std::cos(u);
      const double ny = std::cos(v) * std::sin(u);
      const double nz = std::sin(v);
      cloud << fmt::format("{:.6f} {:.6f} {:.6f} {:.6f} {:.6f} {:.6f}\n", 5 * std::cos(u) + 2 * nx,
                           5 * std::sin(u) + 2 * ny, 2 * nz, nx, ny, nz);
    }
}

}  // namespace telefab::test
