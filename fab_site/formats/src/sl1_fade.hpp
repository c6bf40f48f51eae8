// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>
#include <telefab/fab/formats/mask_export.hpp>
#include <telefab/fab/print/print_plan.hpp>

namespace telefab::fab {

inline constexpr std::uint32_t kLeastFade = 2;  ///< numFade that every program takes
inline constexpr std::uint32_t kMostFade = 200;

/// Exposure of a layer in seconds as a program reads an archive with first exposure F, normal exposure E and numFade n:
/// slafw since 2024 and PrusaSlicer since 2.6: F - i (F - E) / (n - 1), layer n - 1 is already E; Odyssey: E + (F - E)
/// (n - i) / n; slafw up to 2022: F for two layers more, then falling by (F - E) / n.
[[nodiscard]] double faded_exposure_s(FadeReader reader, double first_s, double normal_s, std::uint32_t fade,
                                      std::uint32_t layer);

/// The fade whose exposures, as `reader` makes them, come nearest to the plan's: least sum of squared logarithms of
/// their quotients, for depth of cure goes by the logarithm of the dose. The smallest one of equals.
[[nodiscard]] std::uint32_t fitted_fade(FadeReader reader, const PrintPlan& plan, double first_s, double normal_s);

/// The layers that differ by more than a thousandth, for each reader: planned against made.
[[nodiscard]] std::vector<FadedLayers> faded_layers(const PrintPlan& plan, double first_s, double normal_s,
                                                    std::uint32_t fade);

}  // namespace telefab::fab
