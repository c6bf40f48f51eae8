// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <span>
#include <string_view>
#include <telefab/job/slice_parameters.hpp>

namespace CLI {
class App;
}

namespace telefab {

/// An option for every row of slice_parameter_table(), or for those of some keys. `into` must outlive the parsing.
void declare_slice_parameters(CLI::App& options, SliceParameters& into, std::span<const std::string_view> keys = {});

}  // namespace telefab
