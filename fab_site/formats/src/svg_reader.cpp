// SPDX-License-Identifier: GPL-3.0-or-later
#include "svg_reader.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "number_reader.hpp"
#include "stated_unit.hpp"
#include "xml_reader.hpp"

namespace telefab::fab {
namespace {

tl::unexpected<Error> bad(std::size_t byte, std::string_view what) {
  return fail(ErrorCode::InvalidInput, fmt::format("SVG, byte {}: {}", byte, what));
}

/// From the drawing's numbers to the build frame.
struct Drawing {
  double unit_mm = 1;
  double left = 0;
  double lower = 0;  ///< y of the drawing where the build frame has 0
  [[nodiscard]] Point2 to_build(double x, double y) const { return {(x - left) * unit_mm, (lower - y) * unit_mm}; }
};

struct Length {
  double value = 0;
  std::optional<double> unit_mm;  ///< nothing for plain numbers, pixels and percentages
};

std::optional<Length> length_of(std::optional<std::string_view> text) {
  if (!text) return std::nullopt;
  std::string_view rest = *text;
  skip_space(rest);
  const auto value = take_number(rest);
  if (!value || !(*value > 0)) return std::nullopt;
  skip_space(rest);
  constexpr std::array<std::pair<std::string_view, double>, 5> units{
      {{"mm", 1}, {"cm", 10}, {"in", 25.4}, {"pt", 25.4 / 72}, {"pc", 25.4 / 6}}};
  Length length{*value, {}};
  for (const auto& [name, mm] : units)
    if (rest == name) length.unit_mm = mm;
  return length;
}

Result<Drawing> read_drawing(const XmlTag& svg, std::optional<double> unit_read_mm, std::size_t byte) {
  const auto width = length_of(svg.attribute("width"));
  const auto height = length_of(svg.attribute("height"));
  std::optional<std::array<double, 4>> box;
  if (auto text = svg.attribute("viewBox")) {
    box.emplace();
    for (double& v : *box) {
      while (!text->empty() && (is_space(text->front()) || text->front() == ',')) text->remove_prefix(1);
      const auto number = take_number(*text);
      if (!number) return bad(byte, "viewBox needs four numbers");
      v = *number;
    }
    if (!((*box)[2] > 0) || !((*box)[3] > 0)) return bad(byte, "viewBox is empty");
  }
  std::optional<double> stated;
  if (width && width->unit_mm && height && height->unit_mm) {
    const double across = box ? width->value * *width->unit_mm / (*box)[2] : *width->unit_mm;
    const double along = box ? height->value * *height->unit_mm / (*box)[3] : *height->unit_mm;
    if (!box) return bad(byte, "width and height have units but there is no viewBox, so one step is a pixel; add one");
    if (std::abs(across - along) > 1e-6 * across)
      return bad(byte, fmt::format("one step is {} mm across and {} mm along; both must be the same", across, along));
    stated = across;
  }
  const auto unit = agreed_unit(stated, unit_read_mm);
  if (!unit) return tl::unexpected{unit.error()};
  Drawing drawing;
  drawing.unit_mm = *unit;
  if (box) {
    drawing.left = (*box)[0];
    drawing.lower = (*box)[1] + (*box)[3];
  } else if (height) {
    drawing.lower = height->value;
  }
  return drawing;
}

/// The rings of a path, in the drawing's numbers.
class PathReader {
 public:
  PathReader(std::string_view text, std::size_t byte) : rest_{text}, byte_{byte} {}

  Result<std::vector<std::vector<Point2>>> read() {
    char command = 0;
    for (;;) {
      skip();
      if (rest_.empty()) break;
      const char c = rest_.front();
      if ((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z')) {
        command = c;
        rest_.remove_prefix(1);
      } else if (command == 0 || command == 'z' || command == 'Z') {
        return bad(byte_, "a path should begin with M");
      }
      if (auto ok = step(command); !ok) return tl::unexpected{ok.error()};
    }
    end_ring();
    return std::move(rings_);
  }

 private:
  void skip() {
    std::size_t count = 0;
    while (count < rest_.size() && (is_space(rest_[count]) || rest_[count] == ',')) ++count;
    rest_.remove_prefix(count);
  }
  Result<double> number() {
    skip();
    const auto value = take_number(rest_);
    if (!value) return bad(byte_, "a number is missing in a path");
    return *value;
  }
  Result<void> step(char& command) {
    const bool relative = command >= 'a';
    const char kind = relative ? static_cast<char>(command - 'a' + 'A') : command;
    if (kind == 'Z') {
      if (!ring_.empty()) at_ = ring_.front();
      end_ring();
      return {};
    }
    if (kind != 'M' && kind != 'L' && kind != 'H' && kind != 'V')
      return bad(byte_,
                 fmt::format("a path uses \"{}\"; only straight lines are read (M, L, H, V, Z). Turn curves into "
                             "lines first",
                             command));
    Point2 to = at_;
    if (kind != 'V') {
      const auto x = number();
      if (!x) return tl::unexpected{x.error()};
      to.x_mm = *x + (relative ? at_.x_mm : 0);
    }
    if (kind != 'H') {
      const auto y = number();
      if (!y) return tl::unexpected{y.error()};
      to.y_mm = *y + (relative ? at_.y_mm : 0);
    }
    if (kind == 'M') {
      end_ring();
      command = relative ? 'l' : 'L';  // more numbers are lines
    } else if (ring_.empty()) {
      ring_.push_back(at_);  // a line after Z goes on from the ring's first point
    }
    at_ = to;
    ring_.push_back(to);
    return {};
  }
  void end_ring() {
    if (ring_.size() > 1) rings_.push_back(std::move(ring_));
    ring_.clear();
  }

  std::string_view rest_;
  std::size_t byte_;
  Point2 at_;
  std::vector<Point2> ring_;
  std::vector<std::vector<Point2>> rings_;
};

/// Slic3r 1.2 and later write heights in millionths of a millimetre's value ("1.5e-07" for 0.15 mm). A part whose
/// highest layer lies below a micrometre is no part: there the heights are meant so.
constexpr double kMillionths = 1e6;
constexpr double kHighestMillionth = 1e-3;

/// What the heights of the layers are to be multiplied by.
Result<double> height_factor(std::string_view text) {
  XmlReader xml{text};
  double highest = 0;
  for (;;) {
    const auto tag = xml.next();
    if (!tag) return tl::unexpected{tag.error()};
    if (!*tag) break;
    if (!(*tag)->start || (*tag)->name != "g") continue;
    if (const auto z = (*tag)->attribute("z"))
      if (const auto value = whole_number_text(*z)) highest = std::max(highest, *value);
  }
  return highest > 0 && highest < kHighestMillionth ? kMillionths : 1;
}

class SvgReader {
 public:
  SvgReader(std::string_view text, std::optional<double> unit_mm, double height_factor)
      : xml_{text}, unit_read_mm_{unit_mm}, height_factor_{height_factor} {}

