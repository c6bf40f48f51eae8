// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/formats/registration_note.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/measure/point_picture.hpp>
#include <telefab/scan/registration/merge_views.hpp>
#include <telefab/scan/registration/pose_file.hpp>
#include <telefab/scan/registration/register_views.hpp>

#include "cloud_files.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

constexpr PointColour kSound{205, 200, 190}, kDoubled{200, 60, 30};

struct Options {
  std::vector<std::string> inputs;
  std::string out, report, picture, poses, poses_out, axis, units;
  double step_deg = 0;
  std::optional<double> budget, cut_below;
  bool upright = false;
  bool json = false;
};

/// "view_9" before "view_10": runs of digits compare as numbers.
bool comes_before(const std::string& l, const std::string& r) {
  std::size_t a = 0, b = 0;
  const auto digit = [](char c) { return c >= '0' && c <= '9'; };
  while (a < l.size() && b < r.size()) {
    if (!digit(l[a]) || !digit(r[b])) {
      if (l[a] != r[b]) return l[a] < r[b];
      ++a, ++b;
      continue;
    }
    std::size_t ea = a, eb = b;
    while (ea < l.size() && digit(l[ea])) ++ea;
    while (eb < r.size() && digit(r[eb])) ++eb;
    while (a < ea && l[a] == '0') ++a;
    while (b < eb && r[b] == '0') ++b;
    if (ea - a != eb - b) return ea - a < eb - b;
    if (const int order = l.compare(a, ea - a, r, b, eb - b); order != 0) return order < 0;
    a = ea, b = eb;
  }
  return l.size() - a < r.size() - b;
}

/// Files as given; folders by their scan files in natural order.
Result<std::vector<std::string>> files_of(const Options& o) {
  std::vector<std::string> files;
  for (const std::string& input : o.inputs) {
    std::error_code fault;
    if (!std::filesystem::is_directory(input, fault)) {
      files.push_back(input);
      continue;
    }
    std::vector<std::string> found;
    for (const auto& entry : std::filesystem::directory_iterator{input, fault}) {
      const std::string suffix = entry.path().extension().string();
      if (suffix == ".ply" || suffix == ".ptx" || suffix == ".pcd" || suffix == ".e57")
        found.push_back(entry.path().string());
    }
    if (fault) return fail(ErrorCode::NotPermitted, fmt::format("{}: {}", input, fault.message()));
    std::sort(found.begin(), found.end(), comes_before);
    files.insert(files.end(), found.begin(), found.end());
  }
  return files;
}

struct Views {
  std::vector<RangeImage> images;
  std::optional<double> unit_mm;  ///< as the user or all files state it
};

Result<Views> load_views(const Options& o, std::stop_token stop) {
  const auto files = files_of(o);
  if (!files) return tl::unexpected{files.error()};
  Views views;
  if (!o.units.empty()) {
    const auto unit = millimetres_per(o.units);
    if (!unit) return tl::unexpected{unit.error()};
    views.unit_mm = *unit;
  }
  for (const std::string& path : *files) {
    const auto bytes = read_file(path, kMaxScanFileBytes);
    if (!bytes) return tl::unexpected{bytes.error()};
    const auto file = read_scan_file(*bytes, name_of_file(path), {}, stop);
    if (!file) return tl::unexpected{file.error()};
    if (o.units.empty()) {
      if (views.images.empty()) views.unit_mm = file->cloud.unit_mm;
      if (views.unit_mm != file->cloud.unit_mm)
        return fail(ErrorCode::InvalidInput,
                    fmt::format("{} and {} do not state the same unit; say --units", path, files->front()));
    }
    for (std::size_t v = 0; v < std::max<std::size_t>(1, file->views.size()); ++v) {
      const std::string name = name_of_file(path);
      auto image = make_range_image(*file, v, file->views.size() > 1 ? fmt::format("{}#{}", name, v) : name);
      if (!image) return tl::unexpected{image.error()};
      views.images.push_back(std::move(*image));
    }
  }
  return views;
}

