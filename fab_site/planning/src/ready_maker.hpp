// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "mask_maker.hpp"

namespace telefab::fab {

/// The mask of a layer. Fails as the masks do, and with InvalidInput where it has another size than `size`. Threads:
/// one at a time for a print.
[[nodiscard]] Result<Mask> ready_mask(const ReadyPrint& print, LayerIndex layer, PixelSize size);

/// The masks of a print that another program made, as they are; solid from kReadySolid on. `print` outlives it.
[[nodiscard]] std::unique_ptr<MaskMaker> ready_mask_maker(const ReadyPrint& print, PixelSize size);

}  // namespace telefab::fab
