// SPDX-License-Identifier: GPL-3.0-or-later
#include "xml_reader.hpp"

#include <fmt/format.h>

#include "number_reader.hpp"

namespace telefab::fab {
namespace {

constexpr std::size_t kMostLevels = 64;
constexpr std::size_t kMostAttributes = 256;

bool is_name_char(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' ||
         c == '.' || c == ':' || static_cast<unsigned char>(c) >= 0x80;
}

std::string_view without_prefix(std::string_view name) {
  const auto colon = name.find(':');
  return colon == std::string_view::npos ? name : name.substr(colon + 1);
}

}  // namespace

tl::unexpected<Error> XmlReader::bad(std::string_view what) const {
  return fail(ErrorCode::InvalidInput, fmt::format("XML, byte {}: {}", at(), what));
}

Result<void> XmlReader::skip_to(std::string_view end) {
  const auto found = rest_.find(end);
  if (found == std::string_view::npos) return bad(fmt::format("no \"{}\" follows; the file is cut off", end));
  rest_.remove_prefix(found + end.size());
  return {};
}

std::string_view XmlReader::take_name() {
  std::size_t size = 0;
  while (size < rest_.size() && is_name_char(rest_[size])) ++size;
  const auto name = rest_.substr(0, size);
  rest_.remove_prefix(size);
  return name;
}

Result<void> XmlReader::take_attributes() {
  attributes_.clear();
  for (;;) {
    skip_space(rest_);
    if (rest_.empty()) return bad("the file ends within a tag; it is cut off");
    if (rest_.front() == '>' || rest_.front() == '/') return {};
    const auto name = take_name();
    skip_space(rest_);
    if (name.empty() || !rest_.starts_with('=')) return bad("an attribute should stand here");
    rest_.remove_prefix(1);
    skip_space(rest_);
    if (rest_.empty() || (rest_.front() != '"' && rest_.front() != '\'')) return bad("an attribute without quotes");
    const char quote = rest_.front();
    const auto end = rest_.find(quote, 1);
    if (end == std::string_view::npos) return bad("an attribute without an end; the file is cut off");
    if (attributes_.size() == kMostAttributes)
      return fail(ErrorCode::TooLarge, fmt::format("XML, byte {}: more than {} attributes", at(), kMostAttributes));
    attributes_.push_back({without_prefix(name), rest_.substr(1, end - 1)});
    rest_.remove_prefix(end + 1);
  }
}

Result<std::optional<XmlTag>> XmlReader::next() {
  if (closing_) {
    const XmlTag tag{false, *closing_, {}};
    closing_.reset();
    return tag;
  }
  for (;;) {
    const auto tag_begin = rest_.find('<');
    if (tag_begin == std::string_view::npos) {
      if (!open_.empty()) return bad(fmt::format("<{}> is not closed; the file is cut off", open_.back()));
      if (!seen_root_) return bad("no element");
      rest_.remove_prefix(rest_.size());
      return std::optional<XmlTag>{};
    }
    rest_.remove_prefix(tag_begin + 1);
    Result<void> skipped;
    if (rest_.starts_with("!--")) {
      skipped = skip_to("-->");
    } else if (rest_.starts_with("![CDATA[")) {
      skipped = skip_to("]]>");
    } else if (rest_.starts_with('?')) {
      skipped = skip_to("?>");
    } else if (rest_.starts_with('!')) {
      if (rest_.substr(0, rest_.find('>')).find('[') != std::string_view::npos)
        return bad("definitions within a DOCTYPE are not read");
      skipped = skip_to(">");
    } else {
      break;
    }
    if (!skipped) return tl::unexpected{skipped.error()};
  }
  if (rest_.starts_with('/')) {
    rest_.remove_prefix(1);
    const auto name = take_name();
    skip_space(rest_);
    if (!rest_.starts_with('>')) return bad("an end tag without >");
    rest_.remove_prefix(1);
    if (open_.empty() || open_.back() != name) return bad(fmt::format("</{}> closes nothing that is open", name));
    open_.pop_back();
    return XmlTag{false, without_prefix(name), {}};
  }
  const auto name = take_name();
  if (name.empty()) return bad("a tag without a name");
  if (open_.empty() && seen_root_) return bad("a second root element");
  seen_root_ = true;
  if (auto ok = take_attributes(); !ok) return tl::unexpected{ok.error()};
  if (rest_.starts_with('/')) {
    rest_.remove_prefix(1);
    closing_ = without_prefix(name);
  } else {
    if (open_.size() == kMostLevels)
      return fail(ErrorCode::TooLarge, fmt::format("XML, byte {}: more than {} levels", at(), kMostLevels));
    open_.push_back(name);
  }
  if (!rest_.starts_with('>')) return bad("a tag without >");
  rest_.remove_prefix(1);
  return XmlTag{true, without_prefix(name), attributes_};
}

}  // namespace telefab::fab