  Result<RawLayers> read() {
    for (;;) {
      const auto tag = xml_.next();
      if (!tag) return tl::unexpected{tag.error()};
      if (!*tag) break;
      if (auto ok = (*tag)->start ? start(**tag) : end(); !ok) return tl::unexpected{ok.error()};
    }
    raw_.heights_in_millionths = height_factor_ != 1;
    return std::move(raw_);
  }

 private:
  Result<void> start(const XmlTag& tag) {
    ++level_;
    if (level_ == 1) {
      if (tag.name != "svg") return bad(xml_.at(), fmt::format("the root is <{}>, not <svg>", tag.name));
      auto drawing = read_drawing(tag, unit_read_mm_, xml_.at());
      if (!drawing) return tl::unexpected{drawing.error()};
      drawing_ = *drawing;
      return {};
    }
    if (skipping_ != 0) return {};
    if (tag.attribute("transform"))
      return bad(xml_.at(), fmt::format("<{}> has a transform; apply it to the coordinates first", tag.name));
    if (layer_ == nullptr) return tag.name == "g" ? start_layer(tag) : skip();
    if (tag.name == "path" || tag.name == "polygon") return add(tag);
    if (tag.name == "g") return {};
    if (tag.name == "title" || tag.name == "desc" || tag.name == "metadata") return skip();
    return bad(xml_.at(), fmt::format("<{}> in a layer; only path and polygon are read", tag.name));
  }
  Result<void> start_layer(const XmlTag& tag) {
    const auto z = tag.attribute("z");
    if (!z) return {};
    const auto top = whole_number_text(*z);
    if (!top) return bad(xml_.at(), "slic3r:z is not a number");
    // Heights are millimetres whatever the drawing's unit is.
    const double top_mm = *top * height_factor_;
    auto layer = raw_.at(top_mm);
    if (!layer) return tl::unexpected{layer.error()};
    if (std::abs((*layer)->top_mm - top_mm) > 1e-9)
      return bad(xml_.at(),
                 fmt::format("layers at {:g} and {:g} mm are one: slic3r:z must be the upper side of a layer in "
                             "millimetres",
                             (*layer)->top_mm, top_mm));
    layer_ = *layer;
    layer_level_ = level_;
    if (const auto height = tag.attribute("layer-height"))
      if (const auto value = whole_number_text(*height); value && (!lowest_ || top_mm < *lowest_)) {
        lowest_ = top_mm;
        raw_.bottom_mm = top_mm - *value * height_factor_;
      }
    return {};
  }
  Result<void> skip() {
    skipping_ = level_;
    return {};
  }
  Result<void> end() {
    if (skipping_ == level_) skipping_ = 0;
    if (layer_ != nullptr && layer_level_ == level_) layer_ = nullptr;
    --level_;
    return {};
  }
  Result<void> add(const XmlTag& tag) {
    const auto text = tag.attribute(tag.name == "path" ? "d" : "points");
    if (!text) return {};
    const auto type = tag.attribute("type").value_or("contour");
    const std::uint32_t part = type.starts_with("support") ? 2 : 1;
    // The points of a polygon are a path with one implied move.
    const std::string path = tag.name == "path" ? std::string{} : "M" + std::string{*text};
    auto rings = PathReader{tag.name == "path" ? *text : std::string_view{path}, xml_.at()}.read();
    if (!rings) return tl::unexpected{rings.error()};
    for (auto& ring : *rings) {
      for (Point2& p : ring) p = drawing_.to_build(p.x_mm, p.y_mm);
      if (auto ok = RawLayers::add(*layer_, {part, std::nullopt, std::move(ring)}); !ok) return ok;
    }
    return {};
  }

  XmlReader xml_;
  std::optional<double> unit_read_mm_;
  double height_factor_;
  Drawing drawing_;
  RawLayers raw_;
  RawLayer* layer_ = nullptr;
  std::optional<double> lowest_;
  std::size_t level_ = 0;
  std::size_t layer_level_ = 0;
  std::size_t skipping_ = 0;  ///< level of the element that is passed over, 0: none
};

}  // namespace

Result<RawLayers> read_svg(std::string_view text, std::optional<double> unit_mm) {
  const auto factor = height_factor(text);
  if (!factor) return tl::unexpected{factor.error()};
  return SvgReader{text, unit_mm, *factor}.read();
}

}  // namespace telefab::fab
