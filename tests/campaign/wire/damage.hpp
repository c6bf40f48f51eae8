// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include "sites.hpp"

namespace telefab::test {

/// Sends the fab `wanted` damaged conversations made from two recorded jobs: flipped bits, cut frames, chunks swapped,
/// dropped, repeated, spliced from another job, ends that lie. Prints how each kind was refused; 5 where one was taken.
[[nodiscard]] int damage_campaign(Sites& sites, int wanted);

}  // namespace telefab::test
