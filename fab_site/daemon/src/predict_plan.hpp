#pragma once
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/fab/cure/prediction.hpp>
#include <telefab/machine/machine_profile.hpp>

namespace telefab::fab {

/// What a plan will cure.
struct PlanPrediction {
  Prediction prediction;
  CureModel model;
  std::uint32_t lift_layers = 0;
  bool is_compared = false;  ///< with contours
  double leaked = 0;         ///< dose that black pixels build up in a tall print; all resin sets at 1
};

/// Cures the masks of a plan folder by the machine's optics and resin and compares with the contours in `contours` (a
/// .tfc file), or with those the planner kept where that is empty. Fails as predict_print does, and for a folder that
/// is no plan.
[[nodiscard]] Result<PlanPrediction> predict_plan(const std::filesystem::path& folder, const MachineProfile& machine,
                                                  const std::string& contours, const PredictOptions& options,
                                                  const ProgressSink& progress, std::stop_token stop);

/// The same of a planned job, into folder/report: accuracy.png (the predicted part and its edges) and accuracy.json. At
/// low priority and on the calling thread alone, so that a print beside it has the machine. Fails likewise, and with
/// StorageFailed.
[[nodiscard]] Result<void> keep_prediction(const std::filesystem::path& folder, const MachineProfile& machine,
                                           std::stop_token stop);

}  // namespace telefab::fab
