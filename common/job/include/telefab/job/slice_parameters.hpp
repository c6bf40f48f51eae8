// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <telefab/base/result.hpp>
#include <variant>

namespace telefab {

/// What somebody may ask of a job, of the slicing of its scan before all, as it stands on a command line and travels
/// with the job. What is not set is the sites' to choose. Which values are legal says slice_parameter_table().
struct SliceParameters {
  std::optional<std::string> resin;
  std::optional<std::string> print;
  std::optional<double> height_mm;
  std::optional<double> scale;
  bool fit = false;
  std::optional<std::string> units;
  std::optional<std::string> up;
  std::optional<std::string> rotate;
  std::optional<std::string> mirror;
  std::optional<std::string> scale_axes;
  std::optional<std::string> position;
  std::optional<std::string> crop;
  std::optional<std::string> pieces;
  bool sample_faces = false;
  std::optional<std::string> complete;
  std::optional<std::string> base;
  std::optional<double> thickness_mm;
  std::optional<double> layer_mm;
  std::optional<double> chord_mm;
  std::optional<double> speck_px2;
  std::optional<std::string> method;
  std::optional<std::string> surface;
  std::optional<double> kernel_mm;
  bool keep_outliers = false;
  std::optional<std::string> coding;
  std::optional<double> priority;
  std::optional<std::string> deadline;
  std::optional<double> copies;
  friend bool operator==(const SliceParameters&, const SliceParameters&) = default;
};

/// One row: everything that command lines, the JSON of a job, the page and the API have to know of a parameter. A new
/// one is a field above, a row in slice_parameters.cpp, and its use in scan_site/slicing/src/job_parameters.cpp.
struct SliceParameter {
  using Number = std::optional<double> SliceParameters::*;
  using Flag = bool SliceParameters::*;
  using Choice = std::optional<std::string> SliceParameters::*;
  struct Range {
    double least = 0;
    bool is_least_in = true;  ///< whether `least` itself is legal
    double most = std::numeric_limits<double>::infinity();
    bool is_whole = false;  ///< no fractions
  };

  std::string_view key;  ///< in JSON; the option is "--" and the key with dashes
  std::variant<Number, Flag, Choice> field;
  std::string_view help;                           ///< a phrase; what happens where it is left out, unless `fallback`
  std::string_view unit = {};                      ///< of a number, "mm"; empty: none
  Range range = {};                                ///< of a number
  std::span<const std::string_view> choices = {};  ///< of a choice: all there are; none: a text of that `form`
  std::string_view fallback = {};                  ///< of a choice: the one taken where it is left out
  std::string_view form = {};                      ///< of a text, "all | largest | N"; the scan site reads it
  std::string_view example = {};                   ///< of a text: a legal one that is not the fallback
  std::array<std::string_view, 2> not_with = {};   ///< keys it excludes, told at the later of the two rows
  /// What a row is about, and so who has to do with it.
  enum class Subject : std::uint8_t {
    Slicing,  ///< the layers
    Profile,  ///< chooses, with the machine, the profile that all else is read against; declared with the machine
    Fleet,    ///< when and how often a fleet prints it; refused where there is one fab
  };
  Subject subject = Subject::Slicing;
};

/// In the order in which they are shown.
[[nodiscard]] std::span<const SliceParameter> slice_parameter_table();
/// The row; nothing where there is no such key.
[[nodiscard]] const SliceParameter* slice_parameter(std::string_view key);
/// "--height-mm" of "height_mm".
[[nodiscard]] std::string option_name(const SliceParameter& parameter);
/// The options of a fleet that are set, "--priority, --copies", for people; empty: none is.
[[nodiscard]] std::string fleet_options_of(const SliceParameters& parameters);
/// "above 0", "0 to 1", ...
[[nodiscard]] std::string text_of(const SliceParameter::Range& range);
[[nodiscard]] bool contains(const SliceParameter::Range& range, double value);

/// Kinds, ranges, choices and what excludes what. InvalidInput names the key.
[[nodiscard]] Result<void> validate(const SliceParameters& parameters);

/// One object with what is set, in the order of the table. Reading fails with InvalidInput for a key that is not
/// known, another kind of value, and as validate does.
[[nodiscard]] std::string to_json(const SliceParameters& parameters);
[[nodiscard]] Result<SliceParameters> slice_parameters_from_json(std::string_view text);

/// The table for pages: [{"key":..,"type":"number|boolean|string","subject":"slicing|profile|fleet","unit":..,
/// "range":..,"choices":[..],"default":..,"help":..}]; and as a JSON Schema for the description of an API.
[[nodiscard]] std::string slice_parameter_list_json();
[[nodiscard]] std::string slice_parameter_schema_json();

}  // namespace telefab
