// SPDX-License-Identifier: GPL-3.0-or-later
// Bodies known by formula, scanned as scanners do and worse, sliced, and every layer counted against the body. A row a
// kind; each certified layer that is wrong is named. Run by hand; a small form runs as property.slicing.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <map>

#include "synthetic_scan.hpp"

namespace telefab::campaign {
namespace {

struct Row {
  SyntheticVerdict sum;
  int cases = 0, refused = 0;
};

void print(const std::string& name, const Row& row) {
  const auto& v = row.sum;
  const int right = v.right_certified + v.right_flagged;
  fmt::print("{:20} {:5} {:7} {:7} {:7} {:7} {:7} {:6.1f} % {:7.1f} {:6.1f}\n", name, row.cases, row.refused,
             v.right_certified, v.wrong_certified, v.right_flagged, v.wrong_flagged,
             right > 0 ? 100.0 * v.right_certified / right : 100.0, v.seconds, v.worst_over_median);
}

int run(const std::string& only, bool each) {
  std::map<std::string, Row> rows;
  for (const SyntheticScan& scan : synthetic_scans()) {
    if (scan.kind.find(only) == std::string::npos) continue;
    Row& row = rows[scan.kind];
    ++row.cases;
    const auto verdict = judge(scan);
    if (!verdict) {
      ++row.refused;
      fmt::print("{}, {}: refused: {}\n", scan.kind, scan.name, verdict.error().what);
      continue;
    }
    for (const std::string& line : verdict->lines) fmt::print("{}, {}: {}\n", scan.kind, scan.name, line);
    if (each)
      fmt::print("{}, {}: right {} certified {} flagged, wrong {} certified {} flagged\n", scan.kind, scan.name,
                 verdict->right_certified, verdict->right_flagged, verdict->wrong_certified, verdict->wrong_flagged);
    row.sum += *verdict;
    std::fflush(stdout);
  }
  Row all;
  fmt::print("{:20} {:>5} {:>7} {:>7} {:>7} {:>7} {:>7} {:>8} {:>7} {:>6}\n", "", "cases", "refused", "cert ok",
             "cert BAD", "flag ok", "flag bad", "ok cert", "s", "worst");
  for (const auto& [kind, row] : rows) {
    print(kind, row);
    all.sum += row.sum;
    all.cases += row.cases;
    all.refused += row.refused;
  }
  print("all", all);
  return all.sum.wrong_certified == 0 ? 0 : 8;
}

}  // namespace
}  // namespace telefab::campaign

int main(int argc, char** argv) {
  std::string only;
  bool each = false;
  CLI::App options{"Slices scans of bodies known by formula and counts every layer against the body."};
  options.add_option("--only", only, "part of a kind's name");
  options.add_flag("--each", each, "also print every case");
  CLI11_PARSE(options, argc, argv);
  return telefab::campaign::run(only, each);
}
