// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <telefab/scan/digitize/digitize.hpp>
#include <telefab/scan/registration/join_views.hpp>
#include <vector>

namespace telefab::campaign {

/// Range images of one turn, and where each of them stands.
struct Turn {
  std::vector<scan::RangeImage> images;
  std::vector<scan::RigidMotion> to_model;
};

struct TurnOptions {
  double step_deg = 60;
  double noise_mm = 0.05;
  std::uint64_t seed = 1;
  std::function<bool(const scan::Vec3&)> keep;  ///< in the model's frame; empty: everything is seen
};

/// A mesh file, or one of digitize's shapes by name, 80 mm along its longest side about the origin.
[[nodiscard]] scan::DigitizeModel load_model(const std::string& path);
[[nodiscard]] scan::DigitizeModel mirrored(scan::DigitizeModel model);
/// Six views as of `digitize`, pitch 0.5 mm, of the model moved by `motion`.
[[nodiscard]] Turn take_turn(scan::DigitizeModel model, const scan::RigidMotion& motion, const TurnOptions& options);
/// 90 to 180 degrees about an axis across z.
[[nodiscard]] scan::RigidMotion turned_over(std::mt19937_64& random);

}  // namespace telefab::campaign
