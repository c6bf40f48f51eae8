// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <telefab/fab/cure/size_calibration.hpp>

#include "csv_table.hpp"
#include "least_squares.hpp"

namespace telefab::fab {
namespace {

using Kind = MeasuredSize::Kind;

constexpr std::array<std::string_view, 4> kColumns{"test", "drawn_mm", "value", "unit"};
enum Column : std::size_t { kTest, kDrawn, kValue, kUnit };
constexpr std::array<std::string_view, 4> kKinds{"length-x", "length-y", "height", "hole"};
constexpr double kLargest_mm = 2000;
/// A reading farther than this share from what was drawn is of something else.
constexpr double kMostOff = 0.3;

std::string_view name_of(Kind kind) { return kKinds[static_cast<std::size_t>(kind) - 1]; }

Result<MeasuredSize> read_row(const CsvLine& line) {
  MeasuredSize row;
  const auto kind = std::find(kKinds.begin(), kKinds.end(), line.text(kTest));
  if (kind == kKinds.end())
    return line.refuse(
        fmt::format("unknown test \"{}\"; there are: {}", line.text(kTest).substr(0, 40), fmt::join(kKinds, ", ")));
  row.kind = static_cast<Kind>(kind - kKinds.begin() + 1);
  const std::string_view unit = line.text(kUnit);
  if (unit != "mm" && unit != "um")
    return line.refuse(fmt::format("unit is \"{}\"; mm or um is possible", unit.substr(0, 40)));
  const auto drawn = line.number(kDrawn, 0.01, kLargest_mm);
  if (!drawn) return tl::unexpected{drawn.error()};
  const auto value = line.number(kValue, 1e-3, kLargest_mm * 1000);
  if (!value) return tl::unexpected{value.error()};
  row.drawn_mm = *drawn;
  row.measured_mm = unit == "um" ? *value / 1000 : *value;
  if (std::abs(row.measured_mm - row.drawn_mm) > kMostOff * row.drawn_mm)
    return line.refuse(
        fmt::format("{} mm were measured where {} mm were drawn; look at the unit and at what was measured",
                    row.measured_mm, row.drawn_mm));
  return row;
}

/// Places of the parameters in the fit; -1: not in it.
struct Places {
  Eigen::Index x = -1, y = -1, z = -1, edge = -1, offset = -1, hole = -1, count = 0;
};

/// What the model says of a row. Shrinkage as a share.
double predicted(const MeasuredSize& row, const Eigen::VectorXd& p, const Places& at) {
  switch (row.kind) {
    case Kind::LengthX:
      return row.drawn_mm * (1 - p[at.x]) + 2 * p[at.edge];
    case Kind::LengthY:
      return row.drawn_mm * (1 - p[at.y]) + 2 * p[at.edge];
    case Kind::Height:
      return row.drawn_mm * (1 - p[at.z]) + p[at.offset];
    case Kind::Hole:
      return row.drawn_mm * (1 - (p[at.x] + p[at.y]) / 2) - 2 * p[at.hole];
  }
  return 0;
}

Result<Places> places_of(std::span<const MeasuredSize> rows) {
  Places at;
  const auto readings = [&](Kind kind) {
    return std::count_if(rows.begin(), rows.end(), [&](const MeasuredSize& r) { return r.kind == kind; });
  };
  for (const Kind kind : {Kind::LengthX, Kind::LengthY, Kind::Height}) {
    if (readings(kind) == 0) continue;
    std::set<double> lengths;
    for (const MeasuredSize& row : rows)
      if (row.kind == kind) lengths.insert(row.drawn_mm);
    if (readings(kind) < 3 || lengths.size() < 2)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("{}: {} readings of {} drawn lengths; at least 3 of 2 are needed", name_of(kind),
                              readings(kind), lengths.size()));
  }
  const bool has_x = readings(Kind::LengthX) > 0, has_y = readings(Kind::LengthY) > 0;
  if (readings(Kind::Hole) > 0 && !(has_x && has_y))
    return fail(ErrorCode::InvalidInput, "hole: holes shrink with lengths along x and y; measure those as well");
  if (has_x) at.x = at.count++;
  if (has_y) at.y = at.count++;
  if (has_x || has_y) at.edge = at.count++;
  if (readings(Kind::Height) > 0) at.z = at.count++, at.offset = at.count++;
  if (readings(Kind::Hole) > 0) at.hole = at.count++;
  return at;
}

Result<void> in_range(std::string_view name, const std::optional<FittedFigure>& figure, double least, double most) {
  if (!figure || (std::isfinite(figure->value) && figure->value >= least && figure->value <= most)) return {};
  return fail(ErrorCode::InvalidInput,
              fmt::format("the fitted {} is {:.4g}; a profile holds {} to {}. Look at units and "
                          "at what was measured",
                          name, figure->value, least, most));
}

}  // namespace

