// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::bench {

/// A scan as the command reads it.
struct Input {
  std::string name;  ///< object/what was done to it
  std::filesystem::path file;
  std::size_t points = 0;
  bool has_normals = false;
};

/// What of a scan is tried.
struct InputOptions {
  std::size_t points = 250'000;  ///< drawn by area of what has faces, and of the synthetic objects
  std::vector<std::string> damages{"whole", "bare", "holes5"};  ///< bare: without normals; others as test::Damage
  std::uint64_t seed = 1;
};

/// Writes scans into `folder`: a torus and a bumpy ball 100 mm high, drawn at random, then each file; one with faces is
/// drawn by area, another is taken as it is, whole only. Fails as readers and writers of files do.
[[nodiscard]] Result<std::vector<Input>> make_inputs(const std::vector<std::string>& files, const InputOptions& options,
                                                     const std::filesystem::path& folder);

}  // namespace telefab::bench
