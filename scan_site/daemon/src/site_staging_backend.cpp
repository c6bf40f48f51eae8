// SPDX-License-Identifier: GPL-3.0-or-later
#include "site_staging_backend.hpp"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <set>
#include <telefab/base/file.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/base/text.hpp>
#include <telefab/scan/slicing/job_parameters.hpp>
#include <telefab/service/profile_choice.hpp>
#include <telefab/transfer/second_name.hpp>

namespace telefab::scan {
namespace {

using Json = nlohmann::ordered_json;

constexpr auto kSubmitTimeout = std::chrono::seconds{5};
constexpr std::size_t kKeptNameBytes = 8;
constexpr std::uint64_t kMostKeptBytes = 1U << 20U;

Json json_of(const Upload& upload) {
  return {{"id", upload.id},
          {"name", upload.plan.name},
          {"size_bytes", upload.plan.size_bytes},
          {"received_bytes", upload.received_bytes},
          {"sha256", to_hex(upload.plan.content)},
          {"owner", upload.plan.owner},
          {"state", name_of(upload.state)}};
}

/// What a question is known by. The same words mean another print once the fab's profiles take the place of the site's.
std::string asked_text(const StagingQuestion& question, const SliceRequest& request,
                       const std::optional<ResinPrice>& price) {
  return json_text(Json{question.machine, question.goal, json_or_discarded(question.parameters),
                        to_hex(digest_of_profile(request.machine)), request.machine.assumed.size(),
                        price ? fmt::format("{} {}", price->per_litre, price->currency) : ""});
}

Json part_json(const ProfilePart& part) { return {{"name", part.name}, {"description", part.description}}; }

}  // namespace

SiteStagingBackend::SiteStagingBackend(UploadStore& uploads, DiskRoom& room, std::filesystem::path incoming,
                                       std::filesystem::path waiting, SubmitPost submit, NotePost note)
    : uploads_{uploads},
      room_{room},
      incoming_{std::move(incoming)},
      waiting_{std::move(waiting)},
      submit_{std::move(submit)},
      note_{std::move(note)},
      stager_{uploads, [this](std::uint64_t bytes) { return room_.check(bytes); }},
      copier_{"copier", [this](const std::string& task, std::stop_token stop) { copy(task, stop); }} {
  expect_missing();
  // Those that came whole before a restart, and that nobody checked.
  for (const Upload& upload : uploads_.list())
    if (upload.state == UploadState::Checking) stager_.read(upload.id);
  resume_copies();
}

Result<std::string> SiteStagingBackend::uploads() {
  const auto room = room_.room();
  if (!room) return tl::unexpected{room.error()};
  const UploadLimits& limits = uploads_.limits();
  Json list = Json::array();
  for (const Upload& upload : uploads_.list()) list.push_back(json_of(upload));
  return json_text({{"limit_bytes", limits.most_bytes},
                    {"room_bytes", *room},
                    {"part_bytes", limits.part_bytes},
                    {"most_uploads", limits.most_uploads},
                    {"kept_hours", std::chrono::duration<double, std::ratio<3600>>(limits.kept_for).count()},
                    {"uploads", list}});
}

Result<std::string> SiteStagingBackend::begin(const AnnouncedFile& file, std::string_view who) {
  remove_outlived();
  // A file that is known wants nothing more of the disk than its parts that are missing, which count already.
  bool is_known = false;
  for (const Upload& each : uploads_.list()) is_known |= each.plan.content == file.content;
  if (!is_known && file.size_bytes <= uploads_.limits().most_bytes)
    if (const auto room = room_.check(file.size_bytes); !room)
      return fail(room.error().code, fmt::format("the scan site has no room for {}: {}", file.name, room.error().what));
  const auto upload = uploads_.begin({file.name, file.size_bytes, file.content, std::string{who}});
  if (!upload) return tl::unexpected{upload.error()};
  expect_missing();
  if (!is_known)
    note_(std::string{who}, fmt::format("upload {} {} of {} bytes sha256 {}", upload->id, upload->plan.name,
                                        upload->plan.size_bytes, to_hex(upload->plan.content)));
  if (upload->state == UploadState::Checking || upload->state == UploadState::Whole) stager_.read(upload->id);
  return view(upload->id);
}

Result<std::string> SiteStagingBackend::append(std::string_view id, std::uint64_t from_bytes, std::string_view bytes) {
  const auto upload = uploads_.append(id, from_bytes, std::as_bytes(std::span{bytes}));
  expect_missing();
  if (!upload) return tl::unexpected{upload.error()};
  if (upload->state == UploadState::Checking) stager_.read(upload->id);
  return view(id);
}

Result<std::string> SiteStagingBackend::view(std::string_view id) {
  const auto upload = uploads_.find(id);
  if (!upload) return tl::unexpected{upload.error()};
  Json view = json_of(*upload);
  stager_.describe(upload->id, view);
  return json_text(view);
}

Result<void> SiteStagingBackend::discard(std::string_view id, std::string_view who) {
  if (auto removed = uploads_.remove(id); !removed) return removed;
  stager_.forget(std::string{id});
  expect_missing();
  note_(std::string{who}, fmt::format("discard upload {}", id));
  return {};
}

Result<Upload> SiteStagingBackend::whole(std::string_view id) {
  auto upload = uploads_.find(id);
  if (!upload) return upload;
  uploads_.touch(id);
  if (upload->state == UploadState::Whole) return upload;
  return fail(ErrorCode::Conflict,
              fmt::format("{} is {}: {} of {} bytes are here", upload->plan.name, name_of(upload->state),
                          upload->received_bytes, upload->plan.size_bytes));
}

Result<SiteStagingBackend::Asked> SiteStagingBackend::request_of(const StagingQuestion& question) const {
  const auto choice = profile_choice_of(question.machine, question.parameters);
  if (!choice) return tl::unexpected{choice.error()};
  auto composed = known_profiles()->compose(*choice);
  if (!composed) return tl::unexpected{composed.error()};
  auto parameters = job_parameters_from(question.parameters, composed->profile);
  if (!parameters) return tl::unexpected{parameters.error()};
  return Asked{std::move(parameters->slice), std::move(composed->price)};
}

Result<std::string> SiteStagingBackend::look(std::string_view id, const StagingQuestion& question) {
  if (const auto there = whole(id); !there) return tl::unexpected{there.error()};
  auto request = request_of(question);
  if (!request) return tl::unexpected{request.error()};
  const std::string asked = asked_text(question, request->slice, request->price);
  stager_.look(std::string{id}, std::move(request->slice), asked);
  return view(id);
}

Result<std::string> SiteStagingBackend::estimate(std::string_view id, const StagingQuestion& question) {
  if (const auto there = whole(id); !there) return tl::unexpected{there.error()};
  auto request = request_of(question);
  if (!request) return tl::unexpected{request.error()};
  const std::string asked = asked_text(question, request->slice, request->price);
  stager_.estimate(std::string{id}, std::move(request->slice), std::move(request->price), asked);
  return view(id);
}

Result<std::string> SiteStagingBackend::orient(std::string_view id, const StagingQuestion& question) {
  if (const auto there = whole(id); !there) return tl::unexpected{there.error()};
  auto request = request_of(question);
  if (!request) return tl::unexpected{request.error()};
  const auto goal = stand_for_from(question.goal.empty() ? "supports" : question.goal);
  if (!goal) return fail_in("for", goal.error());
  const std::string asked = asked_text(question, request->slice, request->price);
  stager_.orient(std::string{id}, std::move(request->slice), *goal, asked);
  return view(id);
}

Result<std::string> SiteStagingBackend::join(std::string_view id, const std::vector<std::string>& with,
                                             std::string_view who) {
  if (with.empty()) return fail(ErrorCode::InvalidInput, "with: the other views are missing");
  if (with.size() > uploads_.limits().most_uploads)
    return fail(ErrorCode::InvalidInput,
                fmt::format("with: at most {} views are joined", uploads_.limits().most_uploads));
  std::set<std::string_view> all{id};
  for (const std::string& other : with)
    if (!all.insert(other).second)
      return fail(ErrorCode::InvalidInput, fmt::format("with: {} is there twice", to_printable(other)));
  for (const std::string_view each : all)
    if (const auto there = whole(each); !there) return tl::unexpected{there.error()};
  note_(std::string{who}, fmt::format("join upload {} with {} more", id, with.size()));
  stager_.join(std::string{id}, with, std::string{who});
  return view(id);
}

Result<std::string> SiteStagingBackend::level(std::string_view id, std::uint64_t revision, std::uint32_t level) {
  const auto bytes = stager_.level(std::string{id}, revision, level);
  if (!bytes) return tl::unexpected{bytes.error()};
  return std::string{reinterpret_cast<const char*>(bytes->data()), bytes->size()};
}

Result<std::shared_ptr<SiteStagingBackend::Sending>> SiteStagingBackend::sending_of(std::string_view id,
                                                                                    const StagingQuestion& question,
                                                                                    std::string_view who) {
  const auto upload = whole(id);
  if (!upload) return tl::unexpected{upload.error()};
  const auto file = uploads_.file(id);
  if (!file) return tl::unexpected{file.error()};
  const auto asked = slice_parameters_from_json(question.parameters);
  if (!asked) return tl::unexpected{asked.error()};
  // A name of its own for the same bytes: the job takes that one, and the upload stays for the next job.
  const auto sending = std::make_shared<Sending>();
  sending->from = *file;
  sending->to = incoming_ / fmt::format("staged-{}-{}", id, ++submits_);
  sending->who = who;
  sending->submit.name = upload->plan.name;
  sending->submit.machine = question.machine;
  sending->submit.parameters = to_json(*asked);  // the same words as from a command line
  sending->submit.size_bytes = upload->plan.size_bytes;
  sending->submit.content = upload->plan.content;
  std::error_code ignored;  // what is in the way is told by what comes next
  std::filesystem::remove(sending->to, ignored);
  return sending;
}

Result<Job> SiteStagingBackend::submit(std::string_view id, const StagingQuestion& question, std::string_view who) {
  const auto made = sending_of(id, question, who);
  if (!made) return tl::unexpected{made.error()};
  const std::shared_ptr<Sending>& sending = *made;
  auto answer = sending->answer.get_future();
  const auto is_linked = give_second_name(sending->from, sending->to);
  if (!is_linked)
    return fail(is_linked.error().code,
                fmt::format("cannot keep {} for a job: {}", sending->submit.name, is_linked.error().what));
  if (*is_linked)
    make_job(sending);
  else if (auto waits = wait_for_copy(sending, id, question); !waits)
    return tl::unexpected{waits.error()};
  if (answer.wait_for(kSubmitTimeout) == std::future_status::ready) return answer.get();
  return fail(
      ErrorCode::Unreachable,
      *is_linked ? std::string{"the daemon is busy; look at the list of jobs before you send it again"}
                 : fmt::format("{} is still being copied, and will be in the list of jobs then", sending->submit.name));
}

Result<void> SiteStagingBackend::wait_for_copy(const std::shared_ptr<Sending>& sending, std::string_view id,
                                               const StagingQuestion& question) {
  if (const auto room = room_.check(sending->submit.size_bytes); !room)
    return fail(room.error().code, fmt::format("the scan site has no room for a copy of {}, and its file system gives "
                                               "a file no second name: {}",
                                               sending->submit.name, room.error().what));
  if (auto made = make_folder(waiting_); !made) return made;
  const auto name = random_hex(kKeptNameBytes);
  if (!name) return tl::unexpected{name.error()};
  sending->kept = waiting_ / *name;
  const std::string kept = json_text(Json{{"upload", id},
                                          {"machine", question.machine},
                                          {"parameters", json_or_discarded(question.parameters)},
                                          {"who", sending->who}});
  if (auto written = write_file_atomically(sending->kept, kept + "\n"); !written) return written;
  begin_copy(sending);
  return {};
}

void SiteStagingBackend::begin_copy(const std::shared_ptr<Sending>& sending) {
  const std::string task = sending->to.filename();
  room_.expect(task, sending->submit.size_bytes);
  {
    const std::lock_guard lock{mutex_};
    copies_.emplace(task, sending);
  }
  copier_.add(task);
}

Result<std::shared_ptr<SiteStagingBackend::Sending>> SiteStagingBackend::read_kept(const std::filesystem::path& file) {
  const auto bytes = read_file(file, kMostKeptBytes);
  if (!bytes) return tl::unexpected{bytes.error()};
  const auto kept = json_or_discarded({reinterpret_cast<const char*>(bytes->data()), bytes->size()});
  const auto text_of = [&](const char* key) {
    const auto found = kept.is_object() ? kept.find(key) : kept.end();
    return kept.is_object() && found != kept.end() && found->is_string() ? found->get<std::string>() : std::string{};
  };
  const std::string id = text_of("upload"), machine = text_of("machine");
  if (id.empty() || machine.empty() || !kept.contains("parameters"))
    return fail(ErrorCode::InvalidInput, fmt::format("{} is damaged", file.string()));
  auto sending = sending_of(id, {.machine = machine, .parameters = json_text(kept["parameters"])}, text_of("who"));
  if (sending) (*sending)->kept = file;
  return sending;
}

void SiteStagingBackend::resume_copies() {
  std::error_code none;  // nothing waits where there is no folder
  for (const auto& each : std::filesystem::directory_iterator{waiting_, none}) {
    const auto sending = read_kept(each.path());
    if (sending) {
      begin_copy(*sending);
      continue;
    }
    note_("telefab", fmt::format("submit failed: {} waited for its copy when the site ended, and {}",
                                 each.path().filename().string(), sending.error().what));
    std::filesystem::remove(each.path(), none);
  }
}

void SiteStagingBackend::make_job(const std::shared_ptr<Sending>& sending) {
  // Shared, for an answer that comes after whoever asked has given up.
  submit_(sending->submit, sending->to, sending->who, [sending](Result<Job> job) {
    std::error_code ignored;  // a job has taken it already
    if (!job) std::filesystem::remove(sending->to, ignored);
    sending->answer.set_value(std::move(job));
  });
}

void SiteStagingBackend::copy(const std::string& task, const std::stop_token& stop) {
  std::shared_ptr<Sending> sending;
  {
    const std::lock_guard lock{mutex_};
    sending = copies_.extract(task).mapped();
  }
  auto copied = copy_whole(sending->from, sending->to, stop);
  room_.expect(task, 0);
  if (copier_.is_ending()) {
    sending->answer.set_value(fail(ErrorCode::Unreachable, "the site ends; it makes the job when it begins again"));
    return;
  }
  // First: a job that was made and is still kept here would be made twice.
  std::error_code fault;
  if (!std::filesystem::remove(sending->kept, fault) && fault && copied)
    copied =
        fail(ErrorCode::StorageFailed, fmt::format("cannot remove {}: {}", sending->kept.string(), fault.message()));
  if (copied) return make_job(sending);
  const Error why{copied.error().code,
                  fmt::format("cannot keep {} for a job: {}", sending->submit.name, copied.error().what)};
  note_(sending->who, "submit failed: " + why.what);
  sending->answer.set_value(tl::unexpected{why});
}

std::string SiteStagingBackend::profiles() {
  const auto known = known_profiles();
  Json view{{"origin", ""}, {"machines", Json::array()}, {"resins", Json::array()}, {"prints", Json::array()}};
  {
    const std::lock_guard lock{mutex_};
    view["origin"] = origin_;
  }
  for (const MachineProfile& machine : known->machines()) {
    Json each{{"name", machine.name},
              {"description", machine.description},
              {"width_mm", machine.platform.width_mm},
              {"depth_mm", machine.platform.depth_mm},
              {"height_mm", machine.platform.z_travel_mm},
              {"pixel_mm", machine.projection.pixel_pitch_mm},
              {"layer_mm", machine.layers.thickness_mm},
              {"resin", machine.resin.name},
              {"vat_ml", machine.resin.vat_ml}};
    for (const ProfilePart* part : known->offered(ProfileKind::Machine))
      if (part->name == machine.name) {
        each["loaded_resin"] = part->loaded_resin;
        each["default_print"] = part->default_print;
      }
    view["machines"].push_back(std::move(each));
  }
  for (const ProfilePart* part : known->offered(ProfileKind::Resin)) view["resins"].push_back(part_json(*part));
  for (const ProfilePart* part : known->offered(ProfileKind::Print)) {
    Json each = part_json(*part);
    each["for_machine"] = part->for_machine;
    each["for_resin"] = part->for_resin;
    view["prints"].push_back(std::move(each));
  }
  return json_text(view);
}

void SiteStagingBackend::set_profiles(std::shared_ptr<const ProfileCatalogue> profiles, std::string origin) {
  const std::lock_guard lock{mutex_};
  profiles_ = std::move(profiles);
  origin_ = std::move(origin);
}

std::shared_ptr<const ProfileCatalogue> SiteStagingBackend::known_profiles() const {
  const std::lock_guard lock{mutex_};
  return profiles_;
}

void SiteStagingBackend::remove_outlived() {
  for (const std::string& id : uploads_.remove_outlived()) {
    stager_.forget(id);
    note_("telefab", fmt::format("discard upload {}: nobody has used it", id));
  }
  expect_missing();
}

}  // namespace telefab::scan
