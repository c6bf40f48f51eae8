// SPDX-License-Identifier: GPL-3.0-or-later
#include "inputs.hpp"

#include <fmt/format.h>

#include <telefab/base/file.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/test/damage.hpp>
#include <telefab/test/mesh_truth.hpp>

#include "clouds.hpp"

namespace telefab::bench {
namespace {

Result<void> add(std::vector<Input>& inputs, const std::filesystem::path& folder, const std::string& name,
                 const scan::PointCloud& cloud) {
  Input input{name, folder / fmt::format("{}.ply", inputs.size()), cloud.size(), cloud.has_normals()};
  if (auto ok = write_file_atomically(input.file, scan::write_ply(cloud, {}, "bench_command")); !ok) return ok;
  inputs.push_back(std::move(input));
  return {};
}

Result<void> add_damaged(std::vector<Input>& inputs, const std::filesystem::path& folder, const std::string& object,
                         const scan::PointCloud& whole, const InputOptions& options) {
  for (const std::string& name : options.damages) {
    const bool bare = name == "bare";
    const auto damage = test::Damage::named(bare ? "whole" : name, options.seed);
    if (!damage) return tl::unexpected{damage.error()};
    scan::PointCloud cloud = test::damaged(whole, *damage);
    if (bare) cloud.normals.clear();
    if (auto ok = add(inputs, folder, fmt::format("{}/{}", object, name), cloud); !ok) return ok;
  }
  return {};
}

}  // namespace

Result<std::vector<Input>> make_inputs(const std::vector<std::string>& files, const InputOptions& options,
                                       const std::filesystem::path& folder) {
  std::vector<Input> inputs;
  for (const auto& [name, kind] : {std::pair{"torus", CloudKind::Torus}, std::pair{"bumpy", CloudKind::Bumpy}})
    if (auto ok = add_damaged(inputs, folder, name, make_cloud(kind, options.points), options); !ok)
      return tl::unexpected{ok.error()};
  for (const std::string& file : files) {
    const std::filesystem::path path{file};
    auto scanned = test::read_faces(path);
    if (!scanned) return tl::unexpected{scanned.error()};
    const std::string object = path.stem().string();
    auto ok = scanned->faces.empty()
                  ? add(inputs, folder, object + "/whole", scanned->cloud)
                  : add_damaged(inputs, folder, object,
                                test::mesh_of(*scanned).sampled(options.points, 0, 0, options.seed), options);
    if (!ok) return tl::unexpected{ok.error()};
  }
  return inputs;
}

}  // namespace telefab::bench
