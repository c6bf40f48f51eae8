// SPDX-License-Identifier: GPL-3.0-or-later
// Scans joined without poses, against the truth: two series of a turned-over object, views in any order, and sets with
// something in them that does not belong. Run by hand; a line a trial, then a row of the table for each model.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <map>
#include <optional>
#include <telefab/base/file.hpp>

#include "virtual_scans.hpp"

namespace telefab::campaign {
namespace {

constexpr double kRightDeg = 0.5, kRightMm = 0.5;  ///< farther from the truth is a silent misfit

struct Settings {
  std::vector<std::string> models;
  std::string set = "series";
  std::string scans;
  int turns = 5;
  std::uint64_t first_seed = 1;
  double noise_mm = 0.05, overlap = 0.15;
  bool accept_symmetry = false;
};

enum class Outcome { Right, Wrong, Refused, TurnFailed };

struct Trial {
  Outcome outcome = Outcome::Refused;
  std::string reason;
  std::vector<double> degrees, mm;  ///< one a view but the first
  double seconds = 0, cpu_seconds = 0;
};

double now_s() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

/// Wall and processor time of the join alone.
class Stopwatch {
 public:
  void read(Trial& trial) const {
    trial.seconds = now_s() - wall_;
    trial.cpu_seconds = static_cast<double>(std::clock() - cpu_) / CLOCKS_PER_SEC;
  }

