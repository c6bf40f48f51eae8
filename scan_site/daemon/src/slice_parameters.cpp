// SPDX-License-Identifier: GPL-3.0-or-later
#include "slice_parameters.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <telefab/scan/cloud/units.hpp>

namespace telefab::scan {
namespace {

using Json = nlohmann::json;

tl::unexpected<Error> bad(std::string_view key, std::string_view claim) {
  return fail(ErrorCode::InvalidInput, fmt::format("parameter {}: {}", key, claim));
}

}  // namespace

Result<JobParameters> job_parameters_from(std::string_view json, const MachineProfile& machine) {
  const Json object = Json::parse(json, nullptr, false);
  if (!object.is_object()) return fail(ErrorCode::InvalidInput, "the parameters of the job are no JSON object");
  JobParameters parameters;
  SliceRequest& slice = parameters.slice;
  slice.machine = machine;
  for (const auto& [key, value] : object.items()) {
    if (key == "height_mm" || key == "scale" || key == "layer_mm" || key == "bridge_mm") {
      if (!value.is_number()) return bad(key, "must be a number");
      auto& field = key == "height_mm"  ? slice.height_mm
                    : key == "scale"    ? slice.scale
                    : key == "layer_mm" ? slice.layer_mm
                                        : slice.bridge_mm;
      field = value.get<double>();
    } else if (key == "fit" || key == "close_base") {
      if (!value.is_boolean()) return bad(key, "must be true or false");
      (key == "fit" ? slice.fit : slice.close_base) = value.get<bool>();
    } else if (key == "method" || key == "surface" || key == "coding" || key == "up" || key == "units") {
      if (!value.is_string()) return bad(key, "must be a text");
      const auto text = value.get<std::string>();
      if (key == "method") {
        const auto method = trace_method_from(text);
        if (!method) return tl::unexpected{method.error()};
        slice.method = *method;
      } else if (key == "surface") {
        const auto surface = surface_kind_from(text);
        if (!surface) return tl::unexpected{surface.error()};
        slice.mls.surface = *surface;
      } else if (key == "up") {
        const auto up = up_axis_from(text);
        if (!up) return tl::unexpected{up.error()};
        slice.up = *up;
      } else if (key == "units") {
        const auto unit = millimetres_per(text);
        if (!unit) return bad(key, unit.error().what);
        slice.unit_mm = *unit;
      } else if (text == "exact") {
        parameters.codec.coding = Coding::Exact;
      } else if (text == "curve") {
        parameters.codec.coding = Coding::Curve;
      } else {
        return bad(key, fmt::format("this site does not know the coding \"{}\"", text));
      }
    } else {
      return bad(key, "is not known to this site");
    }
  }
  // A curve is coded within what the chords leave of the whole error, so its chords are short.
  if (parameters.codec.coding == Coding::Curve)
    slice.chord_mm = parameters.codec.chord_error_pitch * machine.projection.pixel_pitch_mm;
  if (auto valid = slice.validate(); !valid) return tl::unexpected{valid.error()};
  if (auto valid = parameters.codec.validate(); !valid) return tl::unexpected{valid.error()};
  return parameters;
}

}  // namespace telefab::scan
