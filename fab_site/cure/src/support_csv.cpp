// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <telefab/fab/cure/support_calibration.hpp>

#include "csv_table.hpp"

namespace telefab::fab {
namespace {

using Kind = SupportSpecimen::Kind;

constexpr std::array<std::string_view, 6> kColumns{"machine", "test", "number", "demand", "overhang_mm", "held"};
enum Column : std::size_t { kMachine, kTest, kNumber, kDemand, kOverhang, kHeld };
constexpr int kMostNumber = 100'000;
/// Figures in the table are rounded to six digits.
constexpr double kRounding = 1e-4;

/// InvalidInput where the table states another figure than the print of this profile has.
Result<void> agrees(const CsvLine& line, std::size_t column, double expected, const SupportSpecimen& s,
                    const MachineProfile& machine) {
  const auto value = line.number(column, 0, 1e9);
  if (!value) return tl::unexpected{value.error()};
  if (std::abs(*value - expected) <= kRounding * expected) return {};
  return line.refuse(fmt::format(
      "{} of number {} is {:g}; the print of machine {} as its profile is now has {:.6g}. Read the table with the "
      "profile that it was printed with",
      kColumns[column], s.number, *value, machine.name, expected));
}

Result<bool> yes_or_no(const CsvLine& line) {
  const std::string_view held = line.text(kHeld);
  if (held == "yes") return true;
  if (held == "no") return false;
  if (held.empty()) return line.refuse("held is empty; write yes or no, or delete the row");
  return line.refuse(fmt::format("held is \"{}\"; yes or no is possible", held.substr(0, 40)));
}

Result<SupportReading> read_row(const CsvLine& line, std::span<const SupportSpecimen> specimens,
                                const MachineProfile& machine) {
  if (line.text(kMachine) != machine.name)
    return line.refuse(fmt::format("machine is \"{}\", and the profile that was chosen is of {}",
                                   line.text(kMachine).substr(0, 80), machine.name));
  const auto number = line.whole(kNumber, kMostNumber);
  if (!number) return tl::unexpected{number.error()};
  const auto found =
      std::find_if(specimens.begin(), specimens.end(), [&](const SupportSpecimen& s) { return s.number == *number; });
  if (found == specimens.end())
    return line.refuse(fmt::format("there is no number {}; the print of machine {} has 1 to {}", *number, machine.name,
                                   specimens.size()));
  if (line.text(kTest) != name_of(found->kind))
    return line.refuse(fmt::format("test of number {} is \"{}\"; in the print of machine {} it is {}", *number,
                                   line.text(kTest).substr(0, 40), machine.name, name_of(found->kind)));
  const bool shelf = found->kind == Kind::Shelf;
  if (auto ok = agrees(line, shelf ? kOverhang : kDemand, shelf ? found->overhang_mm : found->demand, *found, machine);
      !ok)
    return tl::unexpected{ok.error()};
  const auto held = yes_or_no(line);
  if (!held) return tl::unexpected{held.error()};
  return SupportReading{*found, *held};
}

}  // namespace

Result<std::vector<SupportReading>> support_readings_from_csv(std::string_view text, const MachineProfile& machine) {
  const auto specimens = support_specimens(machine);
  if (!specimens) return tl::unexpected{specimens.error()};
  constexpr std::array<std::size_t, 6> needed{kMachine, kTest, kNumber, kDemand, kOverhang, kHeld};
  std::vector<SupportReading> readings;
  std::set<int> numbers;
  const auto take = [&](const CsvLine& line) -> Result<void> {
    const auto row = read_row(line, *specimens, machine);
    if (!row) return tl::unexpected{row.error()};
    if (!numbers.insert(row->specimen.number).second)
      return line.refuse(fmt::format("number {} was there before", row->specimen.number));
    readings.push_back(*row);
    return {};
  };
  if (auto ok = read_table(text, kColumns, needed, take); !ok) return tl::unexpected{ok.error()};
  return readings;
}

}  // namespace telefab::fab
