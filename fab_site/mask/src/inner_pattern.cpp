// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <telefab/fab/mask/inner_pattern.hpp>

namespace telefab::fab {
namespace {

constexpr double kToSpare = 1.05;            // of the dose that cures the inside
constexpr double kShowsThrough = 0.01;       // less light than that of the inside at the surface does not count
constexpr std::uint32_t kLeastShell_px = 4;  // so that the blur of the inside ends within the shell

constexpr std::array<std::pair<InnerPattern::Kind, std::string_view>, 3> kNames{
    {{InnerPattern::Kind::Solid, "solid"},
     {InnerPattern::Kind::Checker, "checker"},
     {InnerPattern::Kind::ShellCore, "shell-core"}}};

}  // namespace

std::string_view name_of(InnerPattern::Kind kind) {
  for (const auto& [known, name] : kNames)
    if (known == kind) return name;
  return "unknown";
}

Result<InnerPattern::Kind> inner_pattern_from_name(std::string_view name) {
  for (const auto& [kind, known] : kNames)
    if (name == known) return kind;
  return fail(ErrorCode::InvalidInput, fmt::format("{} is not a pattern; there are: solid, checker, shell-core", name));
}

Result<void> InnerPattern::validate() const {
  if (!(shell_mm > 0 && shell_mm <= 100))
    return fail(ErrorCode::InvalidInput, fmt::format("a shell of {} mm; above 0 and up to 100 is possible", shell_mm));
  if (!(cell_mm > 0 && cell_mm <= 100))
    return fail(ErrorCode::InvalidInput, fmt::format("cells of {} mm; above 0 and up to 100 is possible", cell_mm));
  if (!(core_share > 0 && core_share <= 1))
    return fail(ErrorCode::InvalidInput,
                fmt::format("a core share of {}; above 0 and up to 1 is possible", core_share));
  return {};
}

Result<PatternMaker> PatternMaker::make(const InnerPattern& pattern, const MaskLight& light, const MaskFrame& frame) {
  if (auto ok = pattern.validate(); !ok) return tl::unexpected{ok.error()};
  const double least_shell_mm =
      std::max(light.penetration_mm * std::log(1 / kShowsThrough), kLeastShell_px * frame.pixel_pitch_mm);
  if (pattern.shell_mm < least_shell_mm)
    return fail(ErrorCode::InvalidInput,
                fmt::format("a shell of {} mm lets the pattern inside show; {:.2f} mm and more are possible with this "
                            "resin and these pixels",
                            pattern.shell_mm, std::ceil(100 * least_shell_mm) / 100));
  const double q = light.passed();
  // A cell that is dark in its own layer has the next one's light, and that of every second one after it, and must be
  // cured to its far side. A dimmed layer must cure to its far side by itself, or it would stick to nothing.
  const double needs = pattern.kind == InnerPattern::Kind::Checker     ? (1 - q * q) / (q * q)
                       : pattern.kind == InnerPattern::Kind::ShellCore ? 1 / (q * pattern.core_share)
                                                                       : 0;
  if (light.white < kToSpare * needs)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("the pattern {} needs a dose of {:.2f} Ec and gets {:.2f}: the inside would not cure. Expose "
                    "longer (--cure-depth {:.1f}), or give the core a larger share",
                    name_of(pattern.kind), kToSpare * needs, light.white,
                    std::ceil(10 * std::log(kToSpare * needs) * light.penetration_mm / light.layer_mm) / 10));
  PatternMaker maker;
  maker.kind_ = pattern.kind;
  maker.shell_px_ = static_cast<std::uint32_t>(std::ceil(pattern.shell_mm / frame.pixel_pitch_mm));
  maker.shell_layers_ = static_cast<std::uint32_t>(std::ceil(pattern.shell_mm / light.layer_mm));
  maker.cell_px_ = static_cast<std::uint32_t>(std::max(1.0, std::round(pattern.cell_mm / frame.pixel_pitch_mm)));
  maker.core_cap_ = static_cast<std::uint8_t>(std::lround(255 * pattern.core_share));
  return maker;
}

std::vector<PixelRuns> PatternMaker::cores(std::span<const SolidRows> layers) const {
  std::vector<PixelRuns> deep;
  deep.reserve(layers.size());
  for (const SolidRows& layer : layers)
    deep.push_back(shrunk(layer.any_support() ? without(layer.solid(), layer.supports()) : layer.solid(), shell_px_));
  // What 1, 2, 4, .. layers from each on have in common, and from that as many as a shell above and below counts.
  const std::size_t window = 2 * std::size_t{shell_layers_} + 1;
  std::size_t reach = 1;
  for (; 2 * reach <= window; reach *= 2)
    for (std::size_t i = 0; i + reach < deep.size(); ++i) deep[i] = common(deep[i], deep[i + reach]);
  std::vector<PixelRuns> cores(layers.size());
  for (std::size_t i = 0; i + window <= deep.size(); ++i)
    cores[i + shell_layers_] = common(deep[i], deep[i + window - reach]);
  return cores;
}

bool PatternMaker::darken(const PixelRuns& core, std::uint32_t print_layer, std::uint32_t y, bool known,
                          std::span<std::uint8_t> caps) const {
  if (kind_ == InnerPattern::Kind::Solid || y >= core.rows()) return known;
  const auto runs = core.row(y);
  if (runs.empty()) return known;
  if (!known) std::fill(caps.begin(), caps.end(), std::uint8_t{255});
  for (const PixelRun& run : runs)
    for (std::int32_t x = run.first; x < run.behind; ++x) {
      const bool dark = ((static_cast<std::uint32_t>(x) / cell_px_ + y / cell_px_ + print_layer) & 1U) != 0;
      std::uint8_t& cap = caps[static_cast<std::size_t>(x)];
      cap = std::min(cap, kind_ == InnerPattern::Kind::ShellCore ? core_cap_ : dark ? std::uint8_t{0} : cap);
    }
  return true;
}

}  // namespace telefab::fab
