// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <optional>
#include <span>
#include <string_view>
#include <telefab/base/result.hpp>
#include <vector>

namespace telefab::fab {

struct XmlAttribute {
  std::string_view name;   ///< without its prefix
  std::string_view value;  ///< as it stands: references such as &amp; are not replaced
};

/// A start or an end of an element; `<x/>` gives both.
struct XmlTag {
  bool start = false;
  std::string_view name;                     ///< without its prefix
  std::span<const XmlAttribute> attributes;  ///< valid until the next call
  [[nodiscard]] std::optional<std::string_view> attribute(std::string_view wanted) const {
    for (const XmlAttribute& a : attributes)
      if (a.name == wanted) return a.value;
    return std::nullopt;
  }
};

/// Walks over XML without building anything, in memory of its depth. Text, comments and instructions are passed over.
/// No entities are ever defined or replaced, no file is ever fetched: a DOCTYPE may stand there, but hold nothing.
class XmlReader {
 public:
  explicit XmlReader(std::string_view text) : text_{text}, rest_{text} {}
  /// The next tag; nothing at the end. Fails with InvalidInput and the byte; TooLarge beyond 64 levels or 256
  /// attributes.
  [[nodiscard]] Result<std::optional<XmlTag>> next();
  [[nodiscard]] std::size_t at() const { return static_cast<std::size_t>(rest_.data() - text_.data()); }

 private:
  [[nodiscard]] tl::unexpected<Error> bad(std::string_view what) const;
  Result<void> skip_to(std::string_view end);
  std::string_view take_name();
  Result<void> take_attributes();

  std::string_view text_;
  std::string_view rest_;
  std::vector<std::string_view> open_;
  std::vector<XmlAttribute> attributes_;
  std::optional<std::string_view> closing_;  ///< of <x/>, whose end comes next
  bool seen_root_ = false;
};

}  // namespace telefab::fab
