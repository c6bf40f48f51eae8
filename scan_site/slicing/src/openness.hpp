// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/scan/mls/mls_field.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

/// Adds up the area vectors of the samples, each standing for the square of its local spacing. At most some 100,000
/// evenly strided samples are asked. Deterministic.
[[nodiscard]] Openness openness_of(const MlsField& field);

/// One sentence for people on what the scan does not show, and what to do; none for a surface closed as far as its
/// samples can tell.
[[nodiscard]] std::optional<std::string> warning_of(const Openness& open);

}  // namespace telefab::scan
