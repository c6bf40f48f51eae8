// SPDX-License-Identifier: GPL-3.0-or-later
#include "threemf_reader.hpp"

#include <fmt/format.h>

#include <array>
#include <map>
#include <telefab/geometry/limits.hpp>

#include "number_reader.hpp"
#include "stated_unit.hpp"
#include "xml_reader.hpp"
#include "zip_reader.hpp"

namespace telefab::fab {
namespace {

/// Of an item: x and y of the model as sums of x and y of the object, and the shift; z only shifts.
struct Placing {
  std::array<double, 4> turn{1, 0, 0, 1};
  std::array<double, 3> shift_mm{0, 0, 0};
};

struct SliceStack {
  double bottom_mm = 0;
  RawLayers layers;
  std::vector<std::pair<std::string, std::string>> references;  ///< path and stack
};
using SliceStacks = std::map<std::string, SliceStack, std::less<>>;

struct ModelObject {
  std::string stack;
  bool supports = false;
  bool components = false;
};

struct Model {
  double unit_mm = 1;  ///< everything below is millimetres
  SliceStacks stacks;
  std::map<std::string, ModelObject, std::less<>> objects;
  std::vector<std::pair<std::string, Placing>> items;
};

tl::unexpected<Error> bad(const XmlReader& xml, std::string_view what) {
  return fail(ErrorCode::InvalidInput, fmt::format("3MF model, byte {}: {}", xml.at(), what));
}

Result<double> number(const XmlReader& xml, const XmlTag& tag, std::string_view name) {
  const auto text = tag.attribute(name);
  const auto value = text ? whole_number_text(*text) : std::nullopt;
  if (!value) return bad(xml, fmt::format("<{}> needs a number as {}", tag.name, name));
  return *value;
}

Result<std::size_t> index(const XmlReader& xml, const XmlTag& tag, std::string_view name, std::size_t count) {
  const auto value = number(xml, tag, name);
  if (!value) return tl::unexpected{value.error()};
  if (*value < 0 || *value != std::floor(*value) || !(*value < static_cast<double>(count)))
    return bad(xml, fmt::format("{} {} of <{}>; the slice has {} vertices", name, *value, tag.name, count));
  return static_cast<std::size_t>(*value);
}

std::optional<double> unit_named(std::string_view name) {
  constexpr std::array<std::pair<std::string_view, double>, 6> units{
      {{"micron", 0.001}, {"millimeter", 1}, {"centimeter", 10}, {"inch", 25.4}, {"foot", 304.8}, {"meter", 1000}}};
  for (const auto& [unit, mm] : units)
    if (unit == name) return mm;
  return std::nullopt;
}

class ModelReader {
 public:
  explicit ModelReader(std::string_view text) : xml_{text} {}

  Result<Model> read() {
    for (;;) {
      const auto tag = xml_.next();
      if (!tag) return tl::unexpected{tag.error()};
      if (!*tag) return std::move(model_);
      if (auto ok = (*tag)->start ? start(**tag) : end(**tag); !ok) return tl::unexpected{ok.error()};
    }
  }

