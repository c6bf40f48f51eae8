// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/test/e57_file.hpp>

// The input is what lies on the pages: length and checksums are put right, so that damage gets past them.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  constexpr std::size_t kHeader = 48;
  if (size < kHeader) return 0;
  std::string logical{reinterpret_cast<const char*>(data), size};
  logical.replace(0, 12, std::string_view{"ASTM-E57\x01\0\0\0", 12});
  const std::string file = test::on_e57_pages(std::move(logical));
  const auto cloud = scan::read_cloud(std::as_bytes(std::span{file}), "a.e57", {.max_points = 1U << 20}, {});
  if (!cloud) {
    if (cloud.error().what.empty()) std::abort();
    return 0;
  }
  if (cloud->points.empty() || (cloud->has_normals() && cloud->normals.size() != cloud->size())) std::abort();
  for (const auto& p : cloud->points)
    if (!p.allFinite()) std::abort();
  return 0;
}
