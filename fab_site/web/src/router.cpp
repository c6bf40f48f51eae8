// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/fab/web/router.hpp>
#include <telefab/web/gauges.hpp>
#include <telefab/web/job_question.hpp>
#include <telefab/web/operator_words.hpp>

#include "metrics.hpp"
#include "octoprint.hpp"
#include "prusalink.hpp"
#include "sender_api.hpp"
#include "uploads.hpp"

namespace telefab::fab {

std::span<const WebAsset> page_assets();  // made by embed.cmake

namespace {

using json = nlohmann::ordered_json;

json to_json(const JobView& job) {
  json value{{"id", job.id},
             {"name", job.name},
             {"owner", job.owner},
             {"machine", job.machine},
             {"instance", job.instance},
             {"state", name_of(job.state)},
             {"message", job.message},
             {"exposure_unknown", job.exposure_unknown},
             {"start_unknown", job.start_unknown},
             {"waits_for_platform", job.waits_for_platform},
             {"platform", job.platform},
             {"layers", job.layers},
             {"layers_received", job.layers_received},
             {"layers_printed", job.layers_printed},
             {"bytes_received", job.bytes_received},
             {"progress", job.progress},
             {"created_unix_s", job.created_unix_s}};
  value["seconds_left"] = job.seconds_left < 0 ? json{} : json(job.seconds_left);
  value["print_seconds"] = job.print_seconds > 0 ? json(job.print_seconds) : json{};
  value["cost"] = job.cost > 0 ? json{{"amount", job.cost}, {"currency", job.currency}} : json{};
  value["planned_unix_ms"] = job.planned_unix_ms > 0 ? json(job.planned_unix_ms) : json{};
  value["resin_ml"] = job.resin_ml > 0 ? json(job.resin_ml) : json{};
  return value;
}

WebResponse as_png(const Result<std::vector<std::byte>>& image) {
  if (!image) return web_problem(image.error());
  return {200, "image/png", std::string{reinterpret_cast<const char*>(image->data()), image->size()}};
}

struct Call {
  const WebRequest& request;
  const Routed& routed;
  PageBackend& backend;
  SignIn& sign_in;
  const WebOptions& options;
  SenderApi api = SenderApi::OctoPrint;

