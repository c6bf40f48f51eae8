// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "mask_maker.hpp"

namespace telefab::fab {

/// The masks of a print that another program made, as they are; solid from kReadySolid on. `print` outlives it.
[[nodiscard]] std::unique_ptr<MaskMaker> ready_mask_maker(const ReadyPrint& print, PixelSize size);

}  // namespace telefab::fab
