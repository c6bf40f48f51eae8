// SPDX-License-Identifier: GPL-3.0-or-later
// Writes a cloud of any size, sample by sample: what bench_command and people slice to see how time and memory grow.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <array>
#include <bit>
#include <cstdio>

#include "clouds.hpp"

namespace telefab::bench {
namespace {

static_assert(std::endian::native == std::endian::little, "a PLY file says so in its first lines");

struct Setup {
  std::string shape = "torus", file;
  std::size_t points = 1'000'000;
  bool bare = false;
};

int write(const Setup& setup) {
  const CloudKind kind = setup.shape == "torus" ? CloudKind::Torus : CloudKind::Bumpy;
  std::size_t count = 0;
  if (kind == CloudKind::Torus)
    for_each_sample(kind, setup.points, [&](const auto&, const auto&) { ++count; });
  else
    count = setup.points;
  std::FILE* const file = std::fopen(setup.file.c_str(), "wb");
  if (!file) {
    fmt::print(stderr, "cannot write {}\n", setup.file);
    return 1;
  }
  fmt::print(file,
             "ply\nformat binary_little_endian 1.0\ncomment {} {}\nelement vertex {}\nproperty float x\nproperty float "
             "y\nproperty float z\n{}end_header\n",
             setup.shape, setup.points, count,
             setup.bare ? "" : "property float nx\nproperty float ny\nproperty float nz\n");
  for_each_sample(kind, setup.points, [&](const scan::Vec3& p, const scan::Vec3& n) {
    const std::array<float, 6> row{static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()),
                                   static_cast<float>(n.x()), static_cast<float>(n.y()), static_cast<float>(n.z())};
    (void)std::fwrite(row.data(), sizeof(float), setup.bare ? 3 : 6, file);
  });
  const bool failed = std::ferror(file) != 0;
  if (std::fclose(file) == 0 && !failed) return 0;
  fmt::print(stderr, "{} cannot be written whole: is the disk full?\n", setup.file);
  return 1;
}

}  // namespace
}  // namespace telefab::bench

int main(int argc, char** argv) {
  telefab::bench::Setup setup;
  CLI::App app{"A cloud of an upright torus or a bumpy ball, 100 mm high, as a binary PLY file."};
  app.add_option("FILE", setup.file, "where to")->required();
  app.add_option("--shape", setup.shape, "what of")->check(CLI::IsMember({"torus", "bumpy"}))->capture_default_str();
  app.add_option("--points", setup.points, "about how many")->capture_default_str();
  app.add_flag("--bare", setup.bare, "without normals");
  CLI11_PARSE(app, argc, argv);
  return telefab::bench::write(setup);
}
