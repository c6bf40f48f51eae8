#include <fmt/format.h>
#include <openssl/crypto.h>

#include <charconv>
#include <nlohmann/json.hpp>
#include <optional>
#include <telefab/fab/web/router.hpp>

#include "assets.hpp"
#include "metrics.hpp"

namespace telefab::fab {
namespace {

using nlohmann::json;

json to_json(const JobView& job) {
  json value{{"id", job.id},
             {"name", job.name},
             {"machine", job.machine},
             {"state", job.state},
             {"message", job.message},
             {"layers", job.layers},
             {"layers_received", job.layers_received},
             {"layers_printed", job.layers_printed},
             {"bytes_received", job.bytes_received},
             {"progress", job.progress},
             {"created_unix_s", job.created_unix_s}};
  value["seconds_left"] = job.seconds_left < 0 ? json{} : json(job.seconds_left);
  return value;
}

std::string text_of(const json& value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); }

WebResponse problem(unsigned status, std::string_view code, std::string_view what) {
  return {status, "application/json", text_of(json{{"error", {{"code", code}, {"what", what}}}})};
}

WebResponse problem(const Error& error) {
  unsigned status = 500;
  switch (error.code) {
    case ErrorCode::NotFound:
      status = 404;
      break;
    case ErrorCode::InvalidInput:
      status = 400;
      break;
    case ErrorCode::Conflict:
      status = 409;
      break;
    case ErrorCode::NotPermitted:
    case ErrorCode::NotTrusted:
      status = 403;
      break;
    case ErrorCode::TooLarge:
      status = 413;
      break;
    default:
      break;
  }
  return problem(status, name_of(error.code), error.what);
}

bool token_matches(const std::string& authorization, const std::string& token) {
  constexpr std::string_view scheme = "Bearer ";
  if (token.empty() || !authorization.starts_with(scheme)) return false;
  const std::string_view shown = std::string_view{authorization}.substr(scheme.size());
  return shown.size() == token.size() && CRYPTO_memcmp(shown.data(), token.data(), token.size()) == 0;
}

/// What stood for {id} and {layer} in a path.
struct Arguments {
  std::string id;
  std::uint32_t layer = 0;
};

/// A segment of a path that may stand for {id}: what job ids are made of, nothing a file system could misread.
bool is_id(std::string_view text) {
  if (text.empty() || text.size() > 128) return false;
  for (const char c : text)
    if (!((c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '_'))
      return false;
  return true;
}

std::optional<Arguments> match(std::string_view pattern, std::string_view path) {
  Arguments arguments;
  while (true) {
    const auto next = [](std::string_view& rest) {
      const auto slash = rest.find('/');
      const std::string_view segment = rest.substr(0, slash);
      rest = slash == std::string_view::npos ? std::string_view{} : rest.substr(slash + 1);
      return std::pair{segment, slash != std::string_view::npos};
    };
    const auto [wanted, wanted_more] = next(pattern);
    const auto [found, found_more] = next(path);
    if (wanted_more != found_more) return std::nullopt;
    if (wanted == "{id}") {
      if (!is_id(found)) return std::nullopt;
      arguments.id = found;
    } else if (wanted == "{layer}") {
      const auto [end, error] = std::from_chars(found.data(), found.data() + found.size(), arguments.layer);
      if (found.empty() || error != std::errc{} || end != found.data() + found.size()) return std::nullopt;
    } else if (wanted != found) {
      return std::nullopt;
    }
    if (!wanted_more) return arguments;
  }
}

WebResponse as_json(const Result<std::string>& body) {
  if (!body) return problem(body.error());
  return {200, "application/json", *body};
}

WebResponse as_png(const Result<std::vector<std::byte>>& image) {
  if (!image) return problem(image.error());
  return {200, "image/png", std::string{reinterpret_cast<const char*>(image->data()), image->size()}, true};
}

struct Call {
  const Arguments& arguments;
  JobDesk& desk;
  const WebOptions& options;
};

WebResponse list_jobs(const Call& call) {
  const auto jobs = call.desk.jobs();
  if (!jobs) return problem(jobs.error());
  json list = json::array();
  for (const JobView& job : *jobs) list.push_back(to_json(job));
  return {200, "application/json", text_of(json{{"jobs", list}})};
}

WebResponse show_job(const Call& call) {
  const auto job = call.desk.job(call.arguments.id);
  if (!job) return problem(job.error());
  return {200, "application/json", text_of(to_json(*job))};
}

WebResponse show_events(const Call& call) {
  const auto events = call.desk.events(call.arguments.id);
  if (!events) return problem(events.error());
  json list = json::array();
  for (const JobEventView& event : *events) list.push_back({{"unix_ms", event.unix_ms}, {"text", event.text}});
  return {200, "application/json", text_of(json{{"events", list}})};
}

template <JobAction action>
WebResponse act(const Call& call) {
  if (const auto done = call.desk.act(call.arguments.id, action, "web"); !done) return problem(done.error());
  return show_job(call);
}

WebResponse asset(std::string_view path, const WebOptions& options) {
  if (path == "/three.js" && !options.three_js.empty())
    return {200, "text/javascript; charset=utf-8", options.three_js, true};
  const auto found = find_asset(path);
  if (!found) return problem(404, "not-found", "no such page; the API begins at /v1/jobs");
  return {200, std::string{found->content_type}, std::string{found->body}, path != "/"};
}

struct Row {
  WebRoute route;
  WebResponse (*run)(const Call&);
};

const std::vector<Row>& rows() {
  static const std::vector<Row> table{
      {{"GET", "/v1/version", "name and version of the program", false},
       [](const Call& c) -> WebResponse {
         return {200, "application/json",
                 text_of(json{{"program", "telefab-fab"}, {"version", c.options.version}, {"api", "v1"}})};
       }},
      {{"GET", "/v1/devices", "projector and stage", false},
       [](const Call& c) -> WebResponse {
         return {200, "application/json", c.desk.devices_json()};
       }},
      {{"GET", "/v1/jobs", "all jobs, newest first", false}, list_jobs},
      {{"GET", "/v1/jobs/{id}", "one job", false}, show_job},
      {{"GET", "/v1/jobs/{id}/events", "the job's log", false}, show_events},
      {{"GET", "/v1/jobs/{id}/report", "report of plan and print", false},
       [](const Call& c) { return as_json(c.desk.report(c.arguments.id)); }},
      {{"GET", "/v1/jobs/{id}/preflight", "what was asked before the light went on, with verdicts", false},
       [](const Call& c) { return as_json(c.desk.preflight(c.arguments.id)); }},
      {{"GET", "/v1/jobs/{id}/exposures", "light of every layer, planned and measured", false},
       [](const Call& c) { return as_json(c.desk.exposures(c.arguments.id)); }},
      {{"GET", "/v1/jobs/{id}/preview.png", "contact sheet of the plan", false},
       [](const Call& c) { return as_png(c.desk.preview_png(c.arguments.id)); }},
      {{"GET", "/v1/jobs/{id}/layers/{layer}", "contours of part and supports in one layer", false},
       [](const Call& c) { return as_json(c.desk.layer_json(c.arguments.id, c.arguments.layer)); }},
      {{"GET", "/v1/jobs/{id}/layers/{layer}/mask.png", "grey mask of one layer", false},
       [](const Call& c) { return as_png(c.desk.mask_png(c.arguments.id, c.arguments.layer)); }},
      {{"POST", "/v1/jobs/{id}/approve", "let a job that waits for approval print", true}, act<JobAction::Approve>},
      {{"POST", "/v1/jobs/{id}/pause", "stop before the next exposure, lifted", true}, act<JobAction::Pause>},
      {{"POST", "/v1/jobs/{id}/resume", "go on with the next layer", true}, act<JobAction::Resume>},
      {{"POST", "/v1/jobs/{id}/cancel", "end the job", true}, act<JobAction::Cancel>},
      {{"GET", "/metrics", "gauges for Prometheus", false},
       [](const Call& c) -> WebResponse {
         const auto jobs = c.desk.jobs();
         if (!jobs) return problem(jobs.error());
         return {200, "text/plain; version=0.0.4; charset=utf-8", metrics_text(*jobs)};
       }},
  };
  return table;
}

}  // namespace

const std::vector<WebRoute>& web_routes() {
  static const std::vector<WebRoute> routes = [] {
    std::vector<WebRoute> list;
    for (const Row& row : rows()) list.push_back(row.route);
    list.push_back({"GET", "/v1/stream", "server-sent events: the job list whenever it changes", false});
    return list;
  }();
  return routes;
}

WebResponse answer(const WebRequest& request, JobDesk& desk, const WebOptions& options) {
  const std::string_view path = std::string_view{request.target}.substr(0, request.target.find('?'));
  const std::string_view method = request.method == "HEAD" ? std::string_view{"GET"} : std::string_view{request.method};
  bool path_known = false;
  for (const Row& row : rows()) {
    const auto arguments = match(row.route.path, path);
    if (!arguments) continue;
    path_known = true;
    if (row.route.method != method) continue;
    if (row.route.changes_state && !token_matches(request.authorization, options.token))
      return problem(
          401, "not-permitted",
          "this needs the operator's token: Authorization: Bearer TOKEN (DATA/web-token on the fab machine)");
    return row.run(Call{*arguments, desk, options});
  }
  if (path_known) return problem(405, "not-permitted", "this address does not take the method " + request.method);
  if (method != "GET") return problem(404, "not-found", "no such address");
  return asset(path, options);
}

std::string event_data(JobDesk& desk) {
  const Arguments none;
  const WebOptions options;
  return list_jobs(Call{none, desk, options}).body;
}

}  // namespace telefab::fab
