// SPDX-License-Identifier: GPL-3.0-or-later
#include <map>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <telefab/job/slice_parameters.hpp>
#include <telefab/scan/web/scan_web.hpp>
#include <telefab/web/gauges.hpp>
#include <telefab/web/job_question.hpp>
#include <telefab/web/operator_words.hpp>

#include "staging_routes.hpp"

namespace telefab::scan {

std::span<const WebAsset> page_assets();  // made by embed.cmake

namespace {

using nlohmann::ordered_json;

WebResponse as_text(const ordered_json& value) { return {200, "application/json", json_text(value)}; }

ordered_json link_json(const LinkView& link) {
  return {{"fab", link.fab}, {"fleet", link.is_fleet}, {"up", link.is_up}, {"why_down", link.why_down}};
}

/// What the job's JSON holds is made in one place, for hooks, client and page.
std::string list_of(const std::vector<Job>& jobs) {
  std::string list;
  for (const Job& job : jobs) list += (list.empty() ? "" : ",") + to_json(job);
  return R"("jobs":[)" + list + "]";
}

std::string link_of(PageBackend& backend) { return R"(,"link":)" + json_text(link_json(backend.link())); }

WebResponse current_jobs(PageBackend& backend) {
  const auto jobs = backend.jobs();
  if (!jobs) return web_problem(jobs.error());
  return {200, "application/json", "{" + list_of(*jobs) + link_of(backend) + "}"};
}

WebResponse list_jobs(const Call& call) {
  const auto question = job_question_of(call.request.target);
  if (!question) return web_problem(question.error());
  if (!*question) return current_jobs(call.backend);
  const auto page = call.backend.find(**question);
  if (!page) return web_problem(page.error());
  const std::string next = page->next > 0 ? std::to_string(page->next) : "null";
  return {200, "application/json", "{" + list_of(page->jobs) + link_of(call.backend) + R"(,"next":)" + next + "}"};
}

WebResponse show_job(const Call& call) {
  const auto job = call.backend.job(call.id());
  if (!job) return web_problem(job.error());
  return {200, "application/json", to_json(*job)};
}

WebResponse show_events(const Call& call) {
  const auto events = call.backend.events(call.id());
  if (!events) return web_problem(events.error());
  ordered_json list = ordered_json::array();
  for (const JobEvent& event : *events) list.push_back({{"unix_ms", event.unix_ms}, {"text", event.text}});
  return as_text({{"events", list}});
}

/// What is cut of a job is never cut otherwise.
WebResponse show_layer(const Call& call) {
  WebResponse layer = web_json(call.backend.layer_json(call.id(), call.routed.arguments.layer));
  layer.is_immutable = layer.status == 200;
  return layer;
}

/// The job as it is once something was done about it, or why that was not done.
WebResponse job_after(const Result<void>& done, const Call& call) {
  return done ? show_job(call) : web_problem(done.error());
}

template <JobCommand command>
WebResponse act(const Call& call) {
  return job_after(call.backend.act(call.id(), command, call.routed.visitor.name), call);
}

WebResponse approve(const Call& call) {
  const auto although = although_of(call.request.body);
  if (!although) return web_problem(although.error());
  return job_after(call.backend.approve(call.id(), *although, call.routed.visitor.name), call);
}

WebResponse resume(const Call& call) {
  const auto word = resumption_of(call.request.body);
  if (!word) return web_problem(word.error());
  return job_after(call.backend.act(call.id(), *word, call.routed.visitor.name), call);
}

/// There is no job to show afterwards.
WebResponse forget(const Call& call) {
  if (const auto done = call.backend.act(call.id(), JobCommand::Forget, call.routed.visitor.name); !done)
    return web_problem(done.error());
  return as_text({{"forgotten", call.id()}});
}

WebResponse metrics(const Call& call) {
  const auto jobs = call.backend.jobs();
  if (!jobs) return web_problem(jobs.error());
  Gauges gauges;
  std::map<JobState, double> in_state;
  for (const Job& job : *jobs) ++in_state[job.state];
  for (const JobState state : kJobStates)
    gauges.add("telefab_jobs", "Jobs in each state; queued ones wait for the slicer",
               {{"state", std::string{name_of(state)}}}, in_state[state]);
  gauges.add("telefab_fab_link_up", "1 while the fab is reached", {}, call.backend.link().is_up ? 1 : 0);
  for (const Job& job : *jobs) {
    const JobCounters& c = job.counters;
    const Gauges::Labels labels{{"job", job.id}, {"machine", job.machine}, {"state", std::string{name_of(job.state)}}};
    gauges.add("telefab_job_layers", "Layers of the part", labels, c.layers);
    gauges.add("telefab_job_layers_sliced", "Layers that are cut", labels, c.layers_sliced);
    gauges.add("telefab_job_layers_acknowledged", "Layers that the fab keeps", labels, c.layers_sent);
    gauges.add("telefab_job_layers_printed", "Layers exposed, as the fab told", labels, c.layers_printed);
    gauges.add("telefab_job_scan_bytes", "Size of the scan", labels, static_cast<double>(c.scan_bytes));
    gauges.add("telefab_job_wire_bytes", "Contour bytes sent, framing included", labels,
               static_cast<double>(c.wire_bytes));
    for (const StageSeconds& stage : job.stages)
      gauges.add("telefab_job_stage_seconds", "What each stage of a job took",
                 {{"job", job.id}, {"stage", std::string{name_of(stage.stage)}}}, stage.seconds);
  }
  return {200, Gauges::kContentType, gauges.text()};
}

WebResponse health(const Call& call) {
  const auto jobs = call.backend.jobs();
  if (!jobs) return web_sick(jobs.error());
  if (const auto good = call.backend.healthy(); !good) return web_sick(good.error());
  return as_text({{"status", "ok"}, {"jobs", jobs->size()}, {"link", link_json(call.backend.link())}});
}

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
       [](const Call& c) {
         return as_text({{"program", "telefab-scan"}, {"version", c.options.version}, {"api", "v1"}});
       }},
      {{"GET", "/v1/health", "whether the daemon answers and its store can be read and written", Access::Anybody},
       health},
      {{"GET", "/v1/link", "the line to the fab"}, [](const Call& c) { return as_text(link_json(c.backend.link())); }},
      {{"GET", "/v1/fleet", "machines and queue of the fleet that prints the jobs"},
       [](const Call& c) -> WebResponse {
         auto fleet = c.backend.fleet();
         if (!fleet) return web_problem(fleet.error());
         return {200, "application/json", std::move(*fleet)};
       }},
      {{"GET", "/v1/parameters", "what may be asked of a scan's slicing: names, kinds, units, ranges", Access::Anybody},
       [](const Call&) -> WebResponse {
         return {200, "application/json", slice_parameter_list_json()};
       }},
      {{"GET", "/v1/jobs", "jobs, newest first: those under way and the newest, or those that are asked for"},
       list_jobs},
      {{"GET", "/v1/jobs/{id}", "one job"}, show_job},
      {{"GET", "/v1/jobs/{id}/events", "the job's log"}, show_events},
      {{"GET", "/v1/jobs/{id}/preflight", "what the fab asked before the light went on, with verdicts"},
       [](const Call& c) { return web_json(c.backend.preflight(c.id())); }},
      {{"GET", "/v1/jobs/{id}/report", "what cleaning and slicing found"},
       [](const Call& c) { return web_json(c.backend.report(c.id())); }},
      {{"GET", "/v1/jobs/{id}/layers/{layer}", "contours of one layer that is cut, and what they rest on"}, show_layer},
      {{"POST", "/v1/jobs/{id}/approve", "let a job that waits at the fab print", Access::Operators}, approve},
      {{"POST", "/v1/jobs/{id}/pause", "have the fab stop before the next exposure", Access::Operators},
       act<JobCommand::Pause>},
      {{"POST", "/v1/jobs/{id}/resume", "have the fab go on with the next layer", Access::Operators}, resume},
      {{"POST", "/v1/jobs/{id}/cancel", "end the job here and at the fab", Access::Operators}, act<JobCommand::Cancel>},
      {{"POST", "/v1/jobs/{id}/forget",
        "take a job that has ended off this site, with its files; the fab keeps its own", Access::Operators},
       forget},
      {{"GET", "/v1/profiles", "machines, resins and ways to print that one can choose"},
       [](const Call& c) -> WebResponse {
         return {200, "application/json", c.staging.profiles()};
       }},
      {{"GET", "/v1/uploads", "scans that lie here and are no jobs yet, and how much may be sent"},
       [](const Call& c) { return web_json(c.staging.uploads()); }},
      {{"POST", "/v1/uploads", "announce a file by name, size and SHA-256; an interrupted one goes on where it stopped",
        Access::Operators},
       begin_upload},
      {{"GET", "/v1/uploads/{id}", "one of them: what is there, what is known of it, what was asked"},
       [](const Call& c) { return web_json(c.staging.view(c.id())); }},
      {{"POST", "/v1/uploads/{id}/part", "the bytes behind the first ?from=N", Access::Operators, kMostPart_bytes},
       add_part},
      {{"GET", "/v1/uploads/{id}/levels/{layer}",
        "points of one level of detail of the picture ?revision=N, in binary"},
       show_level},
      {{"POST", "/v1/uploads/{id}/look", "pick the object, orient it, close its gaps, in the background",
        Access::Operators},
       ask<&StagingBackend::look>},
      {{"POST", "/v1/uploads/{id}/estimate", "what a print would take, in the background", Access::Operators},
       ask<&StagingBackend::estimate>},
      {{"POST", "/v1/uploads/{id}/orient", "the ways in which it stands best, in the background", Access::Operators},
       ask<&StagingBackend::orient>},
      {{"POST", "/v1/uploads/{id}/join", "join it with other views of the object to one scan, in the background",
        Access::Operators},
       join_uploads},
      {{"POST", "/v1/uploads/{id}/submit", "make a job of it", Access::Operators}, submit},
      {{"POST", "/v1/uploads/{id}/discard", "take it off this site; jobs that were made of it stay", Access::Operators},
       discard_upload},
      {{"GET", "/metrics", "gauges for Prometheus"}, metrics},
      // The server keeps a GET open; this is what a HEAD is told.
      {{"GET", "/v1/stream", "server-sent events: jobs and line whenever they change"},
       [](const Call& c) -> WebResponse {
         return {200, "text/event-stream", "data: " + current_jobs(c.backend).body + "\n\n"};
       }},
  };
  return table;
}

