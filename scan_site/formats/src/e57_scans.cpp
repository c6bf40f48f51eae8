// SPDX-License-Identifier: GPL-3.0-or-later
#include "e57_scans.hpp"

#include <fmt/format.h>
#include <bit>
#include <charconv>
#include <limits>
#include <pugixml.hpp>

namespace telefab::scan {
namespace {

constexpr std::size_t kMaxXmlBytes = 64U << 20U;
constexpr std::size_t kMaxFields = 4096;
constexpr int kMaxDepth = 8;

/// Tag without its namespace prefix.
std::string_view local_name(const pugi::xml_node& node) {
  const std::string_view name = node.name();
  const std::size_t colon = name.rfind(':');
  return colon == std::string_view::npos ? name : name.substr(colon + 1);
}

template <class T>
Result<T> number_of(std::string_view text, std::string_view what) {
  const std::size_t first = text.find_first_not_of(" \t\r\n+");
  const std::size_t last = text.find_last_not_of(" \t\r\n");
  if (first != std::string_view::npos) text = text.substr(first, last - first + 1);
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size())
    return fail(ErrorCode::InvalidInput,
                fmt::format("E57: {} is '{}', which is not a number", what, text.substr(0, 40)));
  return value;
}

/// An attribute, or what the standard says where it is absent.
template <class T>
Result<T> attribute(const pugi::xml_node& node, const char* key, T absent) {
  const pugi::xml_attribute found = node.attribute(key);
  if (!found) return absent;
  return number_of<T>(found.value(), fmt::format("{} of {}", key, std::string_view{node.name()}.substr(0, 40)));
}

/// A child's number; an element without text is 0.
Result<double> child_number(const pugi::xml_node& node, const char* key, double absent) {
  const pugi::xml_node child = node.child(key);
  if (!child) return absent;
  const std::string_view text = child.text().get();
  if (text.empty()) return 0.0;
  return number_of<double>(text, key);
}

Result<E57Field> field_of(const pugi::xml_node& node) {
  using Kind = E57Field::Kind;
  E57Field field;
  field.name = local_name(node).substr(0, 80);
  const std::string_view type = node.attribute("type").value();
  if (type == "Float") {
    const bool is_single = std::string_view{node.attribute("precision").value()} == "single";
    field.kind = is_single ? Kind::Float32 : Kind::Float64;
    field.bits = is_single ? 32 : 64;
    return field;
  }
  if (type == "String") {
    field.kind = Kind::Text;
    return field;
  }
  if (type != "Integer" && type != "ScaledInteger")
    return fail(ErrorCode::InvalidInput,
                fmt::format("E57: field {} of type '{}'; Float, Integer, ScaledInteger and String are known",
                            field.name, type.substr(0, 40)));
  using Limits = std::numeric_limits<std::int64_t>;
  const auto least = attribute<std::int64_t>(node, "minimum", Limits::min());
  if (!least) return tl::unexpected{least.error()};
  const auto most = attribute<std::int64_t>(node, "maximum", Limits::max());
  if (!most) return tl::unexpected{most.error()};
  if (*most < *least)
    return fail(ErrorCode::InvalidInput,
                fmt::format("E57: field {} has minimum {} above maximum {}", field.name, *least, *most));
  field.kind = Kind::Integer;
  field.least = *least;
  field.span = static_cast<std::uint64_t>(*most) - static_cast<std::uint64_t>(*least);
  field.bits = static_cast<unsigned>(std::bit_width(field.span));
  if (type == "Integer") return field;
  const auto scale = attribute<double>(node, "scale", 1);
  if (!scale) return tl::unexpected{scale.error()};
  const auto offset = attribute<double>(node, "offset", 0);
  if (!offset) return tl::unexpected{offset.error()};
  field.scale = *scale;
  field.offset = *offset;
  return field;
}

Result<void> add_fields(const pugi::xml_node& structure, int depth, std::vector<E57Field>& fields) {
  for (const pugi::xml_node& child : structure.children()) {
    if (child.type() != pugi::node_element) continue;
    const std::string_view type = child.attribute("type").value();
    if (type == "Structure" || type == "Vector") {
      if (depth == kMaxDepth) return fail(ErrorCode::InvalidInput, "E57: a prototype nested too deep");
      if (auto done = add_fields(child, depth + 1, fields); !done) return done;
      continue;
    }
    auto field = field_of(child);
    if (!field) return tl::unexpected{field.error()};
    if (fields.size() == kMaxFields)
      return fail(ErrorCode::InvalidInput, fmt::format("E57: more than {} fields a point", kMaxFields));
    fields.push_back(std::move(*field));
  }
  return {};
}

Result<std::optional<Eigen::Isometry3d>> pose_of(const pugi::xml_node& scan) {
  const pugi::xml_node node = scan.child("pose");
  if (!node) return std::nullopt;
  constexpr std::array kTurn{"w", "x", "y", "z"};
  constexpr std::array kShift{"x", "y", "z"};
  std::array<double, 4> turn{1, 0, 0, 0};
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  for (std::size_t i = 0; i < kTurn.size(); ++i) {
    const auto value = child_number(node.child("rotation"), kTurn[i], turn[i]);
    if (!value) return tl::unexpected{value.error()};
    turn[i] = *value;
  }
  for (std::size_t i = 0; i < kShift.size(); ++i) {
    const auto value = child_number(node.child("translation"), kShift[i], 0);
    if (!value) return tl::unexpected{value.error()};
    pose.translation()[static_cast<int>(i)] = *value;
  }
  const Eigen::Quaterniond q{turn[0], turn[1], turn[2], turn[3]};
  constexpr double kTolerance = 0.01;
  if (!(std::abs(q.norm() - 1) < kTolerance) || !pose.translation().allFinite())
    return fail(ErrorCode::InvalidInput, "E57: the pose of a scan is not a unit quaternion and finite translation");
  pose.linear() = q.normalized().toRotationMatrix();
  return pose;
}

Result<E57Scan> scan_of(const pugi::xml_node& node) {
  E57Scan scan;
  const pugi::xml_node points = node.child("points");
  if (!points || std::string_view{points.attribute("type").value()} != "CompressedVector")
    return fail(ErrorCode::InvalidInput, "E57: no compressed vector named points");
  const auto offset = attribute<std::uint64_t>(points, "fileOffset", 0);
  if (!offset) return tl::unexpected{offset.error()};
  const auto records = attribute<std::uint64_t>(points, "recordCount", 0);
  if (!records) return tl::unexpected{records.error()};
  scan.offset = *offset;
  scan.records = *records;
  for (const pugi::xml_node& codec : points.child("codecs").children())
    if (codec.type() == pugi::node_element && !codec.child("bitPackCodec"))
      return fail(ErrorCode::InvalidInput, "E57: points packed by a codec other than bitPackCodec cannot be read");
  if (auto done = add_fields(points.child("prototype"), 0, scan.fields); !done) return tl::unexpected{done.error()};
  auto pose = pose_of(node);
  if (!pose) return tl::unexpected{pose.error()};
  scan.pose = *pose;
  return scan;
}

}  // namespace

std::optional<std::size_t> E57Scan::field(std::string_view name) const {
  for (std::size_t i = 0; i < fields.size(); ++i)
    if (fields[i].name == name) return i;
  return std::nullopt;
}

Result<std::vector<E57Scan>> e57_scans_of(std::span<const std::byte> xml) {
  if (xml.size() > kMaxXmlBytes)
    return fail(ErrorCode::TooLarge, fmt::format("E57: {} bytes of XML; the limit is {}", xml.size(), kMaxXmlBytes));
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_buffer(xml.data(), xml.size());
  if (!parsed)
    return fail(ErrorCode::InvalidInput,
                fmt::format("E57: the XML section is damaged at its byte {}: {}", parsed.offset, parsed.description()));
  const pugi::xml_node root = document.child("e57Root");
  if (!root) return fail(ErrorCode::InvalidInput, "E57: the XML section has no e57Root");
  std::vector<E57Scan> scans;
  for (const pugi::xml_node& child : root.child("data3D").children("vectorChild")) {
    auto scan = scan_of(child);
    if (!scan) return fail_in(fmt::format("scan {}", scans.size()), scan.error());
    scans.push_back(std::move(*scan));
  }
  return scans;
}

}  // namespace telefab::scan