  [[nodiscard]] const std::string& id() const { return routed.arguments.id; }
  [[nodiscard]] const std::string& storage() const { return routed.arguments.storage; }
  [[nodiscard]] const std::string& path() const { return routed.arguments.path; }
  [[nodiscard]] const std::string& who() const { return routed.visitor.name; }
};

/// A picture or a layer of a plan. Who asks for those of the plan there is (?plan=planned_unix_ms) never gets others.
WebResponse of_plan(const Call& call, WebResponse response) {
  const auto asked = query_number(call.request.target, "plan");
  if (response.status != 200 || !asked || *asked == 0) return response;
  const auto job = call.backend.job(call.id());
  response.is_immutable = job && static_cast<std::uint64_t>(job->planned_unix_ms) == *asked;
  return response;
}

/// A machine as it stands, and as "now" what its print does this moment; null where there is none.
json machine_list(PageBackend& backend) {
  json list = json::array();
  for (const MachineStatus& machine : backend.machines()) {
    json& value = list.emplace_back(json_or_discarded(telefab::to_json(machine)));
    value["now"] = nullptr;
    if (const auto now = backend.moment(machine.name)) {
      value["now"] = {{"phase", now->phase}, {"light", now->is_lit}, {"z_mm", nullptr}, {"resin_celsius", nullptr}};
      if (now->z_mm) value["now"]["z_mm"] = *now->z_mm;
      if (now->resin_celsius) value["now"]["resin_celsius"] = *now->resin_celsius;
    }
  }
  return list;
}

Result<json> job_list(PageBackend& backend) {
  const auto jobs = backend.jobs();
  if (!jobs) return tl::unexpected{jobs.error()};
  json list = json::array();
  for (const JobView& job : *jobs) list.push_back(to_json(job));
  return list;
}

WebResponse list_jobs(const Call& call) {
  const auto question = job_question_of(call.request.target);
  if (!question) return web_problem(question.error());
  if (*question) {
    const auto page = call.backend.find(**question);
    if (!page) return web_problem(page.error());
    json list = json::array();
    for (const JobView& job : page->jobs) list.push_back(to_json(job));
    return {200, "application/json", json_text({{"jobs", list}, {"next", page->next > 0 ? json(page->next) : json{}}})};
  }
  const auto jobs = job_list(call.backend);
  if (!jobs) return web_problem(jobs.error());
  return {200, "application/json", json_text({{"jobs", *jobs}})};
}

WebResponse show_job(const Call& call) {
  const auto job = call.backend.job(call.id());
  if (!job) return web_problem(job.error());
  return {200, "application/json", json_text(to_json(*job))};
}

WebResponse show_events(const Call& call) {
  const auto events = call.backend.events(call.id());
  if (!events) return web_problem(events.error());
  json list = json::array();
  for (const JobEventView& event : *events) list.push_back({{"unix_ms", event.unix_ms}, {"text", event.text}});
  return {200, "application/json", json_text({{"events", list}})};
}

/// The job as it is once something was done about it, or why that was not done.
WebResponse job_after(const Result<void>& done, const Call& call) {
  return done ? show_job(call) : web_problem(done.error());
}

template <JobCommand action>
WebResponse act(const Call& call) {
  return job_after(call.backend.act(call.id(), action, call.who()), call);
}

WebResponse made_job(PageBackend& backend, const std::string& id) {
  const auto job = backend.job(id);
  WebResponse made{201, "application/json", json_text(job ? to_json(*job) : json{{"id", id}})};
  made.location = "/v1/jobs/" + id;
  return made;
}

WebResponse print_again(const Call& call) {
  const auto id = call.backend.print_again(call.id(), call.who());
  if (!id) return web_problem(id.error());
  return made_job(call.backend, *id);
}

/// There is no job to show afterwards.
WebResponse forget(const Call& call) {
  if (const auto done = call.backend.act(call.id(), JobCommand::Forget, call.who()); !done)
    return web_problem(done.error());
  return {200, "application/json", json_text({{"forgotten", call.id()}})};
}

WebResponse clear_platform(const Call& call) {
  if (const auto done = call.backend.clear_platform(call.id(), call.who()); !done) return web_problem(done.error());
  return {200, "application/json", call.backend.devices_json()};
}

WebResponse approve(const Call& call) {
  const auto although = although_of(call.request.body);
  if (!although) return web_problem(although.error());
  return job_after(call.backend.approve(call.id(), *although, call.who()), call);
}

WebResponse plan_again(const Call& call) {
  return job_after(call.backend.plan_again(call.id(), call.request.body, call.who()), call);
}

WebResponse resume(const Call& call) {
  const auto word = resumption_of(call.request.body);
  if (!word) return web_problem(word.error());
  return job_after(call.backend.act(call.id(), *word, call.who()), call);
}

/// Of the page: a file chosen there.
WebResponse upload(const Call& call) {
  const auto id = take_upload(call.backend, call.path(), call.request.body, false, call.who());
  if (!id) return web_problem(id.error().status, "invalid-input", id.error().what);
  return made_job(call.backend, *id);
}

WebResponse asset(std::string_view target, const WebOptions& options) {
  if (target.substr(0, target.find('?')) == "/three.js" && !options.three_js.empty())
    return {200, "text/javascript; charset=utf-8", options.three_js, true};
  return web_asset(page_assets(), target);
}

template <JobCommand command>
WebResponse prusalink_act(const Call& call) {
  return prusalink_command(call.backend, call.id(), command, call.who());
}

/// 30,000 places with all their figures in full.
constexpr std::uint64_t kMostHandList_bytes = 8U << 20U;

struct Row {
  WebRoute route;
  WebResponse (*run)(const Call&);
};

const std::vector<Row>& rows() {
  static const std::vector<Row> table{
      {kSignInRoutes[0], [](const Call& c) { return c.sign_in.session(c.request); }},
      {kSignInRoutes[1], [](const Call& c) { return c.sign_in.sign_in(c.request); }},
      {kSignInRoutes[2], [](const Call& c) { return c.sign_in.sign_out(c.request); }},
      {{"GET", "/v1/version", "name and version of the program", Access::Anybody},
       [](const Call& c) -> WebResponse {
         return {200, "application/json",
                 json_text({{"program", "telefab-fab"}, {"version", c.options.version}, {"api", "v1"}})};
       }},
      {{"GET", "/v1/devices", "projector and stage"},
       [](const Call& c) -> WebResponse {
         return {200, "application/json", c.backend.devices_json()};
       }},
      {{"GET", "/v1/machines", "what each machine of the fab is at"},
       [](const Call& c) -> WebResponse {
         return {200, "application/json", json_text({{"machines", machine_list(c.backend)}})};
       }},
      {{"GET", "/v1/jobs", "jobs, newest first: those under way and the newest, or those that are asked for"},
       list_jobs},
      {{"GET", "/v1/jobs/{id}", "one job"}, show_job},
      {{"GET", "/v1/jobs/{id}/events", "the job's log"}, show_events},
      {{"GET", "/v1/jobs/{id}/report", "report of plan and print"},
       [](const Call& c) { return web_json(c.backend.report(c.id())); }},
      {{"GET", "/v1/jobs/{id}/preflight", "what was asked before the light went on, with verdicts"},
       [](const Call& c) { return web_json(c.backend.preflight(c.id())); }},
      {{"GET", "/v1/jobs/{id}/exposures", "light of every layer, planned and measured"},
       [](const Call& c) { return web_json(c.backend.exposures(c.id())); }},
      {{"GET", "/v1/jobs/{id}/preview.png", "contact sheet of the plan"},
       [](const Call& c) { return of_plan(c, as_png(c.backend.preview_png(c.id()))); }},
      {{"GET", "/v1/jobs/{id}/view.png", "the print as it stands on its platform"},
       [](const Call& c) { return of_plan(c, as_png(c.backend.view_png(c.id()))); }},
      {{"GET", "/v1/jobs/{id}/accuracy.png", "the predicted part and the error of its edges"},
       [](const Call& c) { return as_png(c.backend.accuracy_png(c.id())); }},
      {{"GET", "/v1/jobs/{id}/layers/{layer}", "contours of part and supports in one layer"},
       [](const Call& c) { return of_plan(c, web_json(c.backend.layer_json(c.id(), c.routed.arguments.layer))); }},
      {{"GET", "/v1/jobs/{id}/layers/{layer}/mask.png", "grey mask of one layer"},
       [](const Call& c) { return of_plan(c, as_png(c.backend.mask_png(c.id(), c.routed.arguments.layer))); }},
      {{"GET", "/v1/jobs/{id}/supports", "anchors of the plan, and the list of supports by hand it was made with"},
       [](const Call& c) { return web_json(c.backend.supports(c.id())); }},
      {{"POST", "/v1/jobs/{id}/supports", "plan a job that waits for approval again with a list of supports by hand",
        Access::Operators, kMostHandList_bytes},
       plan_again},
      {{"POST", "/v1/jobs/{id}/approve", "let a job that waits for approval print", Access::Operators}, approve},
      {{"POST", "/v1/jobs/{id}/pause", "stop before the next exposure, lifted", Access::Operators},
       act<JobCommand::Pause>},
      {{"POST", "/v1/jobs/{id}/resume", "go on with the next layer", Access::Operators}, resume},
      {{"POST", "/v1/jobs/{id}/cancel", "end the job", Access::Operators}, act<JobCommand::Cancel>},
      {{"POST", "/v1/jobs/{id}/forget", "take a job that has ended off this site, with its files; its record stays",
        Access::Operators},
       forget},
      {{"POST", "/v1/jobs/{id}/again", "make a new job of the same layers; it waits for approval", Access::Operators},
       print_again},
      {{"POST", "/v1/machines/{id}/cleared", "say that the part is off the platform of a machine", Access::Operators},
       clear_platform},
      {{"POST", "/v1/files/{path}", "make a job of a file that a fab prints; it waits for approval", Access::Operators,
        kMostUpload},
       upload},
      {{"GET", "/metrics", "gauges for Prometheus"},
       [](const Call& c) -> WebResponse {
         const auto jobs = c.backend.jobs();
         if (!jobs) return web_problem(jobs.error());
         return {200, Gauges::kContentType, metrics_text(*jobs, c.backend.machines())};
       }},
      {{"GET", "/v1/health", "whether the daemon answers and its store can be read and written", Access::Anybody},
       [](const Call& c) -> WebResponse {
         const auto jobs = c.backend.jobs();
         if (!jobs) return web_sick(jobs.error());
         if (const auto good = c.backend.healthy(); !good) return web_sick(good.error());
         return {200, "application/json", json_text({{"status", "ok"}, {"jobs", jobs->size()}})};
       }},
      {{"GET", "/v1/stream", "server-sent events: jobs and machines whenever they change"},
       [](const Call& c) -> WebResponse {
         // The server keeps a GET open; this is what a HEAD is told.
         return {200, "text/event-stream", "data: " + event_data(c.backend) + "\n\n"};
       }},
      {{"GET", "/api/version", "OctoPrint's and PrusaLink's: version of the API, and what kind of host this is"},
       [](const Call& c) { return version_for(c.api, c.options.version); }},
      {{"GET", "/api/job", "OctoPrint's: the job on the machine and its progress"},
       [](const Call& c) { return octoprint_job(c.backend); }},
      {{"GET", "/api/printer", "OctoPrint's: state of the printer"},
       [](const Call& c) { return octoprint_printer(c.backend); }},
      {{"POST", "/api/job", "OctoPrint's: start, pause, resume or cancel the job on the machine", Access::Operators},
       [](const Call& c) { return octoprint_command(c.request, c.backend, c.who()); }},
      {{"POST", "/api/files/local", "OctoPrint's: upload a file that a fab prints and make it a job", Access::Operators,
        kMostUpload},
       [](const Call& c) { return octoprint_upload(c.request, c.backend, c.who()); }},
      {{"GET", "/api/v1/info", "PrusaLink's: what this is"}, [](const Call& c) { return prusalink_info(c.request); }},
      {{"GET", "/api/v1/status", "PrusaLink's: state of the printer and of the job it prints"},
       [](const Call& c) { return prusalink_status(c.backend); }},
      {{"GET", "/api/v1/job", "PrusaLink's: the job that is being printed or is paused"},
       [](const Call& c) { return prusalink_job(c.backend); }},
      {{"DELETE", "/api/v1/job/{id}", "PrusaLink's: end the job", Access::Operators},
       prusalink_act<JobCommand::Cancel>},
      {{"PUT", "/api/v1/job/{id}/pause", "PrusaLink's: stop before the next exposure, lifted", Access::Operators},
       prusalink_act<JobCommand::Pause>},
      {{"PUT", "/api/v1/job/{id}/resume", "PrusaLink's: go on with the next layer", Access::Operators},
       prusalink_act<JobCommand::Resume>},
      {{"PUT", "/api/v1/job/{id}/continue", "PrusaLink's: the same", Access::Operators},
       prusalink_act<JobCommand::Resume>},
      {{"GET", "/api/v1/storage", "PrusaLink's: where files go"},
       [](const Call& c) { return prusalink_storage(c.backend); }},
      {{"GET", "/api/v1/transfer", "PrusaLink's: the file that is on its way; a fab shows it once it is whole"},
       [](const Call&) -> WebResponse {
         return {204, "application/json", ""};
       }},
      {{"GET", "/api/v1/files/{storage}", "PrusaLink's: jobs as files, newest first"},
       [](const Call& c) { return prusalink_files(c.backend, c.storage()); }},
      {{"GET", "/api/v1/files/{storage}/{path}", "PrusaLink's: the job of a file"},
       [](const Call& c) {
         return prusalink_file(c.backend, {c.storage(), c.path()});
       }},
      {{"PUT", "/api/v1/files/{storage}/{path}", "PrusaLink's: upload a file that a fab prints and make it a job",
        Access::Operators, kMostUpload},
       [](const Call& c) {
         return prusalink_upload(c.request, c.backend, {c.storage(), c.path()}, c.who());
       }},
      {{"POST", "/api/v1/files/{storage}/{path}", "PrusaLink's: let the job of a file that waits for approval print",
        Access::Operators},
       [](const Call& c) {
         return prusalink_start(c.backend, {c.storage(), c.path()}, c.who());
       }},
      {{"DELETE", "/api/v1/files/{storage}/{path}",
        "PrusaLink's: cancel and forget the job of a file that is not being printed", Access::Operators},
       [](const Call& c) {
         return prusalink_delete(c.backend, {c.storage(), c.path()}, c.who());
       }},
  };
  return table;
}

/// The row for a request and who sends it, or the answer that refuses it.
tl::expected<Routed, WebResponse> route_of(const SenderRequest& asked, SignIn& sign_in) {
  if (!is_of_sender(asked.request.target)) return find_route(web_routes(), asked.request, sign_in);
  auto routed = find_row(web_routes(), asked.request);
  // A program proves its key by any question: a wrong one is refused even where none is needed.
  auto visitor = sign_in.admit(asked.request, routed ? web_routes()[routed->row].needs : Access::Readers);
  if (!visitor) return tl::unexpected{refuse_sender(asked, visitor.error(), sign_in)};
  if (routed) routed->visitor = std::move(*visitor);
  return routed;
}

}  // namespace

std::string open_api_json() { return web_asset(page_assets(), "/openapi.json").body; }

const std::vector<WebRoute>& web_routes() {
  static const std::vector<WebRoute> routes = routes_of(rows());
  return routes;
}

WebResponse answer(const WebRequest& request, PageBackend& backend, SignIn& sign_in, const WebOptions& options) {
  const SenderRequest asked = read_sender(request);
  const auto routed = route_of(asked, sign_in);
  if (routed) return rows()[routed->row].run(Call{asked.request, *routed, backend, sign_in, options, asked.api});
  if (routed.error().status == 404 && (request.method == "GET" || request.method == "HEAD"))
    return asset(request.target, options);
  return routed.error();
}

std::string event_data(PageBackend& backend) {
  const auto jobs = job_list(backend);
  if (!jobs) return web_problem(jobs.error()).body;
  return json_text({{"jobs", *jobs}, {"machines", machine_list(backend)}});
}

tl::expected<Visitor, WebResponse> FabWeb::admit(const WebRequest& head) {
  auto routed = route_of(read_sender(head), sign_in_);
  if (!routed) return tl::unexpected{std::move(routed.error())};
  return std::move(routed->visitor);
}

std::uint64_t FabWeb::most_body(const WebRequest& head) {
  // Whoever may not upload is not listened to at length.
  const auto routed = route_of(read_sender(head), sign_in_);
  return routed ? web_routes()[routed->row].most_body : 0;
}

}  // namespace telefab::fab