 private:
  double wall_ = now_s();
  std::clock_t cpu_ = std::clock();
};

double median_of(std::vector<double> v) {
  if (v.empty()) return 0;
  const auto middle = v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2);
  std::nth_element(v.begin(), middle, v.end());
  return *middle;
}

void compare(const scan::Joined& joined, const std::vector<scan::RigidMotion>& to_model, Trial& trial) {
  const scan::RigidMotion first = to_model[joined.kept[0]].inverse();
  for (std::size_t i = 1; i < joined.kept.size(); ++i) {
    const scan::RigidMotion truth = first * to_model[joined.kept[i]];
    const scan::Vec3 middle = truth.inverse() * (first * scan::Vec3::Zero());
    const auto d = scan::difference(joined.registration.poses[i], truth, middle);
    trial.degrees.push_back(d.degrees);
    trial.mm.push_back(d.shift);
  }
  const bool is_right = std::ranges::all_of(trial.degrees, [](double d) { return d < kRightDeg; }) &&
                        std::ranges::all_of(trial.mm, [](double d) { return d < kRightMm; });
  trial.outcome = is_right ? Outcome::Right : Outcome::Wrong;
  for (const auto& s : joined.series)
    trial.reason +=
        fmt::format(" [{} {}: overlap {:.2f} rms/noise {:.2f} {:.2f} conflict {} stiffness {:.4f} runner-up {:.2f}]",
                    s.name, scan::name_of(s.verdict), s.overlap, s.noise > 0 ? s.rms / s.noise : 0,
                    s.patch_noise > 0 ? s.patch_rms / s.patch_noise : 0,
                    s.conflict ? fmt::format("{:.4f}", *s.conflict) : "-", s.stiffness, s.runner_up);
}

/// Registers a turn on its own; nothing if that is refused.
std::optional<scan::ViewSeries> series_of(Turn& turn, std::string name, std::size_t first_view) {
  auto registered = scan::register_views(turn.images, {.step_deg = 60, .max_rms = 0.6}, {}, {});
  if (!registered) return std::nullopt;
  scan::ViewSeries series{std::move(name), {}, registered->poses};
  for (std::size_t i = 0; i < turn.images.size(); ++i) series.views.push_back(first_view + i);
  return series;
}

Trial join(std::vector<scan::RangeImage> images, const std::vector<scan::ViewSeries>& series,
           const std::vector<scan::RigidMotion>& to_model, const Settings& settings, std::uint64_t seed) {
  Trial trial;
  double spacing = 0;
  for (const auto& image : images) spacing = std::max(spacing, static_cast<double>(image.spacing));
  const Stopwatch watch;
  const auto joined = scan::join_views(
      images, series, {.max_rms = 0.6 * spacing, .accept_symmetry = settings.accept_symmetry, .seed = seed}, {}, {});
  watch.read(trial);
  if (joined)
    compare(*joined, to_model, trial);
  else
    trial.reason = " " + joined.error().what;
  return trial;
}

/// Keeps what lies on one side of a plane across x; the two sides of a pair share a slab.
auto half_space(double at, bool lower) {
  return [at, lower](const scan::Vec3& p) { return lower ? p.x() < at : p.x() > at; };
}

Trial try_series(const scan::DigitizeModel& model, const scan::DigitizeModel* other, const Settings& settings,
                 std::uint64_t seed) {
  std::mt19937_64 random{seed};
  const scan::RigidMotion over = turned_over(random);
  TurnOptions options{.noise_mm = settings.noise_mm, .seed = 1000 + 2 * seed};
  if (settings.set == "thin") options.keep = half_space(40 * settings.overlap, true);
  Turn a = take_turn(model, scan::RigidMotion::Identity(), options);
  ++options.seed;
  if (settings.set == "thin") options.keep = half_space(-40 * settings.overlap, false);
  Turn b = take_turn(settings.set == "mirror" ? mirrored(model) : other != nullptr ? *other : model, over, options);
  if (settings.set == "twice") b = a;
  Trial trial{.outcome = Outcome::TurnFailed};
  if (a.images.size() < 6 || b.images.size() < 6) return trial;
  const auto first = series_of(a, "first", 0), second = series_of(b, "second", a.images.size());
  if (!first || !second) return trial;
  a.images.insert(a.images.end(), b.images.begin(), b.images.end());
  a.to_model.insert(a.to_model.end(), b.to_model.begin(), b.to_model.end());
  return join(std::move(a.images), {*first, *second}, a.to_model, settings, seed);
}

/// The views of a scanned turn in any order; poses by the turn are the truth. What is put among them must stay out.
Trial try_shuffled(const Turn& turn, const std::vector<scan::RangeImage>& foreign_views, const Settings& settings,
                   std::uint64_t seed) {
  std::mt19937_64 random{seed};
  std::vector<scan::RangeImage> images = turn.images;
  std::vector<scan::RigidMotion> to_model = turn.to_model;
  if (settings.set == "shuffled-twice") {
    const std::size_t copy = random() % images.size();
    images.push_back(images[copy]);
    to_model.push_back(to_model[copy]);
    images.back().name = "copy";
  }
  for (const scan::RangeImage& s : foreign_views) {
    images.push_back(s);
    images.back().name = "foreign";
    to_model.push_back(scan::RigidMotion::Identity());
  }
  for (std::size_t i = images.size() - 1; i > 0; --i) {
    const std::size_t j = random() % (i + 1);
    std::swap(images[i], images[j]);
    std::swap(to_model[i], to_model[j]);
  }
  std::vector<scan::ViewSeries> series;
  std::vector<bool> is_foreign;
  for (std::size_t i = 0; i < images.size(); ++i) {
    series.push_back({images[i].name, {i}, {scan::RigidMotion::Identity()}});
    is_foreign.push_back(images[i].name == "foreign");
  }
  const double unit = static_cast<double>(images[0].spacing) < 0.01 ? 1000 : 1;  // metres: the truth is held in mm
  Trial trial;
  double spacing = 0;
  for (const auto& image : images) spacing = std::max(spacing, static_cast<double>(image.spacing));
  const Stopwatch watch;
  const auto joined = scan::join_views(images, series, {.max_rms = 0.6 * spacing, .seed = seed}, {}, {});
  watch.read(trial);
  if (!joined) {
    trial.reason = " " + joined.error().what;
    return trial;
  }
  bool has_foreign = false;
  scan::RigidMotion first = to_model[joined->kept[0]].inverse();
  for (std::size_t i = 0; i < joined->kept.size(); ++i) {
    has_foreign |= is_foreign[joined->kept[i]];
    if (i == 0) continue;
    scan::Vec3 middle = scan::Vec3::Zero();
    for (const auto& p : images[i].points) middle += p.cast<double>() / static_cast<double>(images[i].points.size());
    const auto d = scan::difference(joined->registration.poses[i], first * to_model[joined->kept[i]], middle);
    trial.degrees.push_back(d.degrees);
    trial.mm.push_back(d.shift * unit);
  }
  const bool is_right = !has_foreign && std::ranges::all_of(trial.degrees, [](double d) { return d < 1; }) &&
                        std::ranges::all_of(trial.mm, [](double d) { return d < 1; });
  trial.outcome = is_right ? Outcome::Right : Outcome::Wrong;
  trial.reason = fmt::format(" {} of {} joined, noise {:.3f} spacings;", joined->kept.size(), series.size(),
                             joined->noise / spacing);
  for (const auto& s : joined->series)
    if (!s.is_joined())
      trial.reason += fmt::format(" [{} {}: rms/noise {:.2f} {:.2f} overlap {:.2f}]", s.name, scan::name_of(s.verdict),
                                  s.noise > 0 ? s.rms / s.noise : 0,
                                  s.patch_noise > 0 ? s.patch_rms / s.patch_noise : 0, s.overlap);
    else
      trial.reason += fmt::format(" ({:.2f} {:.2f} {:.2f} {:.4f} {:.3f})", s.noise > 0 ? s.rms / s.noise : 0,
                                  s.patch_noise > 0 ? s.patch_rms / s.patch_noise : 0, s.overlap,
                                  s.conflict.value_or(-1), s.stiffness);
  return trial;
}

Turn load_scans(const std::string& folder) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator{folder})
    if (entry.path().extension() == ".ply") files.push_back(entry.path());
  std::sort(files.begin(), files.end(), [](const auto& l, const auto& r) {
    const auto angle = [](const std::filesystem::path& p) {
      const std::string name = p.stem().string();
      return std::stoi(name.substr(name.find_last_of('_') + 1));
    };
    return angle(l) < angle(r);
  });
  Turn turn;
  for (const auto& path : files) {
    const auto bytes = read_file(path, 1ULL << 30U);
    const auto file = scan::read_scan_file(*bytes, path.string(), {}, {});
    turn.images.push_back(*scan::make_range_image(*file, 0, path.stem().string()));
  }
  auto copy = turn.images;
  const auto registered = scan::register_views(
      copy,
      {.step_deg = 360.0 / static_cast<double>(copy.size()), .max_rms = 10 * static_cast<double>(copy[0].spacing)}, {},
      {});
  if (!registered) {
    fmt::print(stderr, "{}: {}\n", folder, registered.error().what);
    std::exit(1);
  }
  turn.to_model = registered->poses;
  return turn;
}

