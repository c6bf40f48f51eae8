// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <telefab/fab/cure/calibration.hpp>

#include "least_squares.hpp"

namespace telefab::fab {
namespace {

using Test = MeasuredRow::Test;

/// A power that misses the wedge by more than this share of white gives way to the measured curve.
constexpr double kPowerFits = 0.01;
/// Readings may scatter; beyond this the darker reading above white is a mistake.
constexpr double kBrighterThanWhite = 1.03;

tl::unexpected<Error> refuse(std::string_view test, const std::string& what) {
  return fail(ErrorCode::InvalidInput, fmt::format("{}: {}", test, what));
}

Result<void> in_range(std::string_view test, std::string_view name, double value, double least, double most) {
  if (std::isfinite(value) && value >= least && value <= most) return {};
  return refuse(test, fmt::format("the fitted {} is {:.4g}; a profile holds {} to {}. Look at units and settings", name,
                                  value, least, most));
}

std::vector<MeasuredRow> of(std::span<const MeasuredRow> rows, Test test) {
  std::vector<MeasuredRow> found;
  std::copy_if(rows.begin(), rows.end(), std::back_inserter(found), [&](const auto& r) { return r.test == test; });
  return found;
}

Result<void> same_unit(std::string_view test, std::span<const MeasuredRow> rows) {
  for (const MeasuredRow& row : rows)
    if (row.absolute != rows.front().absolute) return refuse(test, "readings in mW/cm2 and in shares are mixed");
  return {};
}

/// Means that never fall (pool adjacent violators), equal weights by count.
std::vector<double> never_falling(const std::vector<double>& means, const std::vector<double>& counts) {
  struct Pool {
    double sum, count;
    std::size_t members;
  };
  std::vector<Pool> pools;
  for (std::size_t i = 0; i < means.size(); ++i) {
    pools.push_back({means[i] * counts[i], counts[i], 1});
    while (pools.size() > 1 &&
           pools[pools.size() - 2].sum / pools[pools.size() - 2].count >= pools.back().sum / pools.back().count) {
      const Pool last = pools.back();
      pools.pop_back();
      pools.back().sum += last.sum;
      pools.back().count += last.count;
      pools.back().members += last.members;
    }
  }
  std::vector<double> values;
  for (const Pool& pool : pools) values.insert(values.end(), pool.members, pool.sum / pool.count);
  return values;
}

/// The curve at equally spaced greys: as few as hold every measured grey.
std::vector<double> curve_of(const std::map<double, std::pair<double, double>>& sums, double leak, double white) {
  std::vector<double> greys, means, counts;
  for (const auto& [grey, sum] : sums) {
    greys.push_back(grey);
    means.push_back((sum.first / sum.second / white - leak) / (1 - leak));
    counts.push_back(sum.second);
  }
  std::vector<double> values = never_falling(means, counts);
  for (double& value : values) value = std::clamp(value, 0.0, 1.0);
  std::size_t count = 256;
  for (const std::size_t candidate : {std::size_t{16}, std::size_t{18}, std::size_t{52}}) {
    const double step = 255.0 / static_cast<double>(candidate - 1);
    const bool holds = std::all_of(greys.begin(), greys.end(),
                                   [&](double g) { return std::abs(g / step - std::round(g / step)) < 1e-9; });
    if (holds) {
      count = candidate;
      break;
    }
  }
  std::vector<double> curve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double grey = 255.0 * static_cast<double>(i) / static_cast<double>(count - 1);
    const auto above = std::lower_bound(greys.begin(), greys.end(), grey);
    const auto k = static_cast<std::size_t>(above - greys.begin());
    if (k == 0)
      curve[i] = values[0];
    else if (k == greys.size())
      curve[i] = values.back();
    else
      curve[i] = std::lerp(values[k - 1], values[k], (grey - greys[k - 1]) / (greys[k] - greys[k - 1]));
    curve[i] = std::round(curve[i] * 1e5) / 1e5;
  }
  curve.front() = 0;
  curve.back() = 1;
  return curve;
}

Result<void> fit_wedge(std::span<const MeasuredRow> rows, Calibration& out) {
  constexpr std::string_view test = "wedge";
  if (auto ok = same_unit(test, rows); !ok) return ok;
  std::map<double, std::pair<double, double>> sums;  // by grey: sum, count
  for (const MeasuredRow& row : rows) {
    sums[row.grey].first += row.value;
    ++sums[row.grey].second;
  }
  if (sums.size() < 5) return refuse(test, fmt::format("{} different greys; at least 5 are needed", sums.size()));
  if (!sums.contains(255)) return refuse(test, "grey 255 was not measured; nothing says what white is");
  if (!sums.contains(0)) return refuse(test, "grey 0 was not measured; nothing says what leaks");
  const double white = sums[255].first / sums[255].second;
  for (const auto& [grey, sum] : sums)
    if (sum.first / sum.second > kBrighterThanWhite * white)
      return refuse(test, fmt::format("grey {} is brighter than grey 255; are the columns swapped?", grey));
  if (!(white > 0)) return refuse(test, "grey 255 gives no light");
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto residuals = [&](const Eigen::VectorXd& p) {
    Eigen::VectorXd off(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const MeasuredRow& row = rows[static_cast<std::size_t>(i)];
      const double h = row.grey > 0 ? std::pow(row.grey / 255, p[1]) : 0;
      off[i] = p[0] * (p[2] + (1 - p[2]) * h) - row.value;
    }
    return off;
  };
  const double leak = sums[0].first / sums[0].second / white;
  if (leak > 0.5) return refuse(test, "black is more than half as bright as white; is the unit the same in all rows?");
  const auto fit = least_squares(residuals, Eigen::Vector3d{white, 1.5, leak});
  if (fit) out.wedge_rms = fit->rms / fit->parameters[0];
  if (fit && out.wedge_rms <= kPowerFits) {
    out.gamma = fit->figure(1);
    out.leak = fit->figure(2);
    if (rows.front().absolute) out.irradiance_mw_per_cm2 = fit->figure(0);
    if (auto ok = in_range(test, "gamma", out.gamma->value, 0.3, 4); !ok) return ok;
  } else {
    out.curve = curve_of(sums, leak, white);
    out.leak = FittedFigure{leak, leak, leak};
    if (rows.front().absolute) out.irradiance_mw_per_cm2 = FittedFigure{white, white, white};
  }
  // Scatter may put a dark black a little below nothing.
  if (out.leak->value < 0 && out.leak->most >= 0) out.leak->value = 0;
  out.leak->least = std::max(0.0, out.leak->least);
  return in_range(test, "leak", out.leak->value, 0, 0.1);
}

Result<void> fit_field(std::span<const MeasuredRow> rows, Calibration& out) {
  constexpr std::string_view test = "field";
  if (auto ok = same_unit(test, rows); !ok) return ok;
  int last_row = 0, last_column = 0;
  std::map<std::pair<int, int>, std::pair<double, double>> cells;
  for (const MeasuredRow& row : rows) {
    last_row = std::max(last_row, row.row);
    last_column = std::max(last_column, row.column);
    cells[{row.row, row.column}].first += row.value;
    ++cells[{row.row, row.column}].second;
  }
  if (cells.size() < 4) return refuse(test, fmt::format("{} cells; at least 4 are needed", cells.size()));
  double most = 0;
  for (int r = 0; r <= last_row; ++r)
    for (int c = 0; c <= last_column; ++c) {
      const auto cell = cells.find({r, c});
      if (cell == cells.end()) return refuse(test, fmt::format("row {}, column {} was not measured", r, c));
      most = std::max(most, cell->second.first / cell->second.second);
    }
  if (!(most > 0)) return refuse(test, "no cell gives light");
  out.field.assign(static_cast<std::size_t>(last_row + 1),
                   std::vector<double>(static_cast<std::size_t>(last_column + 1)));
  for (const auto& [place, sum] : cells) {
    const double share = std::round(sum.first / sum.second / most * 1e4) / 1e4;
    if (auto ok = in_range(test, fmt::format("share of row {}, column {}", place.first, place.second), share, 0.05, 1);
        !ok)
      return ok;
    out.field[static_cast<std::size_t>(place.first)][static_cast<std::size_t>(place.second)] = share;
  }
  // The field is told as share of its brightest cell, so the irradiance is that cell's.
  if (rows.front().absolute) out.irradiance_mw_per_cm2 = FittedFigure{most, most, most};
  return {};
}

Result<void> fit_lines(std::span<const MeasuredRow> rows, Calibration& out) {
  constexpr std::string_view test = "lines";
  std::set<double> periods;
  for (const MeasuredRow& row : rows) periods.insert(row.period_px);
  if (rows.size() < 3 || periods.size() < 2)
    return refuse(test,
                  fmt::format("{} readings of {} periods; at least 3 of 2 are needed", rows.size(), periods.size()));
  const double leak = out.leak ? out.leak->value : 0;
  for (const MeasuredRow& row : rows)
    if (row.value > line_contrast(row.period_px, 0.05, leak) + 0.05)
      return refuse(test, fmt::format("a contrast of {} at a period of {} px is above that of perfectly sharp lines",
                                      row.value, row.period_px));
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto residuals = [&](const Eigen::VectorXd& p) {
    Eigen::VectorXd off(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const MeasuredRow& row = rows[static_cast<std::size_t>(i)];
      off[i] = line_contrast(row.period_px, std::abs(p[0]), leak) - row.value;
    }
    return off;
  };
  double best = 0.05, best_off = 1e300;
  for (double spread = 0.05; spread <= 5; spread *= 1.05)
    if (const double off = residuals(Eigen::VectorXd::Constant(1, spread)).squaredNorm(); off < best_off) {
      best_off = off;
      best = spread;
    }
  const auto fit = least_squares(residuals, Eigen::VectorXd::Constant(1, best));
  if (!fit) return refuse(test, "these periods do not tell the spread; measure finer or wider line pairs");
  const FittedFigure spread = fit->figure(0);
  if (spread.most - spread.least > spread.value)
    return refuse(test,
                  fmt::format("the spread lies between {:.2f} and {:.2f} px: the readings scatter too much, or these "
                              "periods do not tell it",
                              spread.least, spread.most));
  out.spread_px = spread;
  return in_range(test, "spread", spread.value, 0.05, 5);
}

Result<void> fit_depth(std::span<const MeasuredRow> rows, double irradiance, Calibration& out) {
  constexpr std::string_view test = "depth";
  std::set<double> exposures;
  for (const MeasuredRow& row : rows) exposures.insert(row.exposure_s);
  if (rows.size() < 4 || exposures.size() < 3)
    return refuse(
        test, fmt::format("{} readings of {} exposures; at least 4 of 3 are needed", rows.size(), exposures.size()));
  if (!(irradiance > 0))
    return refuse(test, "no irradiance is known; measure the wedge in mW/cm2 or give --irradiance");
  // depth = Dp ln(E / Ec), in the parameters Dp and ln Ec.
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto residuals = [&](const Eigen::VectorXd& p) {
    Eigen::VectorXd off(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const MeasuredRow& row = rows[static_cast<std::size_t>(i)];
      off[i] = p[0] * (std::log(irradiance * row.exposure_s) - p[1]) - row.value;
    }
    return off;
  };
  double mean_x = 0, mean_y = 0, xx = 0, xy = 0, yy = 0;
  for (const MeasuredRow& row : rows) {
    mean_x += std::log(irradiance * row.exposure_s) / static_cast<double>(n);
    mean_y += row.value / static_cast<double>(n);
  }
  for (const MeasuredRow& row : rows) {
    const double x = std::log(irradiance * row.exposure_s) - mean_x, y = row.value - mean_y;
    xx += x * x;
    xy += x * y;
    yy += y * y;
  }
  if (!(xy > 0)) return refuse(test, "depth does not grow with exposure; are the columns swapped?");
  if (xy * xy < 0.8 * xx * yy)
    return refuse(test, "depths do not lie on a line over the logarithm of exposure (r2 below 0.8); measure again");
  const double slope = xy / xx;
  const auto fit = least_squares(residuals, Eigen::Vector2d{slope, mean_x - mean_y / slope});
  if (!fit) return refuse(test, "no resin fits these depths; measure again");
  out.penetration_mm = fit->figure(0);
  const FittedFigure log_dose = fit->figure(1);
  out.critical_dose_mj_per_cm2 =
      FittedFigure{std::exp(log_dose.value), std::exp(log_dose.least), std::exp(log_dose.most)};
  const double errors = std::sqrt(fit->covariance(0, 0) * fit->covariance(1, 1));
  out.calibration_correlation = errors > 0 ? std::clamp(fit->covariance(0, 1) / errors, -1.0, 1.0) : 0;
  out.depth_rms_mm = fit->rms;
  if (auto ok = in_range(test, "penetration (Dp, mm)", out.penetration_mm->value, 0.001, 10); !ok) return ok;
  return in_range(test, "critical dose (Ec, mJ/cm2)", out.critical_dose_mj_per_cm2->value, 0.01, 10000);
}

}  // namespace

