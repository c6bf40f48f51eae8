// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>

namespace telefab {

/// A description in OpenAPI as a page in Markdown: every operation with what it takes and answers, then what its bodies
/// hold. Same text, same page. Fails: InvalidInput (not such a description).
[[nodiscard]] Result<std::string> api_page(std::string_view openapi_json);

}  // namespace telefab
