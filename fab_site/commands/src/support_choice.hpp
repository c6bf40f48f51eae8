// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <telefab/command_line/options.hpp>
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

/// What `plan` and `supports` both ask of the supports.
struct SupportChoice {
  std::string supports = "auto";
  std::string stand = "auto";
  std::string hand_list;
};

/// Declares --stand and --hand-list; `choice` must outlive the parsing.
void declare_support_choice(VerbOptions& app, SupportChoice& choice);

/// Into what the planner takes; reads the hand list. Fails as read_file and hand_list_from_json do.
[[nodiscard]] Result<void> apply(const SupportChoice& choice, SupportOptions& options);

}  // namespace telefab::fab