/// The description of the API with the parameters as the one table of them has them.
WebResponse described(WebResponse page) {
  auto api = json_or_discarded(page.body);
  if (!api.is_object()) return page;
  api["components"]["schemas"]["SliceParameters"] = parsed_json(slice_parameter_schema_json());
  page.body = json_text(api, 1);
  return page;
}

}  // namespace

std::string open_api_json() { return described(web_asset(page_assets(), "/openapi.json")).body; }

const std::vector<WebRoute>& web_routes() {
  static const std::vector<WebRoute> routes = routes_of(rows());
  return routes;
}

WebResponse ScanWeb::answer(const WebRequest& request) {
  const auto routed = find_route(web_routes(), request, sign_in_);
  if (routed) return rows()[routed->row].run(Call{request, *routed, backend_, staging_, sign_in_, options_});
  if (routed.error().status == 404 && (request.method == "GET" || request.method == "HEAD")) {
    if (request.target.substr(0, request.target.find('?')) == "/three.js" && !options_.three_js.empty())
      return {200, "text/javascript; charset=utf-8", options_.three_js, true};
    WebResponse page = web_asset(page_assets(), request.target);
    return request.target == "/openapi.json" ? described(std::move(page)) : page;
  }
  return routed.error();
}

tl::expected<Visitor, WebResponse> ScanWeb::admit(const WebRequest& head) {
  auto routed = find_route(web_routes(), head, sign_in_);
  if (!routed) return tl::unexpected{std::move(routed.error())};
  return std::move(routed->visitor);
}

std::uint64_t ScanWeb::most_body(const WebRequest& head) {
  // Whoever may not upload is not listened to at length.
  const auto routed = find_route(web_routes(), head, sign_in_);
  return routed ? web_routes()[routed->row].most_body : 0;
}

std::string ScanWeb::event_data() { return current_jobs(backend_).body; }

}  // namespace telefab::scan
