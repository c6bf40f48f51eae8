// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string_view>

namespace telefab::test {

/// The first tables of the profile of a small machine named "toy": 20 x 20 mm at 0.1 mm, layers of 0.2 mm. More tables
/// may follow.
inline constexpr std::string_view kToyProfile = R"(name = "toy"
description = "A small machine for tests"
[platform]
width_mm = 20.0
depth_mm = 20.0
z_travel_mm = 30.0
[projection]
pixel_pitch_mm = 0.1
irradiance_mw_per_cm2 = 3.0
[layers]
thickness_mm = 0.2
exposure_s = 4.0
bottom_count = 2
bottom_exposure_s = 8.0
)";

/// Writes a torus with normals, 7 mm from its axis to its rim and 4 mm high: `around` samples along its ring, `across`
/// along its tube.
void write_torus(const std::filesystem::path& file, int around, int across);

}  // namespace telefab::test