Result<std::vector<MeasuredSize>> sizes_from_csv(std::string_view text) {
  constexpr std::array<std::size_t, 4> needed{kTest, kDrawn, kValue, kUnit};
  std::vector<MeasuredSize> rows;
  const auto take = [&](const CsvLine& line) -> Result<void> {
    const auto row = read_row(line);
    if (!row) return tl::unexpected{row.error()};
    rows.push_back(*row);
    return {};
  };
  if (auto ok = read_table(text, kColumns, needed, take); !ok) return tl::unexpected{ok.error()};
  return rows;
}

Result<SizeCalibration> fit_sizes(std::span<const MeasuredSize> rows) {
  if (rows.empty()) return fail(ErrorCode::InvalidInput, "there is no measurement in it");
  const auto at = places_of(rows);
  if (!at) return tl::unexpected{at.error()};
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto residuals = [&](const Eigen::VectorXd& p) {
    Eigen::VectorXd off(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const MeasuredSize& row = rows[static_cast<std::size_t>(i)];
      off[i] = predicted(row, p, *at) - row.measured_mm;
    }
    return off;
  };
  const auto fit = least_squares(residuals, Eigen::VectorXd::Zero(at->count));
  if (!fit) return fail(ErrorCode::InvalidInput, "no shrinkage fits these lengths; measure again, and more of them");
  SizeCalibration out;
  out.rms_mm = fit->rms;
  const auto percent = [&](Eigen::Index i) -> std::optional<FittedFigure> {
    if (i < 0) return std::nullopt;
    const FittedFigure f = fit->figure(i);
    return FittedFigure{100 * f.value, 100 * f.least, 100 * f.most};
  };
  const auto plain = [&](Eigen::Index i) -> std::optional<FittedFigure> {
    return i < 0 ? std::nullopt : std::optional{fit->figure(i)};
  };
  out.shrink_x_percent = percent(at->x);
  out.shrink_y_percent = percent(at->y);
  out.shrink_z_percent = percent(at->z);
  out.edge_mm = plain(at->edge);
  out.height_offset_mm = plain(at->offset);
  out.hole_growth_mm = plain(at->hole);
  for (const auto& [name, figure] : {std::pair{"shrinkage along x (%)", out.shrink_x_percent},
                                     {"shrinkage along y (%)", out.shrink_y_percent},
                                     {"shrinkage along z (%)", out.shrink_z_percent}})
    if (auto ok = in_range(name, figure, -5, 10); !ok) return tl::unexpected{ok.error()};
  if (auto ok = in_range("growth of holes (mm)", out.hole_growth_mm, -1, 1); !ok) return tl::unexpected{ok.error()};
  return out;
}

std::string to_toml_fragment(const SizeCalibration& c) {
  const auto interval = [](const FittedFigure& f) { return fmt::format("95 %: {:.4f} to {:.4f}", f.least, f.most); };
  const auto line = [&](std::string_view key, const std::optional<FittedFigure>& f) {
    return f ? fmt::format("{} = {:.4f}  # {}\n", key, f->value, interval(*f)) : std::string{};
  };
  std::string text = fmt::format("# Readings miss the fit by {:.1f} um rms.\n[resin]\n", 1000 * c.rms_mm);
  text += line("shrink_x_percent", c.shrink_x_percent) + line("shrink_y_percent", c.shrink_y_percent) +
          line("shrink_z_percent", c.shrink_z_percent) + line("hole_growth_mm", c.hole_growth_mm);
  if (c.edge_mm)
    text += fmt::format(
        "# Edges lie {:.4f} mm outside where they were drawn ({}). No key makes it good: where it is not "
        "about 0,\n# calibrate light and resin again (`calibrate fit`).\n",
        c.edge_mm->value, interval(*c.edge_mm));
  if (c.height_offset_mm)
    text += fmt::format(
        "# Heights are {:.4f} mm more than they shrink to ({}): first layers that are pressed, or too deep "
        "an underside.\n",
        c.height_offset_mm->value, interval(*c.height_offset_mm));
  return text;
}

MachineProfile with_sizes(MachineProfile machine, const SizeCalibration& c) {
  if (c.shrink_x_percent) machine.resin.shrink_x_percent = c.shrink_x_percent->value;
  if (c.shrink_y_percent) machine.resin.shrink_y_percent = c.shrink_y_percent->value;
  if (c.shrink_z_percent) machine.resin.shrink_z_percent = c.shrink_z_percent->value;
  if (c.hole_growth_mm) machine.resin.hole_growth_mm = c.hole_growth_mm->value;
  return machine;
}

}  // namespace telefab::fab