void print_row(const std::string& name, const std::vector<Trial>& trials) {
  std::map<Outcome, int> count;
  std::vector<double> degrees, mm, seconds, cpu;
  for (const Trial& t : trials) {
    ++count[t.outcome];
    if (t.outcome != Outcome::TurnFailed) {
      seconds.push_back(t.seconds);
      cpu.push_back(t.cpu_seconds);
    }
    if (t.outcome != Outcome::Right) continue;
    degrees.insert(degrees.end(), t.degrees.begin(), t.degrees.end());
    mm.insert(mm.end(), t.mm.begin(), t.mm.end());
  }
  fmt::print(
      "| {} | {} | right {} | refused {} | WRONG {} | turn refused {} | {:.3f} (worst {:.3f}) degrees | {:.3f} (worst "
      "{:.3f}) mm | {:.1f} s, {:.1f} CPU s |\n",
      name, trials.size(), count[Outcome::Right], count[Outcome::Refused], count[Outcome::Wrong],
      count[Outcome::TurnFailed], median_of(degrees), degrees.empty() ? 0 : *std::ranges::max_element(degrees),
      median_of(mm), mm.empty() ? 0 : *std::ranges::max_element(mm), median_of(seconds), median_of(cpu));
}

void print_trial(const std::string& name, std::uint64_t seed, const Trial& t) {
  constexpr std::array kNames{"right", "WRONG", "refused", "turn refused"};
  fmt::print("{} seed {}: {} {:.3f} degrees {:.3f} mm {:.1f} s {:.1f} CPU s{}\n", name, seed,
             kNames[static_cast<std::size_t>(t.outcome)], median_of(t.degrees), median_of(t.mm), t.seconds,
             t.cpu_seconds, t.reason);
  (void)std::fflush(stdout);
}

