// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <telefab/fab/support/support_plan.hpp>

namespace telefab::fab {

// What an operator wants of a job's supports, in its folder: supports-by-hand.json is what the plan beside it was made
// with, supports-wanted.json what it is being planned again with.

/// The list for the next plan: the wanted one, else that of the last plan, else an empty one. Fails: InvalidInput (a
/// file was changed by hand and is no list any more; names it), StorageFailed, NotPermitted.
[[nodiscard]] Result<HandList> hand_list_in(const std::filesystem::path& folder);
/// Durable when it returns. Fails as write_file_atomically.
[[nodiscard]] Result<void> want_hand_list(const std::filesystem::path& folder, const HandList& list);
/// Whether a plan with another list is asked for and not made yet.
[[nodiscard]] bool wants_hand_list(const std::filesystem::path& folder);
/// The plan with the wanted list is there. Nothing to do where none is wanted. Fails as put_in_place.
[[nodiscard]] Result<void> keep_wanted_hand_list(const std::filesystem::path& folder);
/// No such plan can be made: the list of the plan that is there holds again. Fails: StorageFailed, NotPermitted.
[[nodiscard]] Result<void> drop_wanted_hand_list(const std::filesystem::path& folder);

/// Of a planned job, for the page: {"elevation_layers":n,"thickness_mm":t,"anchors":[{"x_mm":x,"y_mm":y,
/// "part_layer":k,"z_mm":z,"tip":"light","on_part":false,"by_hand":false}],"hand":LIST}; build frame, z_mm above the
/// part's first layer as in hand lists. Fails: NotFound (not planned yet), InvalidInput, and as hand_list_in.
[[nodiscard]] Result<std::string> supports_json(const std::filesystem::path& folder);

}  // namespace telefab::fab
