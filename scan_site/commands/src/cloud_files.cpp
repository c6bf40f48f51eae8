// SPDX-License-Identifier: GPL-3.0-or-later
#include "cloud_files.hpp"

#include <fmt/format.h>
#include <filesystem>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/slicing/orient_cloud.hpp>

namespace telefab::scan {

std::string name_of_file(const std::string& path) { return std::filesystem::path{path}.filename().string(); }

Result<PointCloud> load_cloud(const std::string& path, const std::string& unit, std::stop_token stop) {
  const auto bytes = read_file(path, kMaxScanFileBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto cloud = read_cloud(*bytes, name_of_file(path), {}, stop);
  if (!cloud) return cloud;
  for (const ScanNote& note : cloud->notes) write_note(fmt::format("note: {}: {}\n", name_of_file(path), note.text));
  if (!unit.empty()) {
    const auto stated = millimetres_per(unit);
    if (!stated) return tl::unexpected{stated.error()};
    cloud->unit_mm = *stated;
  }
  if (!cloud->unit_mm) return cloud;
  const double unit_mm = *cloud->unit_mm;
  PointCloud in_mm = scaled(std::move(*cloud), unit_mm);
  if (const auto warning = scale_warning(in_mm, unit_mm))
    write_note(fmt::format("note: {}: {}\n", name_of_file(path), *warning));
  return in_mm;
}

Result<PointCloud> load_oriented(const std::string& path, const std::string& unit, std::stop_token stop) {
  auto cloud = load_cloud(path, unit, stop);
  if (!cloud) return tl::unexpected{cloud.error()};
  auto oriented = orient_cloud(std::move(*cloud), stop);
  if (!oriented) return fail_in(name_of_file(path), oriented.error());
  const NormalReport& r = oriented->report;
  for (const std::string& warning : oriented->warnings)
    write_note(fmt::format("note: {}: {}\n", name_of_file(path), warning));
  if (r.estimated && r.neighbour_agreement < 0.98)
    write_note(
        fmt::format("note: {}: only {:.1f} % of neighbouring normals agree; the orientation is doubtful in places\n",
                    name_of_file(path), 100 * r.neighbour_agreement));
  return std::move(oriented->cloud);
}

}  // namespace telefab::scan
