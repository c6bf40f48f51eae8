// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/geometry/limits.hpp>
#include <telefab/job/slice_parameters.hpp>

namespace telefab {
namespace {

using Json = nlohmann::ordered_json;
using P = SliceParameters;
using Range = SliceParameter::Range;
using Subject = SliceParameter::Subject;

constexpr std::array<std::string_view, 4> kUnits{"mm", "cm", "m", "in"};
constexpr std::array<std::string_view, 3> kMirrors{"x", "y", "z"};
constexpr std::array<std::string_view, 2> kBases{"scanned", "flat"};
constexpr std::array<std::string_view, 3> kMethods{"auto", "reeb", "grid"};
constexpr std::array<std::string_view, 4> kSurfaces{"unbiased", "paper", "paper-literal", "imls"};
constexpr std::array<std::string_view, 2> kCodings{"exact", "curve"};

constexpr Range kLength{.least = 0, .is_least_in = false, .most = kMaxCoordinateMm};
constexpr Range kScale{.least = 0, .is_least_in = false, .most = 1e9};
constexpr Range kKernel{.least = 0, .is_least_in = false, .most = 1000};
constexpr Range kSpeck{.least = 0, .is_least_in = true, .most = 100};
constexpr Range kPriority{.least = -100, .is_least_in = true, .most = 100, .is_whole = true};
constexpr Range kCopies{.least = 1, .is_least_in = true, .most = 100, .is_whole = true};
constexpr Range kUpToOne{.least = 0, .is_least_in = false, .most = 1};

constexpr std::array<std::string_view, 3> kSubjects{"slicing", "profile", "fleet"};

const std::array kTable{
    SliceParameter{.key = "resin",
                   .field = &P::resin,
                   .help = "what is printed with, one of the fab's resins; default: what the machine has loaded, or "
                           "states itself",
                   .form = "a name of `telefab resins`",
                   .example = "formlabs-clear",
                   .subject = Subject::Profile},
    SliceParameter{
        .key = "print",
        .field = &P::print,
        .help = "layers, supports and motion, one of the fab's ways to print; default: as the machine states",
        .form = "a name of `telefab prints`",
        .example = "fine",
        .subject = Subject::Profile},
    SliceParameter{.key = "height_mm",
                   .field = &P::height_mm,
                   .help = "scale the part to this height; default: the scan's own size",
                   .unit = "mm",
                   .range = kLength},
    SliceParameter{.key = "scale",
                   .field = &P::scale,
                   .help = "millimetres per unit of the file",
                   .range = kScale,
                   .not_with = {"height_mm"}},
    SliceParameter{
        .key = "fit",
        .field = &P::fit,
        .help = "scale the part to the largest the machine holds with supports and a margin of 1 % on every side",
        .not_with = {"height_mm", "scale"}},
    SliceParameter{.key = "units",
                   .field = &P::units,
                   .help = "unit of the file; default: what the file states, or mm",
                   .choices = kUnits,
                   .not_with = {"scale"}},
    SliceParameter{.key = "up",
                   .field = &P::up,
                   .help = "what of the scan points up: one of its axes, a direction X,Y,Z, or auto: chosen from all "
                           "directions for least supports (also auto:supports), auto:height or auto:quality (least "
                           "surface that supports and steps mark)",
                   .fallback = "z",
                   .form = "x | -x | y | -y | z | -z | X,Y,Z | auto | auto:supports | auto:height | auto:quality",
                   .example = "auto:height"},
    SliceParameter{.key = "rotate",
                   .field = &P::rotate,
                   .help = "turn the scan: X,Y,Z in degrees about its fixed axes, first x, then y, then z; or the nine "
                           "numbers of a rotation matrix, row by row",
                   .form = "X,Y,Z | nine numbers",
                   .example = "90,0,-45",
                   .not_with = {"up"}},
    SliceParameter{.key = "mirror",
                   .field = &P::mirror,
                   .help = "make the mirror image: this axis of the scan changes its sign, before it is turned",
                   .choices = kMirrors},
    SliceParameter{.key = "scale_axes",
                   .field = &P::scale_axes,
                   .help =
                       "larger by these factors along x, y and z of the platform, 0.8 to 1.25, on top of what "
                       "makes good the shrinkage that the profile states; a height or size asked for is the one before",
                   .fallback = "1,1,1",
                   .form = "X,Y,Z",
                   .example = "1.02,1.02,1.015"},
    SliceParameter{.key = "position",
                   .field = &P::position,
                   .help = "where on the platform the middle of the part stands, X,Y in mm from its front left corner; "
                           "default: in the middle",
                   .form = "X,Y",
                   .example = "40,30"},
    SliceParameter{.key = "crop",
                   .field = &P::crop,
                   .help = "take what lies in this box, in the unit and frame of the file: x0,y0,z0,x1,y1,z1",
                   .form = "x0,y0,z0,x1,y1,z1",
                   .example = "-10,-10,0,10,10,25.5"},
    SliceParameter{.key = "pieces",
                   .field = &P::pieces,
                   .help =
                       "all | largest | N: keep so many of the largest pieces, without the ground they stand on; or "
                       "only:N,M,...: those of these numbers, 1 being the largest",
                   .fallback = "all",
                   .form = "all | largest | N | only:N,M,...",
                   .example = "2"},
    SliceParameter{.key = "sample_faces",
                   .field = &P::sample_faces,
                   .help = "a mesh file: take points spread over its faces in place of its corners"},
    SliceParameter{.key = "complete",
                   .field = &P::complete,
                   .help =
                       "continue the surface across gaps of the scan: auto, off, or how far from the nearest sample, "
                       "in mm",
                   .fallback = "auto",
                   .form = "auto | off | MM",
                   .example = "3.5"},
    SliceParameter{.key = "base",
                   .field = &P::base,
                   .help = "scanned, or flat: the part is cut at the platform, nothing is missing below",
                   .choices = kBases,
                   .fallback = "scanned"},
    SliceParameter{.key = "thickness_mm",
                   .field = &P::thickness_mm,
                   .help = "a sheet or relief scanned from one side: make it so thick, behind what was scanned",
                   .unit = "mm",
                   .range = kLength},
    SliceParameter{.key = "layer_mm",
                   .field = &P::layer_mm,
                   .help = "layer thickness; default: the machine's",
                   .unit = "mm",
                   .range = kUpToOne},
    SliceParameter{.key = "chord_mm",
                   .field = &P::chord_mm,
                   .help = "chord tolerance; default: a tenth of the machine's pixel, a fortieth where contours are "
                           "coded as curves",
                   .unit = "mm",
                   .range = kUpToOne},
    SliceParameter{.key = "speck_px2",
                   .field = &P::speck_px2,
                   .help =
                       "leave out contours of less area than so many of the machine's pixels; those thinner than an "
                       "eighth of a pixel go in any case; default: 0.5",
                   .unit = "px2",
                   .range = kSpeck},
    SliceParameter{.key = "method",
                   .field = &P::method,
                   .help = "how contours are found: marched from the Reeb graph, by marching squares, or marched where "
                           "that can be certified",
                   .choices = kMethods,
                   .fallback = "auto"},
    SliceParameter{.key = "surface",
                   .field = &P::surface,
                   .help = "how the surface is made of the points",
                   .choices = kSurfaces,
                   .fallback = "unbiased"},
    SliceParameter{.key = "kernel_mm",
                   .field = &P::kernel_mm,
                   .help = "kernel width; default: from spacing and noise, point by point",
                   .unit = "mm",
                   .range = kKernel},
    SliceParameter{.key = "keep_outliers", .field = &P::keep_outliers, .help = "use every point of the scan"},
    SliceParameter{.key = "coding",
                   .field = &P::coding,
                   .help = "how contours are coded: to the last digit, or as curves within 0.065 pixels",
                   .choices = kCodings,
                   .fallback = "curve"},
    SliceParameter{.key = "priority",
                   .field = &P::priority,
                   .help = "of a fleet's jobs larger ones are printed first, of one priority in the order of their "
                           "deadlines and of submission; default: 0",
                   .range = kPriority,
                   .subject = Subject::Fleet},
    SliceParameter{.key = "deadline",
                   .field = &P::deadline,
                   .help = "of a fleet's jobs of one priority the nearest are printed first, those without one last",
                   .form = "YYYY-MM-DDTHH:MMZ, universal time",
                   .example = "2027-03-01T08:00Z",
                   .subject = Subject::Fleet},
    SliceParameter{.key = "copies",
                   .field = &P::copies,
                   .help =
                       "so many parts, each a job of its own for whichever machine of the fleet is free: ID, ID-c2, "
                       "ID-c3; default: 1",
                   .range = kCopies,
                   .subject = Subject::Fleet},
};

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};
template <class... F>
Overloaded(F...) -> Overloaded<F...>;

tl::unexpected<Error> bad(std::string_view key, std::string_view claim) {
  return fail(ErrorCode::InvalidInput, fmt::format("parameter {}: {}", key, claim));
}

bool is_set(const SliceParameters& parameters, const SliceParameter& row) {
  return std::visit(Overloaded{[&](SliceParameter::Flag flag) { return parameters.*flag; },
                               [&](auto field) { return (parameters.*field).has_value(); }},
                    row.field);
}

Result<void> validate_value(const SliceParameters& parameters, const SliceParameter& row) {
  if (const auto* number = std::get_if<SliceParameter::Number>(&row.field)) {
    const double value = *(parameters.**number);
    if (!contains(row.range, value)) return bad(row.key, fmt::format("{} is not {}", value, text_of(row.range)));
  }
  if (const auto* choice = std::get_if<SliceParameter::Choice>(&row.field)) {
    const std::string& value = *(parameters.**choice);
    if (row.choices.empty() ? value.empty() : std::ranges::find(row.choices, value) == row.choices.end())
      return bad(row.key, fmt::format("\"{}\" is not known; there are: {}", value,
                                      row.choices.empty() ? std::string{row.form}
                                                          : fmt::format("{}", fmt::join(row.choices, ", "))));
  }
  return {};
}

Result<void> read_value(const nlohmann::ordered_json& value, const SliceParameter& row, SliceParameters& into) {
  return std::visit(Overloaded{[&](SliceParameter::Number field) -> Result<void> {
                                 if (!value.is_number()) return bad(row.key, "must be a number");
                                 into.*field = value.get<double>();
                                 return {};
                               },
                               [&](SliceParameter::Flag field) -> Result<void> {
                                 if (!value.is_boolean()) return bad(row.key, "must be true or false");
                                 into.*field = value.get<bool>();
                                 return {};
                               },
                               [&](SliceParameter::Choice field) -> Result<void> {
                                 if (!value.is_string()) return bad(row.key, "must be a text");
                                 into.*field = value.get<std::string>();
                                 return {};
                               }},
                    row.field);
}

std::string_view type_of(const SliceParameter& row) {
  constexpr std::array<std::string_view, 3> kTypes{"number", "boolean", "string"};
  return kTypes[row.field.index()];
}

}  // namespace

