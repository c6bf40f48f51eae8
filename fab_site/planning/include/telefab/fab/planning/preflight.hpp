// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/fab/planning/plan_job.hpp>

namespace telefab::fab {

/// One question asked of a job before it is printed.
struct PreflightItem {
  enum class Verdict : std::uint8_t {
    Passed = 1,
    Warning = 2,   ///< worth a look; does not hold the job
    Held = 3,      ///< the job waits until an operator approves it by name
    NotKnown = 4,  ///< the scan or the machine's profile does not say enough
  };
  std::string name;  ///< "size", "certificates", "islands", "hollows", "carry", "resin", "profile", "time", ...
  Verdict verdict = Verdict::Passed;
  std::string text;  ///< for people, with the figure and its unit
  std::optional<double> value;
  std::string unit;                 ///< of the value: "mm", "ml", "mm2", "s", "layers", ...
  std::optional<LayerIndex> layer;  ///< of the print
  std::optional<Point2> place;      ///< build frame
};
[[nodiscard]] std::string_view name_of(PreflightItem::Verdict verdict);

/// Everything an operator should know before the light goes on.
struct Preflight {
  std::vector<PreflightItem> items;
  [[nodiscard]] bool holds() const;
  /// Texts of what holds the job, joined; empty where nothing does.
  [[nodiscard]] std::string why_held() const;
};

/// {"verdict":"passed","items":[{"name":..,"verdict":..,"text":..,"value":..,"unit":..,"layer":..,"place":[x,y]}]}
[[nodiscard]] std::string to_json(const Preflight& preflight);
/// A line an item, for a terminal.
[[nodiscard]] std::string to_text(const Preflight& preflight);

/// As to_json wrote it. InvalidInput names the key.
[[nodiscard]] Result<Preflight> preflight_from_json(std::string_view text);
/// That of a plan folder. NotFound: planned by a version that kept none.
[[nodiscard]] Result<Preflight> preflight_in(const std::filesystem::path& folder);

/// The reason for which a held job is let through all the same, to be kept: "although islands: 1 found; ...". `names`,
/// separated by commas, must name every item that holds it. Empty: nothing holds it. NotPermitted says which items are
/// not named; InvalidInput: a name that is no item's.
[[nodiscard]] Result<std::string> let_through(const Preflight& preflight, std::string_view names);

/// Size, certificates, registration of the scan's views where it is stated, dose, walls and gaps too fine for the
/// pixels or too weak for a small error of the dose, islands and loose supports, hollows
/// that hold a vacuum or resin, whether the print carries the pull of the film, resin against the vat, what of the
/// profile is assumed, peel area against the machine's limit where it has one, time. Pure.
[[nodiscard]] Preflight preflight_of(const LayerStack& stack, const MachineProfile& machine,
                                     const PlanSummary& summary);

}  // namespace telefab::fab