 private:
  Result<void> start(const XmlTag& tag) {
    if (tag.name == "model") return start_model(tag);
    if (tag.name == "slicestack") return start_stack(tag);
    if (tag.name == "sliceref" && stack_ != nullptr) {
      stack_->references.emplace_back(tag.attribute("slicepath").value_or(""),
                                      tag.attribute("slicestackid").value_or(""));
      return {};
    }
    if (tag.name == "slice" && stack_ != nullptr) return start_slice(tag);
    if (slice_ != nullptr) return in_slice(tag);
    if (tag.name == "object") {
      auto& object = model_.objects[std::string{tag.attribute("id").value_or("")}];
      object.stack = tag.attribute("slicestackid").value_or("");
      object.supports = tag.attribute("type").value_or("model") == "support";
      object_ = &object;
    } else if (tag.name == "component" && object_ != nullptr) {
      object_->components = true;
    } else if (tag.name == "item") {
      return add_item(tag);
    }
    return {};
  }
  Result<void> end(const XmlTag& tag) {
    if (tag.name == "slicestack") stack_ = nullptr;
    if (tag.name == "object") object_ = nullptr;
    if (tag.name == "slice") slice_ = nullptr;
    if (tag.name == "polygon" && slice_ != nullptr) {
      if (ring_.vertices.size() > 1 && ring_.vertices.front() == ring_.vertices.back()) ring_.vertices.pop_back();
      auto done = RawLayers::add(*slice_, std::move(ring_));
      ring_ = {};
      return done;
    }
    return {};
  }
  Result<void> start_model(const XmlTag& tag) {
    const auto name = tag.attribute("unit").value_or("millimeter");  // the standard's default
    const auto unit_mm = unit_named(name);
    if (!unit_mm) return bad(xml_, fmt::format("unit \"{}\" is none of 3MF's", name));
    model_.unit_mm = *unit_mm;
    return {};
  }
  Result<void> start_stack(const XmlTag& tag) {
    const auto id = std::string{tag.attribute("id").value_or("")};
    if (id.empty() || model_.stacks.count(id)) return bad(xml_, "a slice stack needs an id of its own");
    stack_ = &model_.stacks[id];
    if (tag.attribute("zbottom")) {
      const auto bottom = number(xml_, tag, "zbottom");
      if (!bottom) return tl::unexpected{bottom.error()};
      stack_->bottom_mm = *bottom * model_.unit_mm;
    }
    return {};
  }
  Result<void> start_slice(const XmlTag& tag) {
    const auto top = number(xml_, tag, "ztop");
    if (!top) return tl::unexpected{top.error()};
    auto layer = stack_->layers.at(*top * model_.unit_mm);
    if (!layer) return tl::unexpected{layer.error()};
    slice_ = *layer;
    vertices_.clear();
    return {};
  }
  Result<void> in_slice(const XmlTag& tag) {
    if (tag.name == "vertex") {
      const auto x = number(xml_, tag, "x");
      const auto y = x ? number(xml_, tag, "y") : x;
      if (!y) return tl::unexpected{y.error()};
      if (vertices_.size() == kMaxVerticesPerLayer)
        return fail(ErrorCode::TooLarge, fmt::format("a slice of more than {} vertices", kMaxVerticesPerLayer));
      vertices_.push_back({*x * model_.unit_mm, *y * model_.unit_mm});
    } else if (tag.name == "polygon") {
      const auto first = index(xml_, tag, "startv", vertices_.size());
      if (!first) return tl::unexpected{first.error()};
      ring_ = {};
      ring_.vertices.push_back(vertices_[*first]);
    } else if (tag.name == "segment") {
      const auto next = index(xml_, tag, "v2", vertices_.size());
      if (!next) return tl::unexpected{next.error()};
      if (ring_.vertices.size() > kMaxVerticesPerLayer)
        return fail(ErrorCode::TooLarge, fmt::format("a polygon of more than {} segments", kMaxVerticesPerLayer));
      ring_.vertices.push_back(vertices_[*next]);
    }
    return {};
  }
  Result<void> add_item(const XmlTag& tag) {
    Placing placing;
    if (auto text = tag.attribute("transform")) {
      std::array<double, 12> m{};
      for (double& v : m) {
        skip_space(*text);
        const auto value = take_number(*text);
        if (!value) return bad(xml_, "a transform needs twelve numbers");
        v = *value;
      }
      constexpr double rounding = 1e-6;
      const auto zero = [&](double v) { return std::abs(v) <= rounding; };
      if (!zero(m[2]) || !zero(m[5]) || !zero(m[6]) || !zero(m[7]) || !zero(m[8] - 1))
        return bad(xml_, "an item leans or is scaled in height, which slices cannot follow");
      placing.turn = {m[0], m[1], m[3], m[4]};
      placing.shift_mm = {m[9] * model_.unit_mm, m[10] * model_.unit_mm, m[11] * model_.unit_mm};
    }
    model_.items.emplace_back(tag.attribute("objectid").value_or(""), placing);
    return {};
  }

