// SPDX-License-Identifier: GPL-3.0-or-later
// Takes the normals off clouds, finds them again, and counts those on the right side: against the faces of a closed
// mesh, or the normals that the file gives. campaign_normals FILE... Run by hand; figures in decision 0307.
#include <fmt/format.h>

#include <chrono>
#include <filesystem>
#include <telefab/base/file.hpp>
#include <telefab/scan/formats/read_cloud.hpp>
#include <telefab/scan/slicing/orient_cloud.hpp>

#include <telefab/test/mesh_truth.hpp>

namespace telefab::campaign {
namespace {

/// The cloud with the normals that are right.
Result<scan::PointCloud> truth_of(const std::filesystem::path& path) {
  auto file = test::read_faces(path);
  if (!file) return tl::unexpected{file.error()};
  if (file->faces.empty()) return std::move(file->cloud);
  return test::mesh_of(*file).as_scanned();
}

Result<void> row(const std::filesystem::path& path) {
  auto truth = truth_of(path);
  if (!truth) return tl::unexpected{truth.error()};
  if (!truth->has_normals())
    return fail(ErrorCode::InvalidInput, "the file has no faces and no normals to compare with");
  scan::PointCloud bare = *truth;
  bare.normals.clear();
  const auto began = std::chrono::steady_clock::now();
  const auto found = scan::orient_cloud(std::move(bare), {});
  if (!found) return tl::unexpected{found.error()};
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  std::size_t right = 0, edge_on = 0, near = 0;
  for (std::size_t i = 0; i < truth->size(); ++i) {
    const float along = found->cloud.normals[i].dot(truth->normals[i]);
    right += along > 0 ? 1 : 0;
    edge_on += along <= 0 && along > -0.5F ? 1 : 0;
    near += along > 0.9F ? 1 : 0;
  }
  const auto share = [&](std::size_t count) {
    return 100 * static_cast<double>(count) / static_cast<double>(truth->size());
  };
  fmt::print("{:24} {:7} {:7.2f} {:7.2f} {:7.2f} {:9.2f} {:>10} {:7.2f}\n", path.stem().string(), truth->size(),
             share(right), share(edge_on), share(near), 100 * found->report.winding_agreement,
             found->report.by_winding ? "winding" : "neighbours", seconds);
  std::fflush(stdout);
  return {};
}

int run(std::span<char*> names) {
  fmt::print("{:24} {:>7} {:>7} {:>7} {:>7} {:>9} {:>10} {:>7}\n", "file", "points", "right%", "edge-on", ">.9",
             "agree%", "by", "s");
  int failed = 0;
  for (const char* name : names)
    if (auto done = row(name); !done) {
      fmt::print("{}: {}\n", name, done.error().what);
      failed = 1;
    }
  return failed;
}

}  // namespace
}  // namespace telefab::campaign

int main(int argc, char** argv) { return telefab::campaign::run({argv + 1, static_cast<std::size_t>(argc - 1)}); }
