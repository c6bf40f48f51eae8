// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <algorithm>
#include <cctype>
#include <filesystem>
#include <iterator>
#include <memory>
#include <optional>
#include <telefab/base/file.hpp>
#include <telefab/command_line/output.hpp>
#include <telefab/image/palette.hpp>
#include <telefab/scan/cloud/units.hpp>
#include <telefab/scan/formats/registration_note.hpp>
#include <telefab/scan/formats/write_cloud.hpp>
#include <telefab/scan/measure/point_picture.hpp>
#include <telefab/scan/registration/join_scans.hpp>
#include <telefab/scan/registration/merge_views.hpp>
#include <telefab/scan/registration/pose_file.hpp>
#include <telefab/scan/registration/register_views.hpp>
#include <telefab/scan/staging/view_file.hpp>

#include "cloud_files.hpp"
#include "verbs.hpp"

namespace telefab::scan {
namespace {

const PointColour kSound = point_colour(palette::kPart), kDoubled = point_colour(palette::kDoubtful);

struct Options {
  std::vector<std::string> inputs;
  std::string out, report, picture, poses, poses_out, axis, units;
  std::vector<double> steps_deg;
  std::optional<double> budget, cut_below;
  std::uint64_t seed = 1;
  bool upright = false, keep_table = false, accept_symmetry = false;
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

/// What one word of the command names.
struct Input {
  std::string name;
  bool is_folder = false;
  std::vector<std::string> files;
};

/// Files as given; folders by their scan files in natural order.
Result<std::vector<Input>> inputs_of(const Options& o) {
  std::vector<Input> inputs;
  for (const std::string& word : o.inputs) {
    Input input{.name = word};
    std::error_code fault;
    input.is_folder = std::filesystem::is_directory(word, fault);
    if (!input.is_folder) {
      input.files.push_back(word);
      inputs.push_back(std::move(input));
      continue;
    }
    for (const auto& entry : std::filesystem::directory_iterator{word, fault}) {
      std::string suffix = entry.path().extension().string();
      std::transform(suffix.begin(), suffix.end(), suffix.begin(),
                     [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
      if (suffix == ".ply" || suffix == ".ptx" || suffix == ".pcd" || suffix == ".e57")
        input.files.push_back(entry.path().string());
    }
    if (fault) return fail(ErrorCode::NotPermitted, fmt::format("{}: {}", word, fault.message()));
    if (input.files.empty())
      return fail(
          ErrorCode::InvalidInput,
          fmt::format("{}: no scan is in this folder; of a folder the files named *.ply, *.ptx, *.pcd and *.e57 "
                      "are taken, others are named one by one",
                      word));
    std::sort(input.files.begin(), input.files.end(), comes_before);
    inputs.push_back(std::move(input));
  }
  return inputs;
}

struct Views {
  std::vector<RangeImage> images;
  std::vector<ScanGroup> groups;  ///< one an input
  bool is_one_turn = false;       ///< or poses are known: registered as they come
  std::optional<double> unit_mm;  ///< as the user or all files state it
};

/// Without a step and poses, and with several folders or a file beside a folder, things are to be joined.
bool is_one_turn(const Options& o, const std::vector<Input>& inputs) {
  if (!o.poses.empty()) return true;
  const bool has_folder = std::ranges::any_of(inputs, [](const Input& i) { return i.is_folder; });
  return !o.steps_deg.empty() && o.steps_deg.front() != 0 && (inputs.size() == 1 || !has_folder);
}

/// The step of every input: one for all folders, or one a folder in their order; 0 for files.
Result<std::vector<double>> steps_of(const Options& o, const std::vector<Input>& inputs) {
  const auto folders =
      static_cast<std::size_t>(std::ranges::count_if(inputs, [](const Input& i) { return i.is_folder; }));
  if (o.steps_deg.size() > 1 && o.steps_deg.size() != folders)
    return fail(ErrorCode::InvalidInput,
                fmt::format("--step-deg has {} steps for {} folders; give one for all, or one a folder (0: not known)",
                            o.steps_deg.size(), folders));
  std::vector<double> steps;
  std::size_t folder = 0;
  for (const Input& input : inputs) {
    if (o.steps_deg.empty() || !input.is_folder) {
      steps.push_back(0);
      continue;
    }
    steps.push_back(o.steps_deg[o.steps_deg.size() == 1 ? 0 : folder++]);
    if (!(steps.back() >= 0 && steps.back() <= 180))
      return fail(ErrorCode::InvalidInput,
                  fmt::format("a step of {} degrees; above 0 and up to 180 is possible", steps.back()));
  }
  return steps;
}

/// The views of one file, called `name`.
Result<void> add_views(const std::string& path, const std::string& name, const Options& o, GridlessCloud cloud,
                       Views& views, const std::string& first, std::stop_token stop) {
  const auto bytes = read_file(path, kMaxScanFileBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  auto file = read_scan_file(*bytes, name_of_file(path), {}, stop);
  if (!file) return tl::unexpected{file.error()};
  if (o.units.empty()) {
    if (views.images.empty()) views.unit_mm = file->cloud.unit_mm;
    if (views.unit_mm != file->cloud.unit_mm)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("{} and {} do not state the same unit; say --units", path, first));
  }
  auto added = views_of(std::move(*file), name, cloud, stop);
  if (!added) return tl::unexpected{added.error()};
  std::ranges::move(*added, std::back_inserter(views.images));
  return {};
}

Result<Views> load_views(const Options& o, std::stop_token stop) {
  const auto inputs = inputs_of(o);
  if (!inputs) return tl::unexpected{inputs.error()};
  const auto steps = steps_of(o, *inputs);
  if (!steps) return tl::unexpected{steps.error()};
  Views views;
  views.is_one_turn = is_one_turn(o, *inputs);
  if (!o.units.empty()) {
    const auto unit = millimetres_per(o.units);
    if (!unit) return tl::unexpected{unit.error()};
    views.unit_mm = *unit;
  }
  std::string first;
  for (std::size_t i = 0; i < inputs->size(); ++i) {
    const Input& input = (*inputs)[i];
    const std::size_t begin = views.images.size();
    // two folders may each have a view_000.ply
    const bool names_folder = input.is_folder && inputs->size() > 1 && !views.is_one_turn;
    for (const std::string& path : input.files) {
      if (first.empty()) first = path;
      const std::string name = names_folder
                                   ? name_of_file(std::filesystem::path{path}.parent_path()) + "/" + name_of_file(path)
                                   : name_of_file(path);
      const auto cloud = !views.is_one_turn && (*steps)[i] == 0 ? GridlessCloud::View : GridlessCloud::Refused;
      if (auto added = add_views(path, name, o, cloud, views, first, stop); !added)
        return tl::unexpected{added.error()};
    }
    views.groups.push_back({(*inputs)[i].name, begin, views.images.size() - begin, (*steps)[i]});
  }
  return views;
}

Result<RegisterOptions> options_from(const Options& o, const std::vector<RangeImage>& views) {
  RegisterOptions r;
  r.step_deg = o.steps_deg.empty() ? 0 : o.steps_deg.front();
  if (o.axis == "x")
    r.axis_direction = Vec3::UnitX();
  else if (o.axis == "y")
    r.axis_direction = Vec3::UnitY();
  else if (o.axis == "z")
    r.axis_direction = Vec3::UnitZ();
  else if (!o.axis.empty())
    return fail(ErrorCode::InvalidInput, fmt::format("--axis {}: x, y or z", o.axis));
  r.max_rms = o.budget.value_or(most_rms_of(views));
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

/// What a registration of any kind hands on to the merge.
struct Registered {
  Registration registration;
  RigidMotion frame = RigidMotion::Identity();  ///< of view 0 to that of the result
  std::optional<Vec3> up;                       ///< frame of view 0; unset: nothing was turned
  std::optional<JoinedScans> joined;
};

std::string report_of(const Registered& registered, const DoubledSheets& sheets, const MergeReport& merge,
                      const std::vector<RangeImage>& views) {
  const Registration& r = registered.registration;
  std::string joins;
  if (registered.joined)
    joins = fmt::format(R"("noise":{:.6g},"noise_is_guessed":{},"table_points":{},"series":{},)",
                        registered.joined->joined.noise, registered.joined->joined.noise_is_guessed,
                        registered.joined->table_points, to_json(registered.joined->joined.series));
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
      R"({{"views":{},"axis_direction":[{:.6f},{:.6f},{:.6f}],"axis_point":[{:.6g},{:.6g},{:.6g}],"rms":{:.6g},"median_offset":{:.6g},"closure_deg":{:.4f},"closure_shift":{:.6g},"conflict":{:.5f},{}"links":[{}],"doubled_sheets":[{}],"merge":{}}})",
      r.poses.size(), r.axis.direction.x(), r.axis.direction.y(), r.axis.direction.z(), r.axis.point.x(),
      r.axis.point.y(), r.axis.point.z(), r.rms, r.median_offset, r.closure.degrees, r.closure.shift, r.conflict, joins,
      links, doubled, to_json(merge));
}

/// Progress on a terminal: a line a stage, and for each tenth of a long one.
ProgressSink notes_of_progress() {
  if (!on_terminal()) return {};
  return [last = std::string{}](const Progress& p) mutable {
    const int tenths = static_cast<int>(10 * p.fraction);
    std::string line = tenths > 0 && p.stage == WorkStage::AligningPairs
                           ? fmt::format("{}, {} %\n", label_of(p.stage), 10 * tenths)
                           : fmt::format("{}\n", label_of(p.stage));
    if (line != last) write_note(line);
    last = std::move(line);
  };
}

/// One turn, or poses to start from.
Result<Registered> register_turn(const Options& o, Views& views, const RegisterOptions& options, std::stop_token stop) {
  auto found = register_views(views.images, options, notes_of_progress(), stop);
  if (!found) return tl::unexpected{found.error()};
  Registered result{.registration = std::move(*found)};
  const Registration& r = result.registration;
  if (!options.start.empty()) result.frame = options.start[0] * r.poses[0].inverse();
  result.up = r.axis.direction;
  // Scanners stand upright, so of the axis' two senses the one nearer to the rows' upward direction is up.
  if (o.upright && r.axis.direction.y() < 0) result.up = Vec3{-r.axis.direction};
  return result;
}

/// Several series, single views, clouds: in any poses.
Result<Registered> join(const Options& o, Views& views, const RegisterOptions& options, std::stop_token stop) {
  JoinScansOptions join{.axis_direction = options.axis_direction, .keep_table = o.keep_table, .cut_below = o.cut_below};
  join.join.max_rms = options.max_rms;
  join.join.accept_symmetry = o.accept_symmetry;
  join.join.seed = o.seed;
  auto found = join_scans(views.images, views.groups, join, notes_of_progress(), stop);
  if (!found) return tl::unexpected{found.error()};
  if (o.upright && !found->up)
    return fail(ErrorCode::InvalidInput,
                "--upright turns the axis of a turn upward, and no turn was given; leave it out, or say --step-deg");
  for (const std::string& note : found->notes) write_note(fmt::format("note: {}\n", note));
  Registered result{.registration = found->joined.registration, .up = found->up};
  if (found->axis) result.registration.axis = *found->axis;
  result.joined = std::move(*found);
  return result;
}

void write_series_table(const JoinedScans& joined) {
  write_output(
      fmt::format("\n{:<28} joined        overlap   rms / noise   conflict   stiffness   next best\n", "series"));
  for (const SeriesReport& r : joined.joined.series)
    write_output(fmt::format("{:<28} {:<12} {:5.1f} %   {:11.2f}   {:>8}   {:9.4f}   {:9.2f}\n", r.name,
                             name_of(r.verdict), 100 * r.overlap, r.noise > 0 ? r.rms / r.noise : 0,
                             r.conflict ? fmt::format("{:.2f} %", 100 * *r.conflict) : "untested", r.stiffness,
                             r.runner_up));
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
  auto registered = loaded->is_one_turn ? register_turn(o, *loaded, *options, stop) : join(o, *loaded, *options, stop);
  if (!registered) return tl::unexpected{registered.error()};
  Registration& registration = registered->registration;
  const auto sheets = reconcile_doubled_sheets(*views, registration.poses, stop);
  if (!sheets) return tl::unexpected{sheets.error()};
  MergeOptions merging{.sheets = &*sheets};
  if (loaded->is_one_turn) {
    merging.up = registration.axis.direction;
    merging.cut_below = o.cut_below;
  }
  auto merged = merge_views(*views, registration.poses, merging, stop);
  if (!merged) return tl::unexpected{merged.error()};
  PointCloud cloud = std::move(merged->cloud);
  RigidMotion frame = registered->frame;
  if (o.upright) frame = RigidMotion{Eigen::Quaterniond::FromTwoVectors(*registered->up, Vec3::UnitZ())};
  move(cloud, frame);
  const double unit_mm = loaded->unit_mm.value_or(1);
  if (loaded->unit_mm) {
    cloud = scaled(std::move(cloud), unit_mm);
    if (const auto warning = scale_warning(cloud, unit_mm)) write_note(fmt::format("note: {}\n", *warning));
  }
  if (auto ok = write_file_atomically(
          o.out, write_ply(cloud, {}, registration_note(views->size(), registration.rms * unit_mm)));
      !ok)
    return tl::unexpected{ok.error()};
  const std::string report = report_of(*registered, *sheets, merged->report, *views) + "\n";
  if (!o.report.empty())
    if (auto ok = write_file_atomically(o.report, report); !ok) return tl::unexpected{ok.error()};
  if (!o.poses_out.empty()) {
    std::vector<NamedPose> poses;
    for (std::size_t i = 0; i < views->size(); ++i) poses.push_back({(*views)[i].name, frame * registration.poses[i]});
    if (auto ok = write_file_atomically(o.poses_out, to_pose_file(poses)); !ok) return tl::unexpected{ok.error()};
  }
  if (!o.picture.empty()) {
    std::vector<PointColour> colours(cloud.size(), kSound);
    for (std::size_t i = 0; i < cloud.sheets_apart.size(); ++i)
      if (cloud.sheets_apart[i] > 0) colours[i] = kDoubled;
    PictureCaption caption{name_of_file(o.out), {}, {}, {}, {}, 0, {}};
    caption.detail = fmt::format("{} points of {} views", cloud.size(), views->size());
    caption.legend = {{palette::kPart, "merged"}, {palette::kDoubtful, "two sheets of one surface"}};
    const auto png = encode_png(framed_points(cloud, colours, std::move(caption), loaded->unit_mm.has_value()));
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
  for (const LinkReport& l : registration.links)
    write_output(fmt::format("{:<28} {:<28} {:5.1f} %   {:.3e}   {:.3e}\n", (*views)[l.from].name, (*views)[l.to].name,
                             100 * l.overlap, l.pair_rms, l.rms));
  write_output(fmt::format(
      "{} views, rms {:.4g} (budget {:.4g}), median {:.4g}, closure {:.3f} degrees and {:.4g}, conflicts {:.2f} %\n{} "
      "points written\n",
      views->size(), registration.rms, options->max_rms, registration.median_offset, registration.closure.degrees,
      registration.closure.shift, 100 * registration.conflict, cloud.size()));
  if (registered->joined) write_series_table(*registered->joined);
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_register(VerbOptions& options) {
  auto o = std::make_shared<Options>();
  options
      .add("VIEWS", o->inputs,
           "range images, or folders of them: PLY with range_grid, PTX, organised PCD, E57 with rows and columns. With "
           "--step-deg every folder is one turn of the table in its order, and several, of the object turned over, are "
           "joined; without it views stand in any order and pose, clouds without a grid among them")
      .required();
  options.add_output("--out", o->out, "the merged, oriented cloud, PLY").required();
  options
      .add("--step-deg", o->steps_deg,
           "turn of the table from one view to the next, degrees; one for all folders, or one a folder as 60,45 (0: "
           "not known)")
      .separated_by(',');
  options.add("--axis", o->axis, "direction of the table's axis: x, y or z; unset: searched");
  const Option poses =
      options.add("--poses", o->poses,
                  "poses to start from (Stanford .conf) instead of a search; the result is in their common frame");
  options.flag("--upright", o->upright, "turn the result until the table's axis points along +z, ready for slicing")
      .excludes(poses);
  options.add("--budget", o->budget,
              "largest rms between the views, unit of the files; worse is refused. Unset: 0.6 grid spacings");
  options.add("--cut-below", o->cut_below,
              "removes the stand: what is lower than this above the lowest point, along the axis of each turn");
  options.add(
      "--units", o->units,
      "unit of the files (mm, cm, m, in); the result is in mm. Unset: what they state (E57: m), or lengths stay as "
      "they are");
  options.flag(
      "--keep-table", o->keep_table,
      "keeps the table below the object; unset: it is found in every turn and left out before turns are joined");
  options.flag("--accept-symmetry", o->accept_symmetry,
               "where a scan fits in several ways that each carry the whole body onto itself, take one of them");
  options.add("--seed", o->seed, "of the search for poses; same seed, same result").shows_default();
  options.add_output("--report", o->report, "every pair and the merge, JSON");
  options.add("--poses-out", o->poses_out, "the poses found, Stanford .conf");
  options.add_output("--picture", o->picture, "the merged cloud from four sides, PNG; red: two sheets");
  options.flag("--json", o->json, "print the report instead of the table");
  return [o](std::stop_token stop) { return run(*o, stop); };
}

}  // namespace telefab::scan
