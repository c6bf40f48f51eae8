// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/scan/completion/complete_cloud.hpp>

namespace telefab::scan {

/// What makes a body of a sheet or relief that was scanned from one side: samples `thickness` behind every sample of
/// the front (> 0; against its normal), and rows of them from its rims to theirs. Their gap is 0: they lie where they
/// were asked for. Where the front is bent more sharply than the sheet is thick, backs of other samples lie nearer;
/// those are left out. Frame and unit as the cloud's; `noise` as in CompletionOptions. Fails: InvalidInput (no
/// normals), Cancelled.
[[nodiscard]] Result<std::vector<VirtualSample>> other_side_of_sheet(const PointCloud& front, double thickness,
                                                                     double noise, std::stop_token stop);

}  // namespace telefab::scan