Result<RegisterOptions> options_from(const Options& o, const std::vector<RangeImage>& views) {
  RegisterOptions r;
  r.step_deg = o.step_deg;
  if (o.axis == "x")
    r.axis_direction = Vec3::UnitX();
  else if (o.axis == "y")
    r.axis_direction = Vec3::UnitY();
  else if (o.axis == "z")
    r.axis_direction = Vec3::UnitZ();
  else if (!o.axis.empty())
    return fail(ErrorCode::InvalidInput, fmt::format("--axis {}: x, y or z", o.axis));
  float spacing = 0;
  for (const RangeImage& v : views) spacing = std::max(spacing, v.spacing);
  r.max_rms = o.budget.value_or(0.6 * static_cast<double>(spacing));
  if (!o.poses.empty()) {
    const auto bytes = read_file(o.poses, 1U << 24U);
    if (!bytes) return tl::unexpected{bytes.error()};
    const auto poses = read_pose_file({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
    if (!poses) return tl::unexpected{poses.error()};
    for (const RangeImage& v : views) {
      const auto found =
          std::find_if(poses->begin(), poses->end(), [&](const NamedPose& p) { return p.file == v.name; });
      if (found == poses->end())
        return fail(ErrorCode::InvalidInput, fmt::format("{} has no pose for {}", o.poses, v.name));
      r.start.push_back(found->pose);
    }
  }
  return r;
}

std::string report_of(const Registration& r, const DoubledSheets& sheets, const MergeReport& merge,
                      const std::vector<RangeImage>& views) {
  std::string links;
  for (const LinkReport& l : r.links)
    links += fmt::format(
        R"({}{{"from":"{}","to":"{}","overlap":{:.4f},"pair_rms":{:.6g},"rms":{:.6g},"pair_to_global_deg":{:.4f},"pair_to_global_shift":{:.6g}}})",
        links.empty() ? "" : ",", views[l.from].name, views[l.to].name, l.overlap, l.pair_rms, l.rms,
        l.pair_to_global.degrees, l.pair_to_global.shift);
  std::string doubled;
  for (const DoubledPair& d : sheets.pairs)
    doubled +=
        fmt::format(R"({}{{"first":"{}","second":"{}","apart":{:.6g},"share":{:.4f},"place":[{:.6g},{:.6g},{:.6g}]}})",
                    doubled.empty() ? "" : ",", views[d.first].name, views[d.second].name, d.apart, d.share,
                    d.place.x(), d.place.y(), d.place.z());
  return fmt::format(
      R"({{"views":{},"axis_direction":[{:.6f},{:.6f},{:.6f}],"axis_point":[{:.6g},{:.6g},{:.6g}],"rms":{:.6g},"median_offset":{:.6g},"closure_deg":{:.4f},"closure_shift":{:.6g},"conflict":{:.5f},"links":[{}],"doubled_sheets":[{}],"merge":{}}})",
      r.poses.size(), r.axis.direction.x(), r.axis.direction.y(), r.axis.direction.z(), r.axis.point.x(),
      r.axis.point.y(), r.axis.point.z(), r.rms, r.median_offset, r.closure.degrees, r.closure.shift, r.conflict, links,
      doubled, to_json(merge));
}

/// Where the result stands: the frame of the poses it started from, or of view 0, turned until the table is level.
RigidMotion frame_of(const Options& o, const RegisterOptions& options, const Registration& registered) {
  RigidMotion frame =
      options.start.empty() ? RigidMotion::Identity() : options.start[0] * registered.poses[0].inverse();
  if (!o.upright) return frame;
  // Scanners stand upright, so of the axis' two senses the one nearer to the rows' upward direction is up.
  Vec3 up = registered.axis.direction;
  if (up.y() < 0) up = -up;
  return RigidMotion{Eigen::Quaterniond::FromTwoVectors(up, Vec3::UnitZ())};
}

void move(PointCloud& cloud, const RigidMotion& motion) {
  for (auto& p : cloud.points) p = (motion * (cloud.origin + p.cast<double>())).cast<float>();
  for (auto& n : cloud.normals) n = (motion.linear() * n.cast<double>()).cast<float>();
  cloud.origin.setZero();
}

Result<ExitCode> run(const Options& o, std::stop_token stop) {
  auto loaded = load_views(o, stop);
  if (!loaded) return tl::unexpected{loaded.error()};
  std::vector<RangeImage>* const views = &loaded->images;
  const auto options = options_from(o, *views);
  if (!options) return tl::unexpected{options.error()};
  const ProgressSink progress = [](const Progress& p) { write_note(fmt::format("{}\n", label_of(p.stage))); };
  auto registered = register_views(*views, *options, on_terminal() ? progress : ProgressSink{}, stop);
  if (!registered) return tl::unexpected{registered.error()};
  const auto sheets = settle_doubled_sheets(*views, registered->poses, stop);
  if (!sheets) return tl::unexpected{sheets.error()};
  auto merged = merge_views(*views, registered->poses,
                            {.up = registered->axis.direction, .cut_below = o.cut_below, .sheets = &*sheets}, stop);
  if (!merged) return tl::unexpected{merged.error()};
  PointCloud cloud = std::move(merged->cloud);
  const RigidMotion frame = frame_of(o, *options, *registered);
  move(cloud, frame);
  const double unit_mm = loaded->unit_mm.value_or(1);
  if (loaded->unit_mm) {
    cloud = scaled(std::move(cloud), unit_mm);
    if (const auto warning = scale_warning(cloud, unit_mm)) write_note(fmt::format("note: {}\n", *warning));
  }
  if (auto ok = write_file_atomically(
          o.out, write_ply(cloud, {}, registration_note(views->size(), registered->rms * unit_mm)));
      !ok)
    return tl::unexpected{ok.error()};
  const std::string report = report_of(*registered, *sheets, merged->report, *views) + "\n";
  if (!o.report.empty())
    if (auto ok = write_file_atomically(o.report, report); !ok) return tl::unexpected{ok.error()};
  if (!o.poses_out.empty()) {
    std::vector<NamedPose> poses;
    for (std::size_t i = 0; i < views->size(); ++i) poses.push_back({(*views)[i].name, frame * registered->poses[i]});
    if (auto ok = write_file_atomically(o.poses_out, to_pose_file(poses)); !ok) return tl::unexpected{ok.error()};
  }
  if (!o.picture.empty()) {
    std::vector<PointColour> colours(cloud.size(), kSound);
    for (std::size_t i = 0; i < cloud.sheets_apart.size(); ++i)
      if (cloud.sheets_apart[i] > 0) colours[i] = kDoubled;
    const auto png = encode_png(draw_points(cloud, colours, {}));
    if (!png) return tl::unexpected{png.error()};
    if (auto ok = write_file_atomically(o.picture, *png); !ok) return tl::unexpected{ok.error()};
  }
  for (const DoubledPair& d : sheets->pairs) write_note(fmt::format("note: {}\n", sentence_of(d, *views)));
  if (!sheets->empty())
    write_note("note: layers through these places will be flagged; register or scan the views named first again\n");
  if (o.json) {
    write_output(report);
    return ExitCode::Ok;
  }
  write_output(fmt::format("{:<28} {:<28} overlap   pair rms     rms\n", "view", "against"));
  for (const LinkReport& l : registered->links)
    write_output(fmt::format("{:<28} {:<28} {:5.1f} %   {:.3e}   {:.3e}\n", (*views)[l.from].name, (*views)[l.to].name,
                             100 * l.overlap, l.pair_rms, l.rms));
  write_output(fmt::format(
      "{} views, rms {:.4g} (budget {:.4g}), median {:.4g}, closure {:.3f} degrees and {:.4g}, conflicts {:.2f} %\n{} "
      "points written\n",
      views->size(), registered->rms, options->max_rms, registered->median_offset, registered->closure.degrees,
      registered->closure.shift, 100 * registered->conflict, cloud.size()));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_register(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options
      .add("VIEWS", o->inputs,
           "range images in the order of the turn, or a folder of them: PLY with range_grid, PTX, organised PCD, "
           "E57 with rows and columns")
      .required();
  options.add("--out", o->out, "the merged, oriented cloud, PLY").required();
  options.add("--step-deg", o->step_deg, "turn of the table from one view to the next, degrees");
  options.add("--axis", o->axis, "direction of the table's axis: x, y or z; unset: searched");
  const Option poses =
      options.add("--poses", o->poses,
                  "poses to start from (Stanford .conf) instead of a search; the result is in their common frame");
  options.flag("--upright", o->upright, "turn the result until the table's axis points along +z, ready for slicing")
      .excludes(poses);
  options.add("--budget", o->budget,
              "largest rms between the views, unit of the files; worse is refused. Unset: 0.6 grid spacings");
  options.add("--cut-below", o->cut_below,
              "removes the stand: what is lower than this above the lowest point, along the axis");
  options.add(
      "--units", o->units,
      "unit of the files (mm, cm, m, in); the result is in mm. Unset: what they state (E57: m), or lengths stay as "
      "they are");
  options.add("--report", o->report, "every pair and the merge, JSON");
  options.add("--poses-out", o->poses_out, "the poses found, Stanford .conf");
  options.add("--picture", o->picture, "the merged cloud from four sides, PNG; red: two sheets");
  options.flag("--json", o->json, "print the report instead of the table");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
