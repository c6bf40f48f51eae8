// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <chrono>
#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/machine/profile_part.hpp>
#include <telefab/scan/placing/standing.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/scan/staging/staged_scan.hpp>
#include <vector>

namespace telefab::scan {

/// As preflight at the fab has it.
enum class Verdict : std::uint8_t { Pass = 1, Warning = 2, Held = 3, NotKnown = 4 };
/// "pass", "warning", "held", "not-known".
[[nodiscard]] std::string_view name_of(Verdict verdict);

/// One thing that preflight will ask, as far as the scan site can say before anything is cut.
struct ForeseenItem {
  std::string name;
  Verdict verdict = Verdict::NotKnown;
  std::string text;  ///< for people
};

/// What a print would take, estimated from a grid of the part.
struct PrintEstimate {
  StandingFigures figures;
  double layer_mm = 0;
  double resin_ml = 0;  ///< part and supports, cured
  std::chrono::duration<double> print_time{};
  std::optional<ResinPrice> price;  ///< of the resin, where its profile states one; set by whoever knows the profile
  std::vector<ForeseenItem> items;
};

/// Estimates a scan as the request places it. Fails: InvalidInput (larger than the machine; a size that is hardly meant
/// where nobody states a unit, as slicing refuses it), Cancelled.
[[nodiscard]] Result<PrintEstimate> estimate_print(const StagedScan& scan, const SliceRequest& request,
                                                   std::stop_token stop);

/// One JSON object, fixed key order.
[[nodiscard]] std::string to_json(const PrintEstimate& estimate);

}  // namespace telefab::scan