double line_contrast(double period_px, double spread_px, double leak) {
  const double lit = std::floor(period_px / 2);
  const auto phi = [&](double x) { return std::erfc(-x / (spread_px * std::sqrt(2.0))) / 2; };
  const auto light = [&](double x) {
    double sum = 0;
    const int reach = static_cast<int>(8 * spread_px / period_px) + 2;
    for (int m = -reach; m <= reach; ++m) sum += phi(x - m * period_px) - phi(x - m * period_px - lit);
    return leak + (1 - leak) * sum;
  };
  const double most = light(lit / 2), least = light((lit + period_px) / 2);
  return (most - least) / (most + least);
}

Result<Calibration> fit_calibration(std::span<const MeasuredRow> rows, double irradiance_mw_per_cm2) {
  Calibration out;
  if (const auto wedge = of(rows, Test::Wedge); !wedge.empty())
    if (auto ok = fit_wedge(wedge, out); !ok) return tl::unexpected{ok.error()};
  if (const auto field = of(rows, Test::Field); !field.empty())
    if (auto ok = fit_field(field, out); !ok) return tl::unexpected{ok.error()};
  if (out.irradiance_mw_per_cm2)
    if (auto ok = in_range("wedge and field", "irradiance (mW/cm2)", out.irradiance_mw_per_cm2->value, 0.01, 1000); !ok)
      return tl::unexpected{ok.error()};
  if (const auto lines = of(rows, Test::Lines); !lines.empty())
    if (auto ok = fit_lines(lines, out); !ok) return tl::unexpected{ok.error()};
  const double irradiance = out.irradiance_mw_per_cm2 ? out.irradiance_mw_per_cm2->value : irradiance_mw_per_cm2;
  if (const auto depth = of(rows, Test::Depth); !depth.empty())
    if (auto ok = fit_depth(depth, irradiance, out); !ok) return tl::unexpected{ok.error()};
  return out;
}

