// SPDX-License-Identifier: GPL-3.0-or-later
#include "octoprint.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/web/form_data.hpp>

#include "job_on_machine.hpp"
#include "uploads.hpp"

namespace telefab::fab {
namespace {

using nlohmann::ordered_json;

WebResponse with(unsigned status, const ordered_json& value) { return {status, "application/json", json_text(value)}; }

WebResponse octoprint_problem(const Error& error) {
  return fab::octoprint_problem(web_problem(error).status, error.what);
}

/// Before it is printed a job is, for OctoPrint, a file that was chosen.
std::string state_text(const JobView* job) {
  if (job && job->state == JobState::Printing) return "Printing";
  if (job && job->state == JobState::Paused) return "Paused";
  return "Operational";
}

bool is_yes(std::string_view text) { return text == "true" || text == "yes" || text == "1"; }

/// The value of a field; empty where there is none.
std::string_view value_of(const std::vector<FormField>& fields, std::string_view name) {
  for (const FormField& field : fields)
    if (field.name == name && field.file_name.empty()) return field.content;
  return {};
}

}  // namespace

WebResponse octoprint_problem(unsigned status, std::string_view what) { return with(status, {{"error", what}}); }

WebResponse octoprint_job(PageBackend& backend) {
  const auto jobs = backend.jobs();
  if (!jobs) return octoprint_problem(jobs.error());
  const JobView* job = job_on_machine(*jobs);
  ordered_json file{{"name", nullptr}, {"origin", nullptr}, {"size", nullptr}, {"date", nullptr}};
  ordered_json progress{
      {"completion", nullptr}, {"filepos", nullptr}, {"printTime", nullptr}, {"printTimeLeft", nullptr}};
  ordered_json estimated = nullptr;
  if (job) {
    file = {{"name", job->name},
            {"path", job->id},
            {"origin", "local"},
            {"size", job->bytes_received},
            {"date", job->created_unix_s}};
    const bool is_printed =
        job->state == JobState::Printing || job->state == JobState::Paused || job->state == JobState::Done;
    progress["completion"] = is_printed ? ordered_json(100 * job->progress) : ordered_json(nullptr);
    for (const StageSeconds& stage : job->stage_seconds)
      if (stage.stage == JobStage::Print) progress["printTime"] = stage.seconds;
    if (job->seconds_left >= 0) progress["printTimeLeft"] = job->seconds_left;
    if (job->print_seconds > 0) estimated = job->print_seconds;
  }
  return with(200, {{"job",
                     {{"file", file},
                      {"estimatedPrintTime", estimated},
                      {"lastPrintTime", nullptr},
                      {"filament", nullptr},
                      {"user", nullptr}}},
                    {"progress", progress},
                    {"state", state_text(job)}});
}

WebResponse octoprint_printer(PageBackend& backend) {
  const auto jobs = backend.jobs();
  if (!jobs) return octoprint_problem(jobs.error());
  const JobView* job = job_on_machine(*jobs);
  const bool is_printing = job && job->state == JobState::Printing, is_paused = job && job->state == JobState::Paused;
  return with(200, {{"temperature", ordered_json::object()},
                    {"sd", {{"ready", false}}},
                    {"state",
                     {{"text", state_text(job)},
                      {"flags",
                       {{"operational", true},
                        {"paused", is_paused},
                        {"printing", is_printing},
                        {"pausing", false},
                        {"cancelling", false},
                        {"sdReady", false},
                        {"error", false},
                        {"ready", !is_printing && !is_paused},
                        {"closedOrError", false}}}}}});
}

WebResponse octoprint_command(const WebRequest& request, PageBackend& backend, const std::string& who) {
  const auto asked = json_or_discarded(request.body);
  const auto text = [&](const char* key) {
    const auto found = asked.is_object() ? asked.find(key) : asked.end();
    return asked.is_object() && found != asked.end() && found->is_string() ? found->get<std::string>() : std::string{};
  };
  const std::string command = text("command"), action = text("action");
  const auto jobs = backend.jobs();
  if (!jobs) return octoprint_problem(jobs.error());
  const JobView* job = job_on_machine(*jobs);
  const auto is = [job](JobState state) { return job && job->state == state; };
  std::optional<JobCommand> wanted;
  const bool starts = command == "start";
  if (starts) {
    wanted = JobCommand::Approve;
  } else if (command == "cancel") {
    wanted = JobCommand::Cancel;
  } else if (command == "pause") {
    if (action == "resume" || (action != "pause" && is(JobState::Paused)))
      wanted = JobCommand::Resume;
    else if (action.empty() || action == "pause" || action == "toggle")
      wanted = JobCommand::Pause;
  } else if (command == "restart") {
    return octoprint_problem(409, "a print of resin cannot be begun again from its first layer; send the file again");
  }
  const auto on_machines = std::ranges::count_if(
      *jobs, [](const JobView& j) { return j.state == JobState::Printing || j.state == JobState::Paused; });
  if (wanted && !starts && on_machines > 1)
    return octoprint_problem(
        409, "several machines have a print, and this command names none: use the page, telefab or PrusaLink's jobs");
  if (!wanted && !starts)
    return octoprint_problem(400,
                             R"(the body must be JSON with "command": start, cancel, restart or pause, and for pause )"
                             R"("action": pause, resume or toggle)");
  // Pause where it is paused and resume where it prints are fine, says OctoPrint's documentation.
  if ((wanted == JobCommand::Pause && is(JobState::Paused)) || (wanted == JobCommand::Resume && is(JobState::Printing)))
    return {204, "application/json", ""};
  if (!job || is_final(job->state)) return octoprint_problem(409, "there is no job on the machine");
  // What holds a job is named on the page; a program that sends files names nothing.
  if (auto done = starts ? backend.approve(job->id, "", who) : backend.act(job->id, *wanted, who); !done)
    return octoprint_problem(done.error());
  return {204, "application/json", ""};
}

WebResponse octoprint_upload(const WebRequest& request, PageBackend& backend, const std::string& who) {
  const auto fields = form_fields(request.content_type, request.body);
  if (!fields) return octoprint_problem(fields.error());
  const auto file = std::find_if(fields->begin(), fields->end(), [](const FormField& field) {
    return field.name == "file" && !field.file_name.empty();
  });
  if (file == fields->end()) return octoprint_problem(400, "the form has no field \"file\" with a file in it");
  const bool is_to_print = is_yes(value_of(*fields, "print"));
  const std::string path = fmt::format("{}/{}", value_of(*fields, "path"), base_name(file->file_name));
  const auto job = take_upload(backend, path, file->content, is_to_print, who);
  if (!job) return octoprint_problem(job.error().status, job.error().what);
  const std::string name{base_name(file->file_name)};
  WebResponse made = with(201, {{"files",
                                 {{"local",
                                   {{"name", name},
                                    {"path", *job},
                                    {"type", "model"},
                                    {"origin", "local"},
                                    {"refs", {{"resource", "/v1/jobs/" + *job}}}}}}},
                                {"done", true},
                                {"effectiveSelect", true},
                                {"effectivePrint", is_to_print}});
  made.location = "/v1/jobs/" + *job;
  return made;
}

}  // namespace telefab::fab