std::span<const SliceParameter> slice_parameter_table() { return kTable; }

const SliceParameter* slice_parameter(std::string_view key) {
  const auto row = std::ranges::find(kTable, key, &SliceParameter::key);
  return row == kTable.end() ? nullptr : &*row;
}

std::string option_name(const SliceParameter& parameter) {
  std::string name = "--" + std::string{parameter.key};
  std::ranges::replace(name, '_', '-');
  return name;
}

std::string fleet_options_of(const SliceParameters& parameters) {
  std::vector<std::string> set;
  for (const SliceParameter& row : kTable)
    if (row.subject == Subject::Fleet && is_set(parameters, row)) set.push_back(option_name(row));
  return fmt::format("{}", fmt::join(set, ", "));
}

std::string text_of(const SliceParameter::Range& range) {
  if (range.is_whole) return fmt::format("a whole number of {} to {}", range.least, range.most);
  if (std::isinf(range.most)) return fmt::format("{} {}", range.is_least_in ? "at least" : "above", range.least);
  return range.is_least_in ? fmt::format("{} to {}", range.least, range.most)
                           : fmt::format("above {} and up to {}", range.least, range.most);
}

bool contains(const SliceParameter::Range& range, double value) {
  return std::isfinite(value) && (range.is_least_in ? value >= range.least : value > range.least) &&
         value <= range.most && (!range.is_whole || value == std::floor(value));
}

