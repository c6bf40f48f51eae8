// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <string>
#include <telefab/scan/slicing/slice_scan.hpp>

namespace telefab::scan {

/// The share of missing surface up to which gaps are closed without a word, and the one from which on what is missing
/// can only be guessed: measured on closed clouds (below .02), with holes of 5 % (.03), without their lowest tenth
/// (.04), a hand open at the wrist (.06), a leg open at both ends (.2), one side of a carton (.56).
inline constexpr double kSilentShare = 0.1;
inline constexpr double kMostOpenShare = 0.3;

/// One sentence for people on the side the scan does not show; none below the silent share.
[[nodiscard]] std::optional<std::string> warning_of(const Openness& open);
/// Why a scan this open is not sliced, and what to do; none where it is.
[[nodiscard]] std::optional<std::string> refusal_of(const Openness& open);

/// What is missing beside what the request says will be. `open`: build frame.
[[nodiscard]] Openness unasked(Openness open, const SliceRequest& request);
/// Whether so little is missing that closing it is right; build frame. Fails: InvalidInput, says what to do.
[[nodiscard]] Result<void> check_openness(const Openness& open, const SliceRequest& request);

}  // namespace telefab::scan
