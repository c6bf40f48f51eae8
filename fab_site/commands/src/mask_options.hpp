// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/command_line/options.hpp>
#include <telefab/fab/planning/plan_job.hpp>

namespace telefab::fab {

/// How masks are made, as `plan` and `serve` are told.
struct MaskOptions {
  std::string method = "blend-stack";
  std::string pattern = "solid";
  InnerPattern inside;
  double deadline_s = 0;
  int iterations = 20;
  double support_grey = 1;
  double cure_depth_layers = 0;
  bool plain_undersides = false;
};

/// Declares them in their group of a verb's options; `options` must outlive the parsing.
void declare_mask_options(VerbOptions& app, MaskOptions& options);

/// Into what the planner takes. Fails with InvalidInput.
[[nodiscard]] Result<void> apply(const MaskOptions& options, PlanOptions& plan);

}  // namespace telefab::fab
