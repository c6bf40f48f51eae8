// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab::fab {

/// How grey levels are found, and with it what their light is judged by.
enum class MaskMethod : std::uint8_t {
  Cover = 1,       ///< the share of each pixel that the region covers
  Blend = 2,       ///< greys solved so that each layer's own light cures to its contour
  BlendStack = 3,  ///< the same for the light of all layers together, from the top down
};
inline constexpr std::array kMaskMethods{MaskMethod::Cover, MaskMethod::Blend, MaskMethod::BlendStack};

[[nodiscard]] std::string_view name_of(MaskMethod method);
/// Fails with InvalidInput, naming those there are.
[[nodiscard]] Result<MaskMethod> mask_method_from_name(std::string_view name);

}  // namespace telefab::fab
