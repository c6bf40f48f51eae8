// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstddef>
#include <span>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <telefab/scan/registration/align.hpp>
#include <telefab/scan/registration/range_image.hpp>
#include <vector>

namespace telefab::scan {

/// Two views that show one surface twice: their points lie on two sheets where they ought to lie on one.
struct DoubledPair {
  std::size_t first = 0, second = 0;  ///< indices of the views
  double apart = 0;                   ///< median distance of the sheets, unit of the files
  double share = 0;                   ///< (0, 1]; of the places that both views show
  Vec3 place = Vec3::Zero();          ///< where the sheets are farthest apart; world frame
};

struct DoubledSheets {
  std::vector<DoubledPair> pairs;         ///< the farthest apart first
  std::vector<std::vector<float>> apart;  ///< one list a view, one value a point: how far apart its sheets are; 0: one
  std::vector<std::array<std::size_t, 2>> shared;  ///< pairs of views that show the same places, doubled or not
  [[nodiscard]] bool empty() const { return pairs.empty(); }
};

/// Looks where two views show the same place: a plane is fitted to each one's points within 2.5 spacings, and their
/// distance along the normal, the median over the places around, is held against what the points scatter about their
/// own plane. Sheets are doubled where it is larger than that and a quarter of the spacing. Sheets farther apart than
/// five spacings are not looked for: those conflict with free space. Frame of the result: that of the poses.
/// Deterministic. Fails: InvalidInput (not one pose a view), Cancelled.
[[nodiscard]] Result<DoubledSheets> find_doubled_sheets(std::span<const RangeImage> views,
                                                        std::span<const RigidMotion> poses, std::stop_token stop);

/// The same, and where sheets are doubled all poses are adjusted once more, with points matched as far apart as the
/// sheets are; `poses` become those that leave less doubled. The first pose stays. Fails: as find_doubled_sheets.
[[nodiscard]] Result<DoubledSheets> reconcile_doubled_sheets(std::span<const RangeImage> views,
                                                             std::vector<RigidMotion>& poses, std::stop_token stop);

/// "view_3 and view_7 show two sheets 0.51 apart on 64 % of what both see"
[[nodiscard]] std::string sentence_of(const DoubledPair& pair, std::span<const RangeImage> views);

}  // namespace telefab::scan
