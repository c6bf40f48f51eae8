// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/test/solid.hpp>
#include <vector>

namespace telefab::campaign {

/// A scan whose object is known by a formula.
struct SyntheticScan {
  std::string kind;  ///< the row of the table
  std::string name;
  test::Solid solid;
  double spacing_mm = 0;
  std::function<test::SurfaceSamples()> samples;  ///< the same at every call
  bool bare = false;                              ///< handed over without normals
};

/// Every case, in a fixed order: balls with a stray point, touching balls, pins on scan lines, springs, walls, handles,
/// doubled sheets, mixed pixels, outliers, noise.
[[nodiscard]] std::vector<SyntheticScan> synthetic_scans();

struct SyntheticVerdict {
  int right_certified = 0, wrong_certified = 0, right_flagged = 0, wrong_flagged = 0;
  int critical = 0;  ///< of these: another count than the body's at the very height, but that beside it
  double seconds = 0;
  double worst_over_median = 0;    ///< evaluations of the dearest layer over those of a middle one; of sums the largest
  std::vector<std::string> lines;  ///< layers that are certified and wrong

  SyntheticVerdict& operator+=(const SyntheticVerdict& other);
};

/// Slices the scan as it is in layers of a fortieth of its body and counts every layer's rings against the body: equal
/// to its own at that height, or within a tenth of a kernel of it, or of the body grown or shrunk by as much.
/// Fails: what slicing fails with.
[[nodiscard]] Result<SyntheticVerdict> judge(const SyntheticScan& scan);

}  // namespace telefab::campaign