MachineProfile calibrated(MachineProfile machine, const Calibration& c) {
  auto& projection = machine.projection;
  if (c.irradiance_mw_per_cm2) projection.irradiance_mw_per_cm2 = c.irradiance_mw_per_cm2->value;
  if (c.gamma) {
    projection.gamma = c.gamma->value;
    projection.curve.clear();
  }
  if (!c.curve.empty()) projection.curve = c.curve;
  if (c.leak) projection.leak = c.leak->value;
  if (!c.field.empty()) projection.field = c.field;
  if (c.spread_px) projection.spread_px = c.spread_px->value;
  auto& resin = machine.resin;
  if (const auto& dose = c.critical_dose_mj_per_cm2) {
    resin.critical_dose_mj_per_cm2 = dose->value;
    resin.critical_dose_least_mj_per_cm2 = dose->least;
    resin.critical_dose_most_mj_per_cm2 = dose->most;
  }
  if (const auto& depth = c.penetration_mm) {
    resin.penetration_mm = depth->value;
    resin.penetration_least_mm = depth->least;
    resin.penetration_most_mm = depth->most;
    resin.calibration_correlation = c.calibration_correlation;
  }
  const auto measure = [&](bool is_measured, std::string_view key) {
    if (is_measured) std::erase(machine.assumed, key);
  };
  measure(c.irradiance_mw_per_cm2.has_value(), "projection.irradiance_mw_per_cm2");
  measure(c.gamma.has_value(), "projection.gamma");
  measure(!c.curve.empty(), "projection.curve");
  measure(c.leak.has_value(), "projection.leak");
  measure(!c.field.empty(), "projection.field");
  measure(c.spread_px.has_value(), "projection.spread_px");
  measure(c.critical_dose_mj_per_cm2.has_value(), "resin.critical_dose_mj_per_cm2");
  measure(c.penetration_mm.has_value(), "resin.penetration_mm");
  return machine;
}

