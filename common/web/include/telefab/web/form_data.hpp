// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab {

/// One field of a form, RFC 7578. The views point into the body.
struct FormField {
  std::string name;
  std::string file_name;  ///< empty: a plain value
  std::string_view content;
};

/// The fields of a multipart/form-data body. InvalidInput: another content type, no boundary, a body that does not
/// follow it, more than 32 fields.
[[nodiscard]] Result<std::vector<FormField>> form_fields(std::string_view content_type, std::string_view body);

}  // namespace telefab
