// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/progress.hpp>
#include <telefab/base/result.hpp>
#include <telefab/image/png.hpp>
#include <telefab/machine/machine_profile.hpp>
#include <telefab/scan/mls/mls_field.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/scan/topology/height_topology.hpp>
#include <vector>

namespace telefab::scan {

/// What to look at. With a machine the scan stands where it would be sliced; without one it is centred on x = y = 0.
struct InspectRequest {
  IntakeOptions intake;  ///< which points are the object
  std::optional<MachineProfile> machine;
  PlacementOptions placement;  ///< a fit needs a machine
  MlsOptions mls;
};

/// The surface and what the height does on it.
struct Inspection {
  std::string scan_name;
  std::size_t points = 0;
  KernelChoice kernel;
  std::string surface;
  Vec3 size_mm = Vec3::Zero();
  PlacementOptions placement;            ///< as it was placed
  std::optional<ChosenStanding> chosen;  ///< where its turn was chosen here
  PickReport pick;                       ///< what was left out before the size was taken
  std::vector<std::string> warnings;     ///< about the file, what was left out and the size, for people
  std::string normals_json;
  std::vector<Vec3> samples;  ///< that carry the surface, build frame
  std::vector<Vec3> normals;  ///< one a sample, unit, outward
  HeightTopology topology;
  std::vector<StageTime> times;
};

/// Reads, places and analyses a scan as slice_scan does before it cuts. Fails as slice_scan does.
[[nodiscard]] Result<Inspection> inspect_scan(std::span<const std::byte> scan, std::string_view name,
                                              const InspectRequest& request, const ProgressSink& progress,
                                              std::stop_token stop);

/// One JSON object, fixed key order: kernel, critical points, plateaus, graph, components, inconsistencies, times.
[[nodiscard]] std::string to_json(const Inspection& inspection);

/// Two views from a little above. Upper row: the shaded cloud with critical points and the Morse-Smale complex; lower
/// row: the enhanced Reeb graph on the surface (paper figures 5 and 18). What lies behind is drawn paler; critical
/// points that are noise are small and grey. RGB, 1600 x 1600 pixels and its frame.
[[nodiscard]] Image draw_inspection(const Inspection& inspection);

/// For a viewer: samples (grey), integral lines, arcs and critical points as coloured points; binary little-endian
/// PLY with normals (zero on lines).
[[nodiscard]] std::string to_ply(const Inspection& inspection);
/// Critical points, integral lines and Reeb arcs as VTK XML PolyData, with kind, persistence and component as arrays.
[[nodiscard]] std::string to_vtp(const Inspection& inspection);

}  // namespace telefab::scan
