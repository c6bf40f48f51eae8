#pragma once
#include <optional>
#include <string_view>

namespace telefab::fab {

struct Asset {
  std::string_view content_type;
  std::string_view body;
};

/// The page's files, compiled in (page/*), so that an installed daemon serves them from anywhere. "/" is the page.
[[nodiscard]] std::optional<Asset> find_asset(std::string_view path);

}  // namespace telefab::fab
