// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/fab/web/page_backend.hpp>
#include <vector>

namespace telefab::fab {

/// Gauges of every job and every machine, and how many jobs are in each state, in the Prometheus text format 0.0.4.
[[nodiscard]] std::string metrics_text(const std::vector<JobView>& jobs, const std::vector<MachineStatus>& machines);

}  // namespace telefab::fab
