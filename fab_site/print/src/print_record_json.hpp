// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <nlohmann/json.hpp>
#include <telefab/fab/print/print_record.hpp>

namespace telefab::fab {

/// One layer as the record and the journal write it.
[[nodiscard]] nlohmann::ordered_json layer_to_json(const LayerRecord& layer);
/// Throws nlohmann::ordered_json::exception; callers catch it.
[[nodiscard]] LayerRecord layer_from_json(const nlohmann::ordered_json& j);

}  // namespace telefab::fab
