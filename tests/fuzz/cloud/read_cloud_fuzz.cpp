// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/scan/formats/read_cloud.hpp>

#include <array>
#include <cstdint>
#include <cstdlib>

// The first byte chooses the suffix, so that every reader is reached whatever the content looks like.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab::scan;
  static constexpr std::array kNames{"a",     "a.ply", "a.pcd", "a.xyz", "a.off",
                                     "a.stl", "a.obj", "a.ptx", "a.e57", "a.las"};
  if (size == 0) return 0;
  const auto bytes = std::as_bytes(std::span{data, size});
  for (const auto content : {bytes, bytes.subspan(1)}) {
    const auto cloud = read_cloud(content, kNames[data[0] % kNames.size()], {.max_points = 1U << 20}, {});
    if (!cloud) {
      if (cloud.error().what.empty()) std::abort();
      continue;
    }
    if (cloud->points.empty() || (cloud->has_normals() && cloud->normals.size() != cloud->size())) std::abort();
    for (const auto& p : cloud->points)
      if (!p.allFinite()) std::abort();
    for (const auto& n : cloud->normals)
      if (!(std::abs(n.norm() - 1) < 1e-3F)) std::abort();
  }
  return 0;
}
