// SPDX-License-Identifier: GPL-3.0-or-later
#include "guide.hpp"

#include <fmt/format.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <sstream>

namespace telefab::test {
namespace {

/// What somebody with a power meter, a calliper and a good lamp writes into the tables.
constexpr std::string_view kFillIn = R"(
fill_in() {
  awk -F, -v OFS=, '
    NR == 1 { for (i = 1; i <= NF; ++i) column[$i] = i; print; next }
    $1 == "wedge" { $7 = 3 * $2 / 255 }
    $1 == "field" { $7 = 3 }
    $1 == "lines" { $7 = exp(-(2.2 / $5) ^ 2) }
    $1 == "depth" { $7 = 0.12 * log(3 * $6 / 2.5) }
    $1 ~ /^length|^height/ { $3 = $2 * 0.99 }
    $1 == "hole" { $3 = $2 - 0.15 }
    column["held"] { $6 = ($4 != "" && $4 < 300) || ($4 == "" && $5 < 0.3) ? "yes" : "no" }
    { print }' "$1" > "$1.filled"
  mv "$1.filled" "$1"
}
)";

/// Daemons end with the script.
constexpr std::string_view kBegin = R"(set -eo pipefail
trap 'kill $(jobs -p) 2>/dev/null || true' EXIT
wait_for() {
  for ((i = 0; i < 200; ++i)); do
    if (exec 3<>"/dev/tcp/127.0.0.1/$1") 2>/dev/null; then return; fi
    sleep 0.1
  done
  echo "nothing listens on port $1" >&2
  exit 1
}
)";

std::string port_of(const std::string& command) {
  constexpr std::string_view kListen = "--listen 127.0.0.1:";
  const auto at = command.find(kListen);
  if (at == std::string::npos) return {};
  const auto begin = at + kListen.size();
  return command.substr(begin, command.find(' ', begin) - begin);
}

}  // namespace

std::string script_of(std::string_view page) {
  constexpr std::string_view kIndent = "    ", kNotRun = "<!-- not run: ", kFilledIn = "<!-- filled in: ";
  std::string script{kBegin};
  script += kFillIn;
  bool is_run = true, was_command = false;
  std::istringstream lines{std::string{page}};
  for (std::string line; std::getline(lines, line);) {
    const bool is_command = line.starts_with(kIndent);
    if (line.starts_with(kNotRun)) {
      is_run = was_command = false;
      continue;
    }
    if (line.starts_with(kFilledIn))
      script += fmt::format("fill_in {}\n", line.substr(kFilledIn.size(), line.find(" -->") - kFilledIn.size()));
    if (is_command && is_run) {
      const std::string command = line.substr(kIndent.size());
      script += fmt::format("echo {}\n{}\n", "'$ " + command + "'", command);
      if (command.ends_with('&')) script += fmt::format("wait_for {}\n", port_of(command));
    }
    // A block that is not run ends with its last indented line.
    if (was_command && !is_command && !line.empty()) is_run = true;
    was_command = is_command || (was_command && line.empty());
  }
  return script;
}

void write_figure(const std::filesystem::path& file) {
  constexpr int kRings = 60, kAround = 100;
  std::ofstream out{file};
  out << fmt::format(
      "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nend_header\n",
      kRings * kAround);
  for (int i = 0; i < kRings; ++i)
    for (int k = 0; k < kAround; ++k) {
      const double tilt = std::numbers::pi * (i + 0.5) / kRings,
                   turn = 2 * std::numbers::pi * (k + 0.5 * (i % 2)) / kAround;
      const double r = 0.011 * (1 + 0.12 * std::sin(3 * tilt) * std::cos(2 * turn));
      out << fmt::format("{:.7f} {:.7f} {:.7f}\n", r * std::sin(tilt) * std::cos(turn),
                         r * std::sin(tilt) * std::sin(turn), 0.015 * (1 - std::cos(tilt)));
    }
}

}  // namespace telefab::test
