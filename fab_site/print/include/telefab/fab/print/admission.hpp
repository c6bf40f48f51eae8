// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <stop_token>
#include <string>
#include <telefab/base/progress.hpp>
#include <telefab/fab/print/print_runner.hpp>
#include <vector>

namespace telefab::fab {

/// What a job costs on given devices, known before it starts: each mask is coded as it would be uploaded.
struct Admission {
  Nanoseconds planned{};             ///< motion, settling and exposure alone
  Nanoseconds expected{};            ///< with the uploads that do not fit into the motion
  std::vector<LayerIndex> too_slow;  ///< layers that wait for their upload
  Nanoseconds longest_upload{};
  LayerIndex longest_upload_layer;
  LayerIndex too_short;  ///< first layer below the projector's shortest exposure; see has_too_short
  bool has_too_short = false;
  [[nodiscard]] double slowdown() const {
    return planned > Nanoseconds{} ? double(expected.count()) / double(planned.count()) : 1;
  }
};

/// Estimates a print from layer `from`. Cost: one coding a mask. Fails as the mask source does, and with Cancelled.
[[nodiscard]] Result<Admission> estimate_print(const PrintPlan& plan, LayerIndex from, MaskSource& masks,
                                               const Projector& projector, const ZStage& stage,
                                               const ProgressSink& progress, std::stop_token stop);

/// Refuses (TooLarge, with the figures) a job that would take more than `allowed_slowdown` (>= 1) of its planned time,
/// and (InvalidInput) one with an exposure the projector cannot make. Nothing is ever degraded to make it fit: a slower
/// print is a stated choice.
[[nodiscard]] Result<void> admit(const Admission& admission, double allowed_slowdown);

[[nodiscard]] std::string to_json(const Admission& admission);

}  // namespace telefab::fab
