// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <string_view>
#include <telefab/scan/formats/registration_note.hpp>

namespace telefab::scan {

namespace {

constexpr std::size_t kMaxHeaderBytes = 1U << 16U;
constexpr std::string_view kBehindViews = " range images registered by telefab-scan, rms ";

}  // namespace

std::string registration_note(std::size_t views, double rms) {
  return fmt::format("{}{}{:.6g}", views, kBehindViews, rms);
}

std::optional<double> registration_rms_of(std::span<const std::byte> file) {
  std::string_view header{reinterpret_cast<const char*>(file.data()), std::min(file.size(), kMaxHeaderBytes)};
  if (!header.starts_with("ply")) return std::nullopt;
  header = header.substr(0, header.find("end_header"));
  const std::size_t at = header.find(kBehindViews);
  if (at == std::string_view::npos) return std::nullopt;
  const std::string_view number = header.substr(at + kBehindViews.size());
  double rms = 0;
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), rms);
  if (error != std::errc{} || !std::isfinite(rms) || rms < 0) return std::nullopt;
  return rms;
}

}  // namespace telefab::scan
