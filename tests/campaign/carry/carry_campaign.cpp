// SPDX-License-Identifier: GPL-3.0-or-later
// What does the pull of the film ask of a print, whoever planned it? A folder of masks (PNG, one a layer, in order of
// their names: an unpacked SL1, a plan's masks), judged as the preflight judges ours. Run by hand.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <telefab/base/file.hpp>
#include <telefab/fab/carry/carry_watch.hpp>
#include <telefab/image/png.hpp>
#include <vector>

namespace telefab {
namespace {

namespace fs = std::filesystem;
constexpr std::uint64_t kMaxBytes = 64ULL << 20U, kMaxPixels = 1ULL << 28U;
constexpr std::uint8_t kSolid = 128;

std::optional<fab::Mask> read_mask(const fs::path& path) {
  const auto bytes = read_file(path.string(), kMaxBytes);
  if (!bytes) return std::nullopt;
  auto image = decode_png(*bytes, kMaxPixels);
  if (!image) return std::nullopt;
  fab::Mask mask{{image->width_px, image->height_px}, {}};
  mask.rows.resize(std::size_t{image->width_px} * image->height_px);
  for (std::size_t i = 0; i < mask.rows.size(); ++i) mask.rows[i] = image->pixels[i * image->channels];
  return mask;
}

void print(const char* name, const std::optional<fab::CarryPlace>& place) {
  if (!place) return fmt::print("  {:8} -\n", name);
  fmt::print("  {:8} {:8.1f}  {:6.2f} mm2 in layer {} at ({:.1f}, {:.1f}), {:.0f} mm2 of layer {}\n", name,
             place->demand, place->section_mm2, place->layer.count(), place->place.x_mm, place->place.y_mm,
             place->held_mm2, place->moment.count());
}

int run(const fs::path& folder, double pitch_mm, double thickness_mm, double limit) {
  std::vector<fs::path> paths;
  std::error_code error;
  for (const auto& entry : fs::recursive_directory_iterator{folder, error})
    if (entry.path().extension() == ".png" && entry.path().string().find("thumbnail") == std::string::npos)
      paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  fab::CarryOptions options;
  options.pitch_mm = pitch_mm;
  options.thickness_mm = thickness_mm;
  options.limit = limit;
  fab::CarryWatch watch{options};
  for (const fs::path& path : paths) {
    const auto mask = read_mask(path);
    if (!mask) return fmt::print(stderr, "{}: no picture\n", path.string()), 2;
    const auto solid = fab::LayerRuns::from_mask(mask->view(), kSolid);
    if (auto ok = watch.add(solid, fab::firm_pixels(mask->view(), solid)); !ok)
      return fmt::print(stderr, "{}: {}\n", path.string(), ok.error().what), 2;
  }
  const auto report = watch.finish({});
  if (!report) return fmt::print(stderr, "{}\n", report.error().what), 2;
  fmt::print("{}: {} layers, base {:.0f} mm2, {} places above {}, {} that hold little\n", folder.string(),
             report->layers, report->base_mm2, report->weak.size(), limit, report->weak_small.size());
  print("cut", report->cut);
  print("lever", report->lever);
  print("bending", report->bending);
  print("small", report->small);
  return 0;
}

std::optional<double> number(std::string_view text) {
  double value = 0;
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  return code == std::errc{} && end == text.data() + text.size() && value > 0 ? std::optional{value} : std::nullopt;
}

}  // namespace
}  // namespace telefab

int main(int argc, char** argv) {
  const std::vector<std::string_view> words(argv + 1, argv + argc);
  const auto pitch = words.size() > 1 ? telefab::number(words[1]) : std::nullopt;
  const auto layer = words.size() > 2 ? telefab::number(words[2]) : std::nullopt;
  const auto limit = words.size() > 3 ? telefab::number(words[3]) : std::optional{125.0};
  if (!pitch || !layer || !limit) return fmt::print(stderr, "campaign_carry FOLDER PITCH_MM LAYER_MM [LIMIT=125]\n"), 1;
  return telefab::run(words[0], *pitch, *layer, *limit);
}
