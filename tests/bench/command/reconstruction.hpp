// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <telefab/base/result.hpp>

namespace telefab::bench {

/// What a user would do instead: reads the scan, reconstructs a mesh by Poisson of this depth and cuts it at `layers`
/// heights into segments; prints how many. Fails as test::poisson_faces and readers do.
[[nodiscard]] Result<void> reconstruct_and_cut(const std::filesystem::path& scan, int depth, std::size_t layers);

}  // namespace telefab::bench
