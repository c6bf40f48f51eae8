// SPDX-License-Identifier: GPL-3.0-or-later
// A block sampled on an exact grid, steps of 0.1 to 1 mm x turns of 0 to 10 degrees x noises of 0 to 0.1 mm, sliced at
// 0.15 mm: layers inside that are empty, certified, and certified with another count than one contour. Run by hand;
// campaign_blocks STEP TURN NOISE slices one of them and lists the layers that are not one contour.
#include <fmt/format.h>

#include <cstdlib>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/test/grid_block.hpp>

namespace telefab::campaign {
namespace {

struct Tally {
  std::size_t inside = 0, empty = 0, certified = 0, wrong_certified = 0, wrong_flagged = 0;
};

/// A layer that is not one contour: the areas of its rings, and why it is flagged.
std::string line_of(const Layer& layer) {
  std::string line = fmt::format("layer {} at {:.3f} mm:", layer.index.count(), layer.z_mm);
  for (const Contour& ring : layer.contours) line += fmt::format(" {:.4f}", ring.signed_area_mm2());
  return line +
         fmt::format(" mm2, {}\n", layer.certificate.is_certified() ? "certified" : sentence_of(layer.certificate));
}

Result<Tally> slice(const test::GridBlock& block, bool list) {
  std::string text;
  double low = 1e9;  // of the samples: the part stands on the lowest of them, and the block somewhat higher
  for (const Eigen::Vector3d& p : test::points_of(block)) {
    text += fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
    low = std::min(low, p.z());
  }
  double top = 0;
  for (const Eigen::Vector3d& p : test::points_of({block.step_mm, block.turn_deg, 0})) top = std::max(top, p.z());
  scan::SliceRequest request;
  request.machine.name = "bench";
  request.machine.platform = {60, 40, 50};
  request.machine.projection.pixel_pitch_mm = 0.1;
  request.machine.layers.thickness_mm = 0.15;
  Tally tally;
  const double margin_mm = block.step_mm / 2 + 2 * block.noise_mm;
  const scan::LayerSink sink = [&](const StackHeader&, Layer&& layer) -> Result<void> {
    const double z_mm = layer.z_mm + low;
    if (z_mm < margin_mm || z_mm > top - margin_mm) return {};
    const bool certified = layer.certificate.is_certified();
    ++tally.inside;
    tally.empty += layer.contours.empty();
    tally.certified += certified;
    if (layer.contours.size() == 1) return {};
    ++(certified ? tally.wrong_certified : tally.wrong_flagged);
    if (list) fmt::print("{}", line_of(layer));
    return {};
  };
  const auto report = scan::slice_scan(std::as_bytes(std::span{text}), "block.xyz", request, sink, {}, {});
  if (!report) return tl::unexpected{report.error()};
  return tally;
}

int run_one(const test::GridBlock& block) {
  const auto tally = slice(block, true);
  if (!tally) {
    fmt::print("{}\n", tally.error().what);
    return 1;
  }
  fmt::print("{} layers inside, {} empty, {} certified, wrong {} certified {} flagged\n", tally->inside, tally->empty,
             tally->certified, tally->wrong_certified, tally->wrong_flagged);
  return tally->empty + tally->wrong_certified == 0 ? 0 : 1;
}

int run() {
  Tally all;
  std::size_t cases = 0, refused = 0;
  for (const double step : {0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0})
    for (const double turn : {0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 10.0})
      for (const double noise : {0.0, 0.01, 0.02, 0.05, 0.1}) {
        ++cases;
        const auto tally = slice({step, turn, noise}, false);
        if (!tally) {
          ++refused;
          fmt::print("step {} turn {} noise {}: {}\n", step, turn, noise, tally.error().what);
          continue;
        }
        if (tally->empty + tally->wrong_certified + tally->wrong_flagged > 0)
          fmt::print(
              "step {} turn {} noise {}: {} layers inside, {} empty, {} certified, wrong {} certified {} flagged\n",
              step, turn, noise, tally->inside, tally->empty, tally->certified, tally->wrong_certified,
              tally->wrong_flagged);
        all.inside += tally->inside;
        all.empty += tally->empty;
        all.certified += tally->certified;
        all.wrong_certified += tally->wrong_certified;
        all.wrong_flagged += tally->wrong_flagged;
      }
  fmt::print("{} cases, {} refused; {} layers inside, {} empty, {} certified, wrong {} certified {} flagged\n", cases,
             refused, all.inside, all.empty, all.certified, all.wrong_certified, all.wrong_flagged);
  return all.empty + all.wrong_certified == 0 ? 0 : 1;
}

}  // namespace
}  // namespace telefab::campaign

int main(int argc, char** argv) {
  if (argc != 4) return telefab::campaign::run();
  return telefab::campaign::run_one({std::atof(argv[1]), std::atof(argv[2]), std::atof(argv[3])});
}
