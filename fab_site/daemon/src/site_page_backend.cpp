// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_page_backend.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <numeric>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/planning/plan_folder.hpp>
#include <telefab/fab/planning/preflight.hpp>
#include <telefab/fab/print/print_journal.hpp>
#include <telefab/fab/print/print_record.hpp>
#include <telefab/fab/print/print_time.hpp>
#include <telefab/geometry/contour_lines.hpp>
#include <telefab/service/profile_choice.hpp>

#include "intake.hpp"
#include "job_supports.hpp"
#include "printing_machine.hpp"

namespace telefab::fab {
namespace {

using nlohmann::ordered_json;

constexpr std::uint64_t kMaxFileBytes = 256U << 20U;
constexpr std::size_t kMostJobs = 200;
constexpr std::size_t kMostEvents = 500;

Result<std::string> text_of(const std::filesystem::path& path) {
  const auto bytes = read_file(path, kMaxFileBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  return std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

/// A job may be planned again; its plan then lies in another file. The earliest time where there is none.
std::filesystem::file_time_type time_of_plan(const std::filesystem::path& folder) {
  std::error_code error;
  return std::filesystem::last_write_time(folder / "plan" / "plan.json", error);
}

ordered_json rings_json(std::span<const Contour> contours) {
  ordered_json rings = ordered_json::array();
  for (const Contour& contour : contours) {
    ordered_json ring = ordered_json::array();
    for (const Point2 p : contour.vertices()) ring.push_back({p.x_mm, p.y_mm});
    rings.push_back(std::move(ring));
  }
  return rings;
}

std::string certificate_text(const LayerCertificate& c) {
  switch (c.verdict) {
    case LayerCertificate::Verdict::Measured:
      return "certified";
    case LayerCertificate::Verdict::Completed:
      return "certified, in part completed";
    case LayerCertificate::Verdict::Doubtful:
      return "flagged: " + sentence_of(c);
    case LayerCertificate::Verdict::Unchecked:
      break;
  }
  return "not checked";
}

/// A report on disk as JSON; null where there is none yet.
ordered_json report_part(const std::filesystem::path& path) {
  const auto text = text_of(path);
  if (!text) return {};
  ordered_json value = json_or_discarded(*text);
  return value.is_discarded() ? ordered_json{} : value;
}

}  // namespace

const SitePageBackend::Light* SitePageBackend::light_of(const Job& job) {
  if (is_before(job.state, JobState::AwaitingApproval)) return nullptr;
  const auto known = lights_.find(job.id);
  // A record comes when the print has ended, so what was read before is read again then, once.
  const auto folder = folder_.job(job.id);
  if (!folder) return nullptr;
  const auto planned = time_of_plan(*folder);
  if (known != lights_.end() && known->second.is_whole == is_final(job.state) && known->second.planned == planned)
    return &known->second;
  const auto composed = profiles_.compose({job.instance.empty() ? job.machine : job.instance});
  if (!composed) return nullptr;
  const MachineProfile* const machine = &composed->profile;
  const auto text = text_of(*folder / "plan" / "plan.json");
  if (!text) return nullptr;
  const auto plan = print_plan_from_json(*text);
  if (!plan) return nullptr;
  Light light;
  light.is_whole = is_final(job.state);
  light.planned = planned;
  light.irradiance_mw_per_cm2 = machine->projection.irradiance_mw_per_cm2;
  for (const PlannedLayer& layer : plan->layers) {
    light.planned_s.push_back(std::chrono::duration<double>(layer.exposure).count());
    light.share.push_back(layer.light_share);
  }
  const auto real_seconds = [&](Nanoseconds time) {
    return std::chrono::duration<double>(time).count() / machine->devices.speed_up;
  };
  const StagePace pace = stage_pace(*machine);
  light.print_s = real_seconds(print_time(*plan, {}, pace, {}));
  for (const Nanoseconds left : time_left(*plan, pace)) light.left_s.push_back(real_seconds(left));
  if (const auto written = text_of(*folder / "report" / "print.json"))
    if (const auto record = print_record_from_json(*written)) {
      light.measured.take(record->layers, light.planned_s.size());
    }
  if (const auto preflight = preflight_in(*folder / "plan"))
    for (const PreflightItem& item : preflight->items)
      if (item.name == "resin" && item.unit == "ml") light.resin_ml = item.value.value_or(0);
  if (const auto printed =
          composed_of_job(profiles_, job.instance.empty() ? job.machine : job.instance, job.parameters))
    light.price = printed->price;
  if (lights_.size() > kMostJobs) lights_.clear();
  return &lights_.insert_or_assign(job.id, std::move(light)).first->second;
}

void SitePageBackend::Measured::take(std::span<const LayerRecord> made, std::size_t layers) {
  exposure_s.assign(layers, {});
  resin_celsius.assign(layers, {});
  retries = 0;
  for (const LayerRecord& layer : made) {
    retries += layer.retries;
    if (layer.index.count() >= layers) continue;
    exposure_s[layer.index.count()] = std::chrono::duration<double>(layer.measured).count();
    resin_celsius[layer.index.count()] = layer.resin_celsius;
  }
}

const SitePageBackend::Measured& SitePageBackend::measured_so_far(const Job& job, std::size_t layers) {
  const auto path = folder_.path() / "jobs" / job.id / "journal";
  std::error_code error;
  const std::uintmax_t bytes = std::filesystem::file_size(path, error);
  if (!error && live_.job == job.id && live_.journal_bytes == bytes) return live_.measured;
  live_ = {job.id, bytes, {}};
  // Read beside the print that writes it: a copy, whose torn end is cut off and not the journal's.
  if (auto text = text_of(path))
    if (const auto journal = PrintJournal::open(memory_journal_file(*text)))
      live_.measured.take(journal->layers(), layers);
  return live_.measured;
}

JobView SitePageBackend::view_of(const Job& job) {
  const JobCounters& c = job.counters;
  const auto share = [](std::uint32_t done, std::uint32_t all) {
    return all == 0 ? 0.0 : std::min(1.0, static_cast<double>(done) / all);
  };
  JobView view;
  view.id = job.id;
  view.name = job.name;
  view.owner = job.owner;
  view.machine = job.machine;
  view.instance = job.instance;
  view.state = job.state;
  view.message = job.message;
  const JobQuestions questions = questions_(job.id);
  view.exposure_unknown = job.state == JobState::Paused && questions.open == OpenQuestion::Exposure;
  view.start_unknown = job.state == JobState::Paused && questions.open == OpenQuestion::Start;
  view.waits_for_platform = !questions.platform.empty();
  view.platform = questions.platform;
  // Until the plan is on disk there is no print layer to look at.
  view.layers = !is_before(job.state, JobState::AwaitingApproval) ? c.print_layers : 0;
  view.layers_received = c.layers_sent;
  view.layers_printed = c.layers_printed;
  view.bytes_received = c.wire_bytes;
  view.progress = job.state == JobState::Sending    ? share(c.layers_sent, c.layers)
                  : job.state == JobState::Planning ? share(c.layers_planned, c.print_layers)
                                                    : share(c.layers_printed, c.print_layers);
  view.created_unix_s = job.created_unix_ms / 1000;
  if (view.layers > 0)
    if (const auto folder = folder_.job(job.id))
      view.planned_unix_ms = std::chrono::duration_cast<std::chrono::milliseconds>(
                                 std::chrono::file_clock::to_sys(time_of_plan(*folder)).time_since_epoch())
                                 .count();
  view.stage_seconds = job.stages;
  if (const Light* light = light_of(job)) {
    const bool is_ahead = job.state == JobState::AwaitingApproval || job.state == JobState::Ready ||
                          job.state == JobState::Printing || job.state == JobState::Paused;
    const std::size_t printed = std::min<std::size_t>(c.layers_printed, light->left_s.size() - 1);
    if (is_ahead) view.seconds_left = printed == 0 ? light->print_s : light->left_s[printed];
    view.print_seconds = light->print_s;
    view.resin_ml = light->resin_ml;
    if (light->price) {
      view.cost = light->price->of_ml(light->resin_ml);
      view.currency = light->price->currency;
    }
    view.planned_exposure_s = std::accumulate(light->planned_s.begin(), light->planned_s.end(), 0.0);
    for (const auto& seconds : light->measured.exposure_s) view.measured_exposure_s += seconds.value_or(0);
    view.retries = light->measured.retries;
  }
  return view;
}

Result<std::vector<JobView>> SitePageBackend::jobs() {
  const auto jobs = store_.current(kMostJobs);
  if (!jobs) return tl::unexpected{jobs.error()};
  std::vector<JobView> views;
  for (const Job& job : *jobs) views.push_back(view_of(job));
  return views;
}

Result<JobViewPage> SitePageBackend::find(const JobQuery& query) {
  const auto found = store_.list(query);
  if (!found) return tl::unexpected{found.error()};
  JobViewPage page;
  page.next = found->next;
  for (const Job& job : found->jobs) page.jobs.push_back(view_of(job));
  return page;
}

Result<JobView> SitePageBackend::job(std::string_view id) {
  const auto job = store_.find(id);
  if (!job) return tl::unexpected{job.error()};
  return view_of(*job);
}

Result<std::vector<JobEventView>> SitePageBackend::events(std::string_view id) {
  if (const auto job = store_.find(id); !job) return tl::unexpected{job.error()};
  const auto events = store_.events(id, 0, kMostEvents);
  if (!events) return tl::unexpected{events.error()};
  std::vector<JobEventView> views;
  for (const JobEvent& event : *events) views.push_back({event.unix_ms, event.text});
  return views;
}

Result<std::filesystem::path> SitePageBackend::plan_file(std::string_view id, std::string_view name) {
  if (const auto job = store_.find(id); !job) return tl::unexpected{job.error()};
  const auto folder = folder_.job(id);
  if (!folder) return tl::unexpected{folder.error()};
  return *folder / "plan" / name;
}

Result<std::string> SitePageBackend::report(std::string_view id) {
  const auto path = plan_file(id, "report.json");
  if (!path) return tl::unexpected{path.error()};
  const auto folder = path->parent_path().parent_path();
  ordered_json print = report_part(folder / "report" / "print.json");
  if (print.is_object()) print.erase("layers");  // hundreds of rows; `telefab report` fetches the whole file
  const ordered_json value{{"plan", report_part(*path)},
                           {"preflight", report_part(path->parent_path() / "preflight.json")},
                           {"print", print}};
  if (value["plan"].is_null()) return fail(ErrorCode::NotFound, "there is no report before the job is planned");
  return json_text(value);
}

Result<std::string> SitePageBackend::preflight(std::string_view id) {
  const auto path = plan_file(id, "preflight.json");
  if (!path) return tl::unexpected{path.error()};
  const auto text = text_of(*path);
  if (!text) return fail(ErrorCode::NotFound, "the job is not planned yet");
  return text;
}

Result<std::string> SitePageBackend::exposures(std::string_view id) {
  const auto job = store_.find(id);
  if (!job) return tl::unexpected{job.error()};
  const Light* light = light_of(*job);
  if (!light) return fail(ErrorCode::NotFound, "the job is not planned yet");
  const auto list = [](const std::vector<std::optional<double>>& values) {
    ordered_json array = ordered_json::array();
    for (const auto& value : values) array.push_back(value ? ordered_json(*value) : ordered_json{});
    return array;
  };
  const Measured& measured = is_final(job->state) ? light->measured : measured_so_far(*job, light->planned_s.size());
  return json_text({{"irradiance_mw_per_cm2", light->irradiance_mw_per_cm2},
                    {"planned_s", light->planned_s},
                    {"light_share", light->share},
                    {"measured_s", list(measured.exposure_s)},
                    {"resin_celsius", list(measured.resin_celsius)}});
}

Result<std::vector<std::byte>> SitePageBackend::mask_png(std::string_view id, std::uint32_t layer) {
  const auto path = plan_file(id, fmt::format("masks/{:05}.png", layer));
  if (!path) return tl::unexpected{path.error()};
  return read_file(*path, kMaxFileBytes);
}

Result<std::vector<std::byte>> SitePageBackend::preview_png(std::string_view id) {
  const auto path = plan_file(id, "preview.png");
  if (!path) return tl::unexpected{path.error()};
  return read_file(*path, kMaxFileBytes);
}

Result<std::vector<std::byte>> SitePageBackend::view_png(std::string_view id) {
  const auto path = plan_file(id, "view.png");
  if (!path) return tl::unexpected{path.error()};
  std::error_code error;
  if (!std::filesystem::exists(*path, error)) return preview_png(id);  // planned before there were any
  return read_file(*path, kMaxFileBytes);
}

Result<std::vector<std::byte>> SitePageBackend::accuracy_png(std::string_view id) {
  const auto plan = plan_file(id, "");
  if (!plan) return tl::unexpected{plan.error()};
  const auto path = plan->parent_path().parent_path() / "report" / "accuracy.png";
  std::error_code error;
  if (!std::filesystem::exists(path, error))
    return fail(ErrorCode::NotFound, "the accuracy is computed in the background once the job is planned");
  return read_file(path, kMaxFileBytes);
}

Result<const SitePageBackend::LayerImages*> SitePageBackend::layer_images_of(std::string_view id) {
  const auto path = plan_file(id, "supports.jsonl");
  if (!path) return tl::unexpected{path.error()};  // forgotten, perhaps
  const auto planned = time_of_plan(path->parent_path().parent_path());
  if (layer_images_ && layer_images_->job == id && layer_images_->planned == planned) return &*layer_images_;
  const auto lines = text_of(*path);
  if (!lines) return fail(ErrorCode::NotFound, "the layers can be looked at once the job is planned");
  auto part = received_stack(path->parent_path().parent_path());
  if (!part) return tl::unexpected{part.error()};
  LayerImages images{std::string{id}, planned, std::move(part->layers), {}, {}, {}};
  if (const auto job = store_.find(id))
    if (const auto machine = profiles_.compose({job->instance.empty() ? job->machine : job->instance}))
      images.platform_mm = {machine->profile.platform.width_mm, machine->profile.platform.depth_mm};
  const auto read = read_json_lines(*lines, [&](Layer layer) -> Result<void> {
    images.supports.push_back(std::move(layer));
    return {};
  });
  if (!read) return fail_in(path->string(), read.error());
  Bounds2 box = bounds_of(images.part.layers());
  box.include(bounds_of(images.supports));
  if (!box.is_nothing()) images.bounds = box;
  layer_images_ = std::move(images);
  return &*layer_images_;
}

Result<std::string> SitePageBackend::layer_json(std::string_view id, std::uint32_t layer) {
  const auto found = layer_images_of(id);
  if (!found) return tl::unexpected{found.error()};
  const LayerImages& s = **found;
  if (layer >= s.supports.size())
    return fail(ErrorCode::NotFound, fmt::format("the print has {} layers", s.supports.size()));
  const std::size_t elevation = s.supports.size() - s.part.layers().size();
  const Layer* part = layer >= elevation ? &s.part.layers()[layer - elevation] : nullptr;
  const double thickness_mm = s.part.header().layer_thickness_mm;
  return json_text({{"layer", layer},
                    {"z_mm", cut_height_mm(LayerIndex{layer}, thickness_mm)},
                    {"thickness_mm", thickness_mm},
                    {"platform_mm", s.platform_mm ? ordered_json(*s.platform_mm) : ordered_json{}},
                    {"bounds", {s.bounds.min.x_mm, s.bounds.min.y_mm, s.bounds.max.x_mm, s.bounds.max.y_mm}},
                    {"part", part ? rings_json(part->contours) : ordered_json::array()},
                    {"supports", rings_json(s.supports[layer].contours)},
                    {"certificate", part ? certificate_text(part->certificate) : "below the part"}});
}

Result<std::string> SitePageBackend::supports(std::string_view id) {
  const auto plan = plan_file(id, "");
  if (!plan) return tl::unexpected{plan.error()};
  return supports_json(plan->parent_path().parent_path());
}

Result<void> SitePageBackend::plan_again(std::string_view id, std::string_view hand_list, std::string_view who) {
  const auto list = hand_list_from_json(hand_list);
  if (!list) return tl::unexpected{list.error()};
  const auto job = command_and_wait(
      [&](const Command&, std::function<void(Result<Job>)> done) {
        supported_(std::string{id}, *list, std::string{who}, std::move(done));
      },
      {});
  if (!job) return tl::unexpected{job.error()};
  return {};
}

Result<void> SitePageBackend::act(std::string_view id, JobCommand action, std::string_view who) {
  return carry_out(post_, action, id, who);
}

Result<void> SitePageBackend::approve(std::string_view id, std::string_view although, std::string_view who) {
  return carry_out(post_, JobCommand::Approve, id, who, although);
}

Result<void> SitePageBackend::clear_platform(std::string_view machine, std::string_view who) {
  return carry_out(post_, JobCommand::Cleared, machine, who);
}

std::vector<UploadTarget> SitePageBackend::upload_targets(std::string_view asked) {
  // A profile of which no machine would take the job is passed over for its machines, which follow it.
  std::vector<UploadTarget> targets;
  const auto offered = profiles_.offered(ProfileKind::Machine);  // in the order of machines()
  const auto standing = asker_.standing();
  for (std::size_t i = 0; i < offered.size(); ++i) {
    const bool is_taken = std::ranges::any_of(standing, [&](const MachineStatus& machine) {
      MachineInstance instance;
      instance.name = machine.name;
      instance.profile = machine.profile;
      instance.is_stated = true;
      const auto fit = fit_of(profiles_, instance, {offered[i]->name});
      return fit && *fit == InstanceFit::Fits;
    });
    if (is_taken) targets.push_back({offered[i]->name, profiles_.machines()[i]});
  }
  // A folder that is no machine's is its sender's own affair.
  if (std::ranges::find(targets, asked, &UploadTarget::asked) != targets.end())
    std::erase_if(targets, [&](const UploadTarget& target) { return target.asked != asked; });
  return targets;
}

Result<std::string> SitePageBackend::take_file(std::string_view folder, std::string_view name, std::string_view bytes,
                                               bool start, std::string_view who) {
  return make_job(write_upload(folder_, upload_targets(folder), name, std::as_bytes(std::span{bytes}), start, who));
}

Result<std::string> SitePageBackend::print_again(std::string_view id, std::string_view who) {
  const auto job = store_.find(id);
  if (!job) return tl::unexpected{job.error()};
  return make_job(write_again(folder_, *job, who));
}

Result<std::string> SitePageBackend::make_job(const Result<NewJob>& written) {
  if (!written) return tl::unexpected{written.error()};
  const auto job = command_and_wait(
      [&](const Command&, std::function<void(Result<Job>)> done) { uploaded_(*written, std::move(done)); }, {});
  if (!job) return tl::unexpected{job.error()};
  return job->id;
}

std::string SitePageBackend::devices_json() {
  ordered_json value;
  for (const MachineStatus& standing : asker_.standing()) {
    const auto found = profiles_.compose({standing.name});
    if (!found) continue;
    const MachineProfile& machine = found->profile;
    const std::string made_of =
        fab::light_of(machine) == LightOf::WholePrinter
            ? fmt::format("a whole printer ({})", name_of(machine.devices.printer))
            : fmt::format("projector {}, stage {}", name_of(machine.devices.projector), name_of(machine.devices.stage));
    value[standing.name] = fmt::format("{}, {} x {} pixels, layers of {} mm", made_of, machine.mask_size().width_px,
                                       machine.mask_size().height_px, machine.layers.thickness_mm);
  }
  return json_text(value);
}

}  // namespace telefab::fab
