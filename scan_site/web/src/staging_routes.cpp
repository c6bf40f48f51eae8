// SPDX-License-Identifier: GPL-3.0-or-later
#include "staging_routes.hpp"

#include <nlohmann/json.hpp>
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
  const ordered_json body = json_or_discarded(call.request.body);
  constexpr const char* kWanted = R"(the body is {"name":"FILE","size_bytes":N,"sha256":"64 hexadecimal digits"})";
  if (!body.is_object()) return web_problem(400, "invalid-input", kWanted);
  const auto name = text_in(body, "name"), sha256 = text_in(body, "sha256");
  const auto size = body.find("size_bytes");
  if (!name || !sha256 || size == body.end() || !size->is_number_unsigned())
    return web_problem(400, "invalid-input", kWanted);
  const auto content = digest_from_hex(*sha256);
  if (!content) return web_problem(content.error());
  return web_json(call.staging.begin({*name, size->get<std::uint64_t>(), *content}, call.who()));
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
