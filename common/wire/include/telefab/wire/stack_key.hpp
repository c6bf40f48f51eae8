// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <telefab/base/digest.hpp>
#include <telefab/wire/message.hpp>

namespace telefab {

/// What a stack is cut of and how: its scan, profile, parameters, header and coding. The same key, the same layers.
/// Nothing: the offer does not name its scan.
[[nodiscard]] std::optional<Digest> stack_key_of(const Offer& offer);

}  // namespace telefab