  XmlReader xml_;
  Model model_;
  SliceStack* stack_ = nullptr;
  RawLayer* slice_ = nullptr;
  ModelObject* object_ = nullptr;
  std::vector<Point2> vertices_;
  RawRing ring_;
};

std::string entry_name(std::string path) {
  while (path.starts_with('/')) path.erase(0, 1);
  return path;
}

/// The model part that the package's relationships name.
Result<std::string> model_name(ZipReader& zip) {
  const auto text = zip.entry("_rels/.rels");
  if (!text) return fail_in("not a 3MF file", text.error());
  XmlReader xml{*text};
  for (;;) {
    const auto tag = xml.next();
    if (!tag) return tl::unexpected{tag.error()};
    if (!*tag) return fail(ErrorCode::InvalidInput, "not a 3MF file: no relationship names its model");
    if ((*tag)->start && (*tag)->name == "Relationship" && (*tag)->attribute("Type").value_or("").ends_with("/3dmodel"))
      return entry_name(std::string{(*tag)->attribute("Target").value_or("")});
  }
}

/// Adds one stack, as placed, to all.
Result<void> place(const RawLayers& from, const Placing& placing, std::uint32_t part, RawLayers& to) {
  for (const auto& [key, layer] : from.layers()) {
    auto target = to.at(layer.top_mm + placing.shift_mm[2]);
    if (!target) return tl::unexpected{target.error()};
    for (const RawRing& ring : layer.rings) {
      RawRing moved{part, ring.hole, ring.vertices};
      for (Point2& p : moved.vertices)
        p = {p.x_mm * placing.turn[0] + p.y_mm * placing.turn[2] + placing.shift_mm[0],
             p.x_mm * placing.turn[1] + p.y_mm * placing.turn[3] + placing.shift_mm[1]};
      if (auto ok = RawLayers::add(**target, std::move(moved)); !ok) return ok;
    }
  }
  return {};
}

}  // namespace

Result<RawLayers> read_threemf(std::span<const std::byte> bytes, std::optional<double> unit_mm) {
  auto zip = ZipReader::open(bytes);
  if (!zip) return tl::unexpected{zip.error()};
  const auto name = model_name(*zip);
  if (!name) return tl::unexpected{name.error()};
  std::map<std::string, Model> models;
  const auto model_at = [&](const std::string& entry) -> Result<Model*> {
    if (const auto found = models.find(entry); found != models.end()) return &found->second;
    const auto text = zip->entry(entry);
    if (!text) return tl::unexpected{text.error()};
    auto model = ModelReader{*text}.read();
    if (!model) return fail_in(entry, model.error());
    return &(models[entry] = std::move(*model));
  };
  const auto root = model_at(*name);
  if (!root) return tl::unexpected{root.error()};
  if (const auto unit = agreed_unit((*root)->unit_mm, unit_mm); !unit) return tl::unexpected{unit.error()};

  RawLayers all;
  std::uint32_t next_part = 3;
  bool first = true;
  constexpr std::size_t most_items = 10'000;
  if ((*root)->items.size() > most_items) return fail(ErrorCode::TooLarge, "more than 10,000 items in the build");
  for (const auto& [id, placing] : (*root)->items) {
    const auto object = (*root)->objects.find(id);
    if (object == (*root)->objects.end())
      return fail(ErrorCode::InvalidInput, fmt::format("the build places object {}, which is not there", id));
    const auto stack = (*root)->stacks.find(object->second.stack);
    if (stack == (*root)->stacks.end())
      return fail(ErrorCode::InvalidInput,
                  fmt::format("object {} has no slices{}; slice it and save it with the slice extension", id,
                              object->second.components ? ", it is made of components" : ""));
    const std::uint32_t part = object->second.supports ? 2 : first ? 1 : next_part++;
    first = first && object->second.supports;
    const double bottom_mm = stack->second.bottom_mm + placing.shift_mm[2];
    if (!all.bottom_mm || bottom_mm < *all.bottom_mm) all.bottom_mm = bottom_mm;
    if (auto ok = place(stack->second.layers, placing, part, all); !ok) return tl::unexpected{ok.error()};
    for (const auto& [path, other] : stack->second.references) {
      const auto model = model_at(entry_name(path));
      if (!model) return fail_in("a slice stack refers to another part", model.error());
      const auto found = (*model)->stacks.find(other);
      if (found == (*model)->stacks.end() || !found->second.references.empty())
        return fail(ErrorCode::InvalidInput, fmt::format("{} has no slice stack {} of its own", path, other));
      if (auto ok = place(found->second.layers, placing, part, all); !ok) return tl::unexpected{ok.error()};
    }
  }
  return all;
}

}  // namespace telefab::fab