Result<void> validate(const SliceParameters& parameters) {
  for (const SliceParameter& row : kTable) {
    if (!is_set(parameters, row)) continue;
    if (auto ok = validate_value(parameters, row); !ok) return ok;
    for (const std::string_view other : row.not_with)
      if (!other.empty() && is_set(parameters, *slice_parameter(other)))
        return bad(row.key, fmt::format("cannot be stated together with {}", other));
  }
  return {};
}

std::string to_json(const SliceParameters& parameters) {
  Json object = Json::object();
  for (const SliceParameter& row : kTable)
    if (is_set(parameters, row))
      std::visit(Overloaded{[&](SliceParameter::Flag field) { object[row.key] = parameters.*field; },
                            [&](auto field) { object[row.key] = *(parameters.*field); }},
                 row.field);
  return json_text(object);
}

Result<SliceParameters> slice_parameters_from_json(std::string_view text) {
  const auto object = json_or_discarded(text);
  if (!object.is_object()) return fail(ErrorCode::InvalidInput, "the parameters of the job are not a JSON object");
  SliceParameters parameters;
  for (const auto& [key, value] : object.items()) {
    const SliceParameter* row = slice_parameter(key);
    if (!row) return bad(key, "is not known to this site");
    if (auto ok = read_value(value, *row, parameters); !ok) return tl::unexpected{ok.error()};
  }
  if (auto ok = validate(parameters); !ok) return tl::unexpected{ok.error()};
  return parameters;
}

