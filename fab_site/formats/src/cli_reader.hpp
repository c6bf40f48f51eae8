// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string_view>

#include "raw_layers.hpp"

namespace telefab::fab {

/// Common Layer Interface 2.00, text or binary. `unit_mm` stands in for $$UNITS.
/// Fails: InvalidInput with the byte, the layer and what to do; TooLarge.
[[nodiscard]] Result<RawLayers> read_cli(std::string_view text, std::optional<double> unit_mm);

}  // namespace telefab::fab