std::string to_toml_fragment(const Calibration& c) {
  const auto line = [](std::string_view key, const std::optional<FittedFigure>& f) {
    if (!f) return std::string{};
    const std::string interval =
        f->least < f->most ? fmt::format("  # 95 %: {:.4g} to {:.4g}", f->least, f->most) : "  # as measured";
    return fmt::format("{} = {:#.6g}{}\n", key, f->value, interval);
  };
  std::string projection = line("spread_px", c.spread_px) + line("gamma", c.gamma);
  if (!c.curve.empty())
    projection += fmt::format(
        "# A power misses the wedge by {:.1f} % of white: the measured curve stands instead.\n"
        "curve = [{:#.5g}]\n",
        100 * c.wedge_rms, fmt::join(c.curve, ", "));
  projection += line("leak", c.leak);
  if (!c.field.empty()) {
    projection += "field = [\n";
    for (const auto& row : c.field) projection += fmt::format("  [{:#.4g}],\n", fmt::join(row, ", "));
    projection += "]\n";
  }
  projection += line("irradiance_mw_per_cm2", c.irradiance_mw_per_cm2);
  std::string resin =
      line("critical_dose_mj_per_cm2", c.critical_dose_mj_per_cm2) + line("penetration_mm", c.penetration_mm);
  if (const auto& dose = c.critical_dose_mj_per_cm2, &depth = c.penetration_mm; dose && depth)
    resin += fmt::format(
        "critical_dose_least_mj_per_cm2 = {:#.6g}\ncritical_dose_most_mj_per_cm2 = {:#.6g}\n"
        "penetration_least_mm = {:#.6g}\npenetration_most_mm = {:#.6g}\ncalibration_correlation = {:#.4g}\n",
        dose->least, dose->most, depth->least, depth->most, c.calibration_correlation);
  std::string text;
  if (!projection.empty()) text += "[projection]\n" + projection;
  if (!resin.empty()) text += (text.empty() ? "" : "\n") + std::string{"[resin]\n"} + resin;
  return text;
}

}  // namespace telefab::fab
