// SPDX-License-Identifier: GPL-3.0-or-later
#include "staging_routes.hpp"

#include <nlohmann/json.hpp>
#include <telefab/base/json_number.hpp>
#include <telefab/base/json_text.hpp>

namespace telefab::scan {
namespace {

using nlohmann::ordered_json;

/// The text under a key; nothing where it is missing or another kind of value.
std::optional<std::string> text_in(const ordered_json& body, const char* key) {
  const auto found = body.find(key);
  if (found == body.end() || !found->is_string()) return std::nullopt;
  return found->get<std::string>();
}

}  // namespace

WebResponse begin_upload(const Call& call) {
  AnnouncedFile file;
  try {
    const ordered_json body = parsed_json(call.request.body);
    file.name = body.at("name").get<std::string>();
    file.size_bytes = whole_number<std::uint64_t>(body.at("size_bytes"));
    const auto content = digest_from_hex(body.at("sha256").get<std::string>());
    if (!content) return web_problem(content.error());
    file.content = *content;
  } catch (const ordered_json::exception&) {
    return web_problem(400, "invalid-input",
                       R"(the body is {"name":"FILE","size_bytes":N,"sha256":"64 hexadecimal digits"})");
  }
  return web_json(call.staging.begin(file, call.who()));
}

WebResponse add_part(const Call& call) {
  const auto from = query_number(call.request.target, "from");
  if (!from) return web_problem(400, "invalid-input", "say behind how many bytes the part goes: ?from=N");
  return web_json(call.staging.append(call.id(), *from, call.request.body));
}

WebResponse show_level(const Call& call) {
  const auto revision = query_number(call.request.target, "revision");
  if (!revision) return web_problem(400, "invalid-input", "say of which picture: ?revision=N");
  auto level = call.staging.level(call.id(), *revision, call.routed.arguments.layer);
  if (!level) return web_problem(level.error());
  return {200, "application/octet-stream", std::move(*level)};
}

WebResponse join_uploads(const Call& call) {
  std::vector<std::string> with;
  try {
    const ordered_json body = parsed_json(call.request.body);
    for (const ordered_json& id : body.at("with")) with.push_back(id.get<std::string>());
  } catch (const ordered_json::exception&) {
    return web_problem(400, "invalid-input", R"(the body is {"with":["ID",...]}, the other views)");
  }
  return web_json(call.staging.join(call.id(), with, call.who()));
}

WebResponse discard_upload(const Call& call) {
  if (const auto gone = call.staging.discard(call.id(), call.who()); !gone) return web_problem(gone.error());
  return {200, "application/json", json_text({{"discarded", call.id()}})};
}

Result<StagingQuestion> question_of(const WebRequest& request) {
  const ordered_json body = json_or_discarded(request.body);
  const auto machine = body.is_object() ? text_in(body, "machine") : std::nullopt;
  if (!machine || machine->empty())
    return fail(ErrorCode::InvalidInput, R"(the body is {"machine":"NAME","parameters":{...}})");
  StagingQuestion question{*machine, "{}", text_in(body, "for").value_or("")};
  if (const auto parameters = body.find("parameters"); parameters != body.end()) {
    if (!parameters->is_object())
      return fail(ErrorCode::InvalidInput, "parameters: an object; GET /v1/parameters lists what may stand in it");
    question.parameters = json_text(*parameters);
  }
  return question;
}

WebResponse submit(const Call& call) {
  const auto question = question_of(call.request);
  if (!question) return web_problem(question.error());
  const auto job = call.staging.submit(call.id(), *question, call.who());
  if (!job) return web_problem(job.error());
  WebResponse made{201, "application/json", to_json(*job)};
  made.location = "/v1/jobs/" + job->id;
  return made;
}

}  // namespace telefab::scan
