// SPDX-License-Identifier: GPL-3.0-or-later
#include "octoprint.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/base/text.hpp>
#include <telefab/web/form_data.hpp>

namespace telefab::fab {
namespace {

using nlohmann::ordered_json;

WebResponse with(unsigned status, const ordered_json& value) { return {status, "application/json", json_text(value)}; }

/// OctoPrint says what went wrong as {"error": "text"}.
WebResponse octoprint_problem(unsigned status, std::string_view what) { return with(status, {{"error", what}}); }
WebResponse octoprint_problem(const Error& error) { return octoprint_problem(web_problem(error).status, error.what); }

/// What the machine is at: the job being printed, else the one that is nearest to it, else the newest. Null: no job.
const JobView* on_machine(const std::vector<JobView>& jobs) {
  static constexpr std::array kNearest{JobState::Printing,         JobState::Paused,   JobState::Ready,
                                       JobState::AwaitingApproval, JobState::Planning, JobState::Sending};
  for (const JobState state : kNearest)
    for (const JobView& job : jobs)
      if (job.state == state) return &job;
  return jobs.empty() ? nullptr : &jobs.front();
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

/// The last part of a path of either kind.
std::string_view base_name(std::string_view path) {
  const auto slash = path.find_last_of("/\\");
  return slash == std::string_view::npos ? path : path.substr(slash + 1);
}

bool ends_with(std::string_view text, std::string_view ending) {
  return text.size() >= ending.size() && std::equal(ending.rbegin(), ending.rend(), text.rbegin(), [](char a, char b) {
           return a == static_cast<char>(std::tolower(static_cast<unsigned char>(b)));
         });
}

/// Why a file that is no .tfc is not taken, with what to do instead.
std::string not_taken(std::string_view name) {
  static constexpr std::array kClouds{".ply", ".pcd", ".xyz", ".ptx", ".pts", ".txt", ".csv", ".asc", ".stl", ".obj"};
  for (const char* ending : kClouds)
    if (ends_with(name, ending))
      return fmt::format(
          "{} is a scan or a mesh, and this is a fab site: it prints layers and cuts none. Send it to a scan site "
          "(telefab submit FILE --machine NAME), or cut it into a .tfc file first (telefab-scan slice FILE --out "
          "part.tfc)",
          name);
  return fmt::format("{} is not a .tfc file; a fab takes layers as telefab-scan slice writes them", name);
}

}  // namespace

std::optional<WebResponse> octoprint_refusal(const WebRequest& request, SignIn& sign_in) {
  if (!request.target.starts_with("/api/")) return std::nullopt;
  // A client proves its key by any question: a wrong one is said even where none is needed.
  const auto visitor = sign_in.admit(request, request.method == "POST" ? Access::Operators : Access::Readers);
  if (visitor) return std::nullopt;
  return octoprint_problem(403, "X-Api-Key: " + visitor.error().what);
}

WebResponse octoprint_version(const std::string& version) {
  return with(200, {{"api", "0.1"}, {"server", version}, {"text", "OctoPrint (Telefab " + version + ")"}});
}

WebResponse octoprint_job(PageBackend& backend) {
  const auto jobs = backend.jobs();
  if (!jobs) return octoprint_problem(jobs.error());
  const JobView* job = on_machine(*jobs);
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
  const JobView* job = on_machine(*jobs);
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
  const JobView* job = on_machine(*jobs);
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
  const std::string name{base_name(file->file_name)};
  if (!is_file_name(name)) return octoprint_problem(400, "the file's name cannot be kept; rename it");
  if (!ends_with(name, ".tfc")) return octoprint_problem(415, not_taken(name));
  const bool is_to_print = is_yes(value_of(*fields, "print"));
  const auto job = backend.take_file(name, file->content, is_to_print, who);
  if (!job) return octoprint_problem(job.error());
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