std::string slice_parameter_list_json() {
  Json list = Json::array();
  for (const SliceParameter& row : kTable) {
    Json entry{{"key", row.key},
               {"type", type_of(row)},
               {"subject", kSubjects[static_cast<std::size_t>(row.subject)]},
               {"help", row.help}};
    if (!row.unit.empty()) entry["unit"] = row.unit;
    if (std::holds_alternative<SliceParameter::Number>(row.field)) entry["range"] = text_of(row.range);
    if (!row.choices.empty()) entry["choices"] = row.choices;
    if (!row.form.empty()) entry.update({{"form", row.form}, {"example", row.example}});
    if (!row.fallback.empty()) entry["default"] = row.fallback;
    list.push_back(std::move(entry));
  }
  return json_text(list);
}

std::string slice_parameter_schema_json() {
  Json properties = Json::object();
  for (const SliceParameter& row : kTable) {
    Json& schema = properties[row.key] = {{"type", type_of(row)}, {"description", row.help}};
    if (std::holds_alternative<SliceParameter::Number>(row.field)) {
      schema["minimum"] = row.range.least;
      if (!row.range.is_least_in) schema["exclusiveMinimum"] = true;
      if (!std::isinf(row.range.most)) schema["maximum"] = row.range.most;
    }
    if (!row.choices.empty()) schema["enum"] = row.choices;
    if (!row.example.empty()) schema["example"] = row.example;
    if (!row.fallback.empty()) schema["default"] = row.fallback;
  }
  return json_text({{"type", "object"}, {"additionalProperties", false}, {"properties", properties}});
}

}  // namespace telefab
