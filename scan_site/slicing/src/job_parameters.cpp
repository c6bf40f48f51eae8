// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>

namespace telefab::scan {
namespace {

/// What the coding of curves has beyond the chords, in pixels: as much as with the chords of the default.
constexpr double kLeastRoom_px = CodecOptions{}.total_error_pitch - CodecOptions{}.chord_error_pitch;

/// Reads a word that may be left out by one of the parsers that own the words.
template <class Value, class Parse>
Result<void> take(const std::optional<std::string>& word, const Parse& parse, Value& into) {
  if (!word) return {};
  const auto value = parse(*word);
  if (!value) return tl::unexpected{value.error()};
  into = *value;
  return {};
}

Result<Coding> coding_from(std::string_view name) {
  if (name == "exact") return Coding::Exact;
  if (name == "curve") return Coding::Curve;
  return fail(ErrorCode::InvalidInput, "coding: exact and curve are known");
}

/// A direction, or what one shall be chosen for.
Result<void> read_up(const std::optional<std::string>& word, PlacementOptions& placement) {
  constexpr std::string_view kAuto = "auto";
  if (!word || !word->starts_with(kAuto)) return take(word, turn_from_up, placement.turn);
  const std::string_view goal = std::string_view{*word}.substr(kAuto.size());
  placement.stand_for = StandFor::Supports;
  if (goal.empty()) return {};
  if (goal[0] != ':') return fail(ErrorCode::InvalidInput, fmt::format("up: \"{}\" is not auto or auto:GOAL", *word));
  const auto chosen = stand_for_from(goal.substr(1));
  if (!chosen) return fail_in("up", chosen.error());
  placement.stand_for = *chosen;
  return {};
}

/// So many of the largest, or some by their numbers.
Result<void> read_pieces(const std::optional<std::string>& word, PickOptions& pick) {
  if (word && word->starts_with(kOnlyPieces)) return take(word, piece_numbers_from, pick.only);
  return take(word, pieces_from, pick.pieces);
}

Result<void> take_words(const SliceParameters& asked, SliceRequest& slice) {
  if (auto ok = take(asked.units, millimetres_per, slice.placement.unit_mm); !ok) return ok;
  if (auto ok = read_up(asked.up, slice.placement); !ok) return ok;
  if (auto ok = take(asked.rotate, turn_from_rotate, slice.placement.turn); !ok) return ok;
  if (auto ok = take(asked.mirror, mirror_axis_from, slice.placement.mirror); !ok) return ok;
  if (auto ok = take(asked.scale_axes, axis_scale_from, slice.placement.axis_scale); !ok) return ok;
  if (auto ok = take(asked.position, position_from, slice.placement.position_mm); !ok) return ok;
  if (auto ok = take(asked.method, trace_method_from, slice.method); !ok) return ok;
  if (auto ok = take(asked.surface, surface_kind_from, slice.mls.surface); !ok) return ok;
  if (auto ok = take(asked.crop, crop_box_from, slice.intake.pick.crop); !ok) return ok;
  if (auto ok = read_pieces(asked.pieces, slice.intake.pick); !ok) return ok;
  slice.intake.sample_faces = asked.sample_faces;
  if (asked.complete)
    if (auto ok = complete_gaps_as(*asked.complete, slice); !ok) return ok;
  return asked.base ? base_as(*asked.base, slice) : Result<void>{};
}

/// Chords and coding share one bound of the error, which is less than a pixel.
Result<void> share_error(const MachineProfile& machine, JobParameters& parameters) {
  auto& [slice, codec] = parameters;
  const double pitch_mm = machine.projection.pixel_pitch_mm;
  if (!slice.chord_mm) slice.chord_mm = codec.chord_error_pitch * pitch_mm;
  if (*slice.chord_mm >= pitch_mm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("parameter chord_mm: {} is not below {}'s pixel of {} mm; coded contours need that",
                            *slice.chord_mm, machine.name, pitch_mm));
  codec.chord_error_pitch = *slice.chord_mm / pitch_mm;
  codec.total_error_pitch = std::max(codec.total_error_pitch, codec.chord_error_pitch + kLeastRoom_px);
  return {};
}

}  // namespace

Result<JobParameters> job_parameters_of(const SliceParameters& asked, const MachineProfile& machine,
                                        Contours contours) {
  if (auto ok = validate(asked); !ok) return tl::unexpected{ok.error()};
  JobParameters parameters;
  SliceRequest& slice = parameters.slice;
  slice.machine = machine;
  slice.placement.height_mm = asked.height_mm;
  slice.placement.scale = asked.scale;
  slice.placement.fit = asked.fit;
  const auto& limits = machine.platform;
  if (asked.layer_mm &&
      (*asked.layer_mm < limits.least_layer_mm || (limits.most_layer_mm > 0 && *asked.layer_mm > limits.most_layer_mm)))
    return fail(ErrorCode::InvalidInput,
                fmt::format("parameter layer_mm: {} is beyond what {} prints, {} to {} mm", *asked.layer_mm,
                            machine.name, limits.least_layer_mm, limits.most_layer_mm));
  slice.thickness_mm = asked.thickness_mm;
  slice.layer_mm = asked.layer_mm;
  slice.chord_mm = asked.chord_mm;
  slice.speck_px2 = asked.speck_px2.value_or(slice.speck_px2);
  slice.mls.kernel_mm = asked.kernel_mm;
  slice.mls.drop_outliers = !asked.keep_outliers;
  if (auto ok = take_words(asked, slice); !ok) return tl::unexpected{ok.error()};
  if (auto ok = take(asked.coding, coding_from, parameters.codec.coding); !ok) return tl::unexpected{ok.error()};
  if (contours == Contours::Coded && parameters.codec.coding == Coding::Curve)
    if (auto ok = share_error(machine, parameters); !ok) return tl::unexpected{ok.error()};
  if (auto ok = slice.validate(); !ok) return tl::unexpected{ok.error()};
  if (auto ok = parameters.codec.validate(); !ok) return tl::unexpected{ok.error()};
  return parameters;
}

Result<JobParameters> job_parameters_from(std::string_view json, const MachineProfile& machine) {
  const auto asked = slice_parameters_from_json(json);
  if (!asked) return tl::unexpected{asked.error()};
  return job_parameters_of(*asked, machine);
}

Result<void> check_text(const SliceParameter& row, const std::string& text) {
  SliceParameters asked;
  asked.*std::get<SliceParameter::Choice>(row.field) = text;
  SliceRequest read;
  return take_words(asked, read);
}

}  // namespace telefab::scan