int run(const Settings& settings) {
  std::vector<scan::DigitizeModel> models;
  std::vector<std::string> names;
  for (const std::string& path : settings.models) {
    models.push_back(load_model(path));
    names.push_back(std::filesystem::path{path}.stem().string());
  }
  std::vector<std::pair<std::string, std::vector<Trial>>> table;
  const auto run_all = [&](const std::string& name, auto trial_of) {
    std::vector<Trial> trials;
    for (int t = 0; t < settings.turns; ++t) {
      const std::uint64_t seed = settings.first_seed + static_cast<std::uint64_t>(t);
      trials.push_back(trial_of(seed));
      print_trial(name, seed, trials.back());
    }
    table.emplace_back(name, std::move(trials));
  };
  if (!settings.scans.empty()) {
    const Turn turn = load_scans(settings.scans);
    run_all("shuffled scans", [&](std::uint64_t seed) {
      std::vector<scan::RangeImage> foreign_views;
      if (settings.set == "shuffled-other")
        for (std::size_t i = 0; i < 2 && !models.empty(); ++i) {
          scan::DigitizeModel model = models[(seed + i) % models.size()];
          const double unit = static_cast<double>(turn.images[0].spacing) / 0.6;
          auto views = take_turn(model, scan::RigidMotion::Identity(), {.noise_mm = settings.noise_mm, .seed = seed});
          scan::RangeImage foreign = views.images[seed % views.images.size()];
          for (auto& p : foreign.points) p *= static_cast<float>(unit);
          foreign.spacing *= static_cast<float>(unit);
          if (foreign.projection) {
            foreign.projection->row.head<3>() /= unit;
            foreign.projection->column.head<3>() /= unit;
          }
          foreign_views.push_back(std::move(foreign));
        }
      if (settings.set == "shuffled-mirror") {
        scan::RangeImage m = turn.images[seed % turn.images.size()];
        for (auto& p : m.points) p.x() = -p.x();
        for (auto& n : m.normals) n.x() = -n.x();
        if (m.projection) {
          m.projection->row.x() *= -1;
          m.projection->column.x() *= -1;
          m.projection->towards_scanner.x() *= -1;
        }
        foreign_views.push_back(std::move(m));
      }
      return try_shuffled(turn, foreign_views, settings, seed);
    });
  } else {
    for (std::size_t m = 0; m < models.size(); ++m) {
      if (settings.set.starts_with("shuffled")) {
        run_all(names[m], [&](std::uint64_t seed) {
          const Turn turn = take_turn(models[m], scan::RigidMotion::Identity(),
                                      {.step_deg = 36, .noise_mm = settings.noise_mm, .seed = seed});
          std::vector<scan::RangeImage> foreign_views;
          const scan::DigitizeModel model =
              settings.set == "shuffled-mirror" ? mirrored(models[m]) : models[(m + 1) % models.size()];
          if (settings.set == "shuffled-other" || settings.set == "shuffled-mirror")
            foreign_views.push_back(
                take_turn(model, scan::RigidMotion::Identity(), {.noise_mm = settings.noise_mm, .seed = seed + 77})
                    .images[seed % 6]);
          return try_shuffled(turn, foreign_views, settings, seed);
        });
        continue;
      }
      const scan::DigitizeModel* other = settings.set == "other" ? &models[(m + 1) % models.size()] : nullptr;
      run_all(names[m], [&](std::uint64_t seed) { return try_series(models[m], other, settings, seed); });
    }
  }
  fmt::print("\n");
  for (const auto& [name, trials] : table) print_row(name, trials);
  return 0;
}

}  // namespace
}  // namespace telefab::campaign

int main(int argc, char** argv) {
  telefab::campaign::Settings settings;
  CLI::App app{"Joins scans without poses and compares with the truth."};
  app.add_option("models", settings.models, "meshes, or knot, torus, sphere");
  app.add_option(
         "--set", settings.set,
         "two series: series, mirror (the second of the mirrored model), other (of the next model), thin (cut to "
         "--overlap), twice; single views of one turn: shuffled, shuffled-mirror, shuffled-other, shuffled-twice")
      ->check(CLI::IsMember({"series", "mirror", "other", "thin", "twice", "shuffled", "shuffled-mirror",
                             "shuffled-other", "shuffled-twice"}));
  app.add_option("--scans", settings.scans, "a folder of the range images of one turn, NAME_ANGLE.ply: shuffled");
  app.add_option("--turns", settings.turns, "trials a model, each of another seed");
  app.add_option("--first-seed", settings.first_seed, "seed of the first trial");
  app.add_option("--noise-mm", settings.noise_mm, "sigma along the line of sight");
  app.add_option("--overlap", settings.overlap, "of `thin`: half the slab that both see, over half the size");
  app.add_flag("--accept-symmetry", settings.accept_symmetry, "as of register");
  CLI11_PARSE(app, argc, argv);
  return telefab::campaign::run(settings);
}
