// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/fab/mask/mask_method.hpp>

namespace telefab::fab {

std::string_view name_of(MaskMethod method) {
  switch (method) {
    case MaskMethod::Cover:
      return "cover";
    case MaskMethod::Blend:
      return "blend";
    case MaskMethod::BlendStack:
      return "blend-stack";
  }
  return "cover";
}

Result<MaskMethod> mask_method_from_name(std::string_view name) {
  for (const MaskMethod method : kMaskMethods)
    if (name == name_of(method)) return method;
  return fail(ErrorCode::InvalidInput,
              fmt::format("{} is not a way to make masks; there are: cover, blend, blend-stack", name));
}

}  // namespace telefab::fab
