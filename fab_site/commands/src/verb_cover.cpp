// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/fab/support/pictures.hpp>

#include "verbs.hpp"

namespace telefab::fab {

VerbBody declare_cover(VerbOptions& options) {
  struct Options {
    std::string regions;
    double anchor_mm = 0;
    std::optional<std::string> out, preview;
    bool plain = false;
  };
  auto o = std::make_shared<Options>();
  options.add("REGIONS", o->regions, "GeoJSON with polygons in millimetres").required();
  options.add("--anchor-mm", o->anchor_mm, "every point lies within this of an anchor").required().within(1e-3, 1000.0);
  options.add_output("--out", o->out, "write the anchors as JSON here");
  options.add_output("--preview", o->preview, "write a picture (PNG) here");
  options.flag("--plain", o->plain, "the paper's method alone, to compare with");
  return [o](std::stop_token stop) -> Result<ExitCode> {
    const auto bytes = read_file(o->regions, 256U << 20U);
    if (!bytes) return tl::unexpected{bytes.error()};
    const auto region = region_from_geojson({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
    if (!region) return fail_in(o->regions, region.error());
    CoveringOptions covering_options;
    covering_options.anchor_distance = Millimetres{o->anchor_mm};
    covering_options.plain = o->plain;
    const auto covering = cover_region(*region, covering_options, stop);
    if (!covering) return tl::unexpected{covering.error()};
    const auto grid = grid_covering(*region, covering_options.anchor_distance).size();
    const double bound = covering_lower_bound(*region, covering_options.anchor_distance);
    write_output(fmt::format("{} anchors for {:.3f} mm2 (grid {}, lower bound {:.0f}), farthest point {:.4f} mm\n",
                             covering->anchors.size(), region->area_mm2(), grid, bound, covering->worst_mm));
    if (o->out) {
      std::string text = fmt::format(
          "{{\n \"anchor_mm\": {},\n \"area_mm2\": {:.6f},\n \"grid\": {},\n \"lower_bound\": {:.0f},\n"
          " \"farthest_mm\": {:.6f},\n \"anchors_mm\": [",
          o->anchor_mm, region->area_mm2(), grid, bound, covering->worst_mm);
      for (std::size_t i = 0; i < covering->anchors.size(); ++i)
        text +=
            fmt::format("{}\n  [{:.6f}, {:.6f}]", i ? "," : "", covering->anchors[i].x_mm, covering->anchors[i].y_mm);
      if (auto ok = write_file_atomically(*o->out, text + "\n ]\n}\n"); !ok) return tl::unexpected{ok.error()};
    }
    if (o->preview) {
      const auto png = encode_png(
          draw_covering(*region, covering->anchors, covering_options.anchor_distance,
                        {std::filesystem::path{o->regions}.filename().string(),
                         {},
                         {},
                         fmt::format("{} anchors for {:.3f} mm²", covering->anchors.size(), region->area_mm2()),
                         {},
                         0,
                         {}}));
      if (!png) return tl::unexpected{png.error()};
      if (auto ok = write_file_atomically(*o->preview, *png); !ok) return tl::unexpected{ok.error()};
    }
    return ExitCode::Ok;
  };
}

}  // namespace telefab::fab
