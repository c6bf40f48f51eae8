// SPDX-License-Identifier: GPL-3.0-or-later
#include "prusalink.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <telefab/base/digest.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/text.hpp>
#include <tl/expected.hpp>

#include "job_on_machine.hpp"
#include "uploads.hpp"

namespace telefab::fab {
namespace {

using nlohmann::ordered_json;

constexpr const char* kStorage = "/local";
constexpr const char* kStorageName = "Telefab";

WebResponse with(unsigned status, const ordered_json& value) { return {status, "application/json", json_text(value)}; }
WebResponse nothing() { return {204, "application/json", ""}; }
WebResponse problem(const Error& error) { return prusalink_problem(web_problem(error).status, error.what); }

bool is_printed(const JobView& job) { return job.state == JobState::Printing || job.state == JobState::Paused; }

/// What the API calls a job by: it wants a number. The digest's first 31 bits; never 0.
std::uint32_t number_of(const JobView& job) {
  const Digest digest = digest_of(std::as_bytes(std::span{job.id}));
  std::uint32_t number = 0;
  for (std::size_t i = 0; i < 4; ++i) number = number << 8U | static_cast<std::uint32_t>(digest.bytes.at(i));
  return std::max(number >> 1U, 1U);
}

const JobView* job_of_file(const std::vector<JobView>& jobs, std::string_view path) {
  const std::string_view name = base_name(path);
  const auto newest =
      std::ranges::find_if(jobs, [&](const JobView& job) { return job.id == path || job.name == name; });
  return newest == jobs.end() ? nullptr : &*newest;
}

ordered_json file_json(const JobView& job) {
  ordered_json refs{{"resource", "/v1/jobs/" + job.id}};
  if (job.layers > 0) refs["thumbnail"] = "/v1/jobs/" + job.id + "/view.png";
  ordered_json value{{"name", job.id},
                     {"display_name", job.name},
                     {"path", kStorage},
                     {"type", "PRINT_FILE"},
                     {"size", job.bytes_received},
                     {"m_timestamp", job.created_unix_s},
                     {"read_only", false},
                     {"refs", refs}};
  ordered_json meta{{"state", name_of(job.state)}, {"machine", job.machine}};
  if (job.print_seconds > 0) meta["estimated_print_time"] = std::llround(job.print_seconds);
  value["meta"] = std::move(meta);
  return value;
}

ordered_json job_json(const JobView& job) {
  ordered_json value{{"id", number_of(job)},
                     {"state", job.state == JobState::Printing ? "PRINTING" : "PAUSED"},
                     {"progress", std::floor(1000 * job.progress) / 10}};
  if (job.seconds_left >= 0) value["time_remaining"] = std::llround(job.seconds_left);
  for (const StageSeconds& stage : job.stage_seconds)
    if (stage.stage == JobStage::Print) value["time_printing"] = std::llround(stage.seconds);
  return value;
}

/// What somebody at the machine must decide or do goes before what it is at.
const char* state_of(const std::vector<JobView>& jobs) {
  const auto asks = [](const JobView& job) {
    return job.exposure_unknown || job.start_unknown || job.waits_for_platform;
  };
  if (std::ranges::any_of(jobs, asks)) return "ATTENTION";
  const JobView* job = job_on_machine(jobs);
  if (job != nullptr && job->state == JobState::Printing) return "PRINTING";
  if (job != nullptr && job->state == JobState::Paused) return "PAUSED";
  return "IDLE";
}

/// A boolean of RFC 8941; nothing: it is none.
std::optional<bool> flag_of(std::string_view text) {
  if (text == "?1") return true;
  if (text.empty() || text == "?0") return false;
  return std::nullopt;
}

bool is_storage(std::string_view name) { return name == "local" || name == "usb"; }

WebResponse no_storage(std::string_view name) {
  return prusalink_problem(404, fmt::format("there is no storage {} here; files go to local", name));
}

WebResponse no_file(std::string_view path) {
  return prusalink_problem(404, fmt::format("there is no file \"{}\" here", to_printable(path)));
}

/// The job of a file, or why there is none.
tl::expected<JobView, WebResponse> find_file(PageBackend& backend, const FileAddress& file) {
  if (!is_storage(file.storage)) return tl::unexpected{no_storage(file.storage)};
  const auto jobs = backend.jobs();
  if (!jobs) return tl::unexpected{problem(jobs.error())};
  const JobView* job = job_of_file(*jobs, file.path);
  if (job == nullptr) return tl::unexpected{no_file(file.path)};
  return *job;
}

}  // namespace

WebResponse prusalink_problem(unsigned status, std::string_view what) {
  const char* title = "Refused";
  switch (status) {
    case 401:
      title = "Unauthorized";
      break;
    case 403:
      title = "Forbidden";
      break;
    case 404:
      title = "Not found";
      break;
    case 409:
      title = "Conflict";
      break;
    case 415:
      title = "Unsupported file";
      break;
    default:
      break;
  }
  return with(status, {{"title", title}, {"message", what}});
}

WebResponse prusalink_info(const WebRequest& request) {
  return with(200, {{"name", "Telefab fab site"}, {"hostname", host_name_of(request.host)}});
}

WebResponse prusalink_status(PageBackend& backend) {
  const auto jobs = backend.jobs();
  if (!jobs) return problem(jobs.error());
  ordered_json value{{"printer", {{"state", state_of(*jobs)}}},
                     {"storage", {{"path", kStorage}, {"name", kStorageName}, {"read_only", false}}}};
  if (const JobView* job = job_on_machine(*jobs); job != nullptr && is_printed(*job)) value["job"] = job_json(*job);
  return with(200, value);
}

WebResponse prusalink_storage(PageBackend& backend) {
  // storage_list must come first: PrusaSlicer looks at no other key.
  return with(200, {{"storage_list",
                     {{{"path", kStorage},
                       {"name", kStorageName},
                       {"type", "LOCAL"},
                       {"read_only", false},
                       {"available", backend.healthy().has_value()}}}}});
}

WebResponse prusalink_job(PageBackend& backend) {
  const auto jobs = backend.jobs();
  if (!jobs) return problem(jobs.error());
  const JobView* job = job_on_machine(*jobs);
  if (job == nullptr || !is_printed(*job)) return nothing();
  ordered_json value = job_json(*job);
  value["file"] = file_json(*job);
  return with(200, value);
}

WebResponse prusalink_command(PageBackend& backend, std::string_view number, JobCommand command, std::string_view who) {
  const auto jobs = backend.jobs();
  if (!jobs) return problem(jobs.error());
  std::uint32_t wanted = 0;
  const auto [end, error] = std::from_chars(number.data(), number.data() + number.size(), wanted);
  const JobView* found = nullptr;
  if (error == std::errc{} && end == number.data() + number.size())
    for (const JobView& job : *jobs)
      if (is_printed(job) && number_of(job) == wanted) {
        // Two in 2^31: neither is touched.
        if (found != nullptr) return prusalink_problem(409, "two jobs have this number; use the page");
        found = &job;
      }
  if (found == nullptr) return prusalink_problem(404, fmt::format("no job {} is being printed", number));
  if ((command == JobCommand::Pause && found->state == JobState::Paused) ||
      (command == JobCommand::Resume && found->state == JobState::Printing))
    return prusalink_problem(409, fmt::format("the job is {} already", name_of(found->state)));
  if (const auto done = backend.act(found->id, command, who); !done) return problem(done.error());
  return nothing();
}

WebResponse prusalink_files(PageBackend& backend, std::string_view storage) {
  if (!is_storage(storage)) return no_storage(storage);
  const auto jobs = backend.jobs();
  if (!jobs) return problem(jobs.error());
  ordered_json children = ordered_json::array();
  for (const JobView& job : *jobs) children.push_back(file_json(job));
  return with(200, {{"type", "FOLDER"},
                    {"name", storage},
                    {"display_name", kStorageName},
                    {"path", kStorage},
                    {"read_only", false},
                    {"children", children}});
}

WebResponse prusalink_file(PageBackend& backend, const FileAddress& file) {
  const auto job = find_file(backend, file);
  if (!job) return job.error();
  WebResponse response = with(200, file_json(*job));
  response.headers = {{"Read-Only", "false"}, {"Currently-Printed", is_printed(*job) ? "true" : "false"}};
  return response;
}

WebResponse prusalink_upload(const WebRequest& request, PageBackend& backend, const FileAddress& file,
                             std::string_view who) {
  if (!is_storage(file.storage)) return no_storage(file.storage);
  const auto overwrites = flag_of(request.overwrite), prints = flag_of(request.print_after_upload);
  if (!overwrites || !prints)
    return prusalink_problem(400, "Overwrite and Print-After-Upload are ?1 or ?0, or are not sent");
  if (!*overwrites) {
    const auto jobs = backend.jobs();
    if (!jobs) return problem(jobs.error());
    if (job_of_file(*jobs, file.path) != nullptr)
      return prusalink_problem(409, "a file of this name is here already; Overwrite: ?1 sends another");
  }
  const auto job = take_upload(backend, file.path, request.body, *prints, who);
  if (!job) return prusalink_problem(job.error().status, job.error().what);
  WebResponse made = with(201, {{"name", *job},
                                {"display_name", base_name(file.path)},
                                {"path", kStorage},
                                {"type", "PRINT_FILE"},
                                {"size", request.body.size()},
                                {"refs", {{"resource", "/v1/jobs/" + *job}}}});
  made.location = "/v1/jobs/" + *job;
  return made;
}

WebResponse prusalink_start(PageBackend& backend, const FileAddress& file, std::string_view who) {
  const auto job = find_file(backend, file);
  if (!job) return job.error();
  // What holds a job is named on the page; a program that sends files names nothing.
  if (const auto done = backend.approve(job->id, "", who); !done)
    return done.error().code == ErrorCode::NotPermitted ? prusalink_problem(409, done.error().what)
                                                        : problem(done.error());
  return nothing();
}

WebResponse prusalink_delete(PageBackend& backend, const FileAddress& file, std::string_view who) {
  const auto job = find_file(backend, file);
  if (!job) return job.error();
  if (is_printed(*job)) return prusalink_problem(409, "this is being printed; end the job first");
  if (!is_final(job->state))
    if (const auto ended = backend.act(job->id, JobCommand::Cancel, who); !ended) return problem(ended.error());
  if (const auto done = backend.act(job->id, JobCommand::Forget, who); !done) return problem(done.error());
  return nothing();
}

}  // namespace telefab::fab
