// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/web/api_page.hpp>

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>

namespace telefab {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::string_view kSchemas = "#/components/schemas/";

/// A bar would end the cell of a table.
std::string cell(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) text.insert(at, "\\");
  return text;
}

std::string upper(std::string text) {
  for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return text;
}

/// "text", "a number, 0 to 1", "list of ...", or a link to the schema.
std::string kind_of(const Json& schema) {
  if (schema.contains("$ref")) {
    const std::string name = schema["$ref"].get<std::string>().substr(kSchemas.size());
    std::string anchor = name;
    for (char& c : anchor) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return fmt::format("[{}](#{})", name, anchor);
  }
  if (schema.contains("enum")) {
    std::string all;
    for (const Json& each : schema["enum"]) all += (all.empty() ? "`" : ", `") + each.get<std::string>() + "`";
    return all;
  }
  std::string kind = schema.value("type", "anything");
  if (kind == "array" && schema.contains("items")) return "list of " + kind_of(schema["items"]);
  if (kind == "object" && schema.contains("properties")) {
    std::string keys;
    for (const auto& [key, value] : schema["properties"].items())
      keys += fmt::format("{}`{}`: {}", keys.empty() ? "" : ", ", key, kind_of(value));
    return "object of " + keys;
  }
  if (schema.contains("minimum") || schema.contains("maximum"))
    kind += fmt::format(", {} to {}", schema.contains("minimum") ? json_text(schema["minimum"]) : "any",
                        schema.contains("maximum") ? json_text(schema["maximum"]) : "any");
  return kind;
}

std::string who_of(const Json& api, const Json& operation) {
  const Json& ways = operation.contains("security") ? operation["security"] : api.at("security");
  if (ways.empty()) return "Anybody.";
  const bool is_open = std::any_of(ways.begin(), ways.end(), [](const Json& way) { return way.empty(); });
  return is_open ? "Whoever may look." : "Operators.";
}

void add_operation(std::string& page, const Json& api, const std::string& method, const std::string& path,
                   const Json& operation) {
  page += fmt::format("\n### {} {}\n\n", upper(method), path);
  std::string summary = operation.at("summary");
  summary.front() = static_cast<char>(std::toupper(static_cast<unsigned char>(summary.front())));
  page += fmt::format("{}. {}\n", summary, who_of(api, operation));
  if (operation.contains("parameters")) page += "\n";
  for (const Json& each : operation.value("parameters", Json::array()))
    page +=
        fmt::format("- `{}` in the {}{}: {}{}\n", each.at("name").get<std::string>(), each.at("in").get<std::string>(),
                    each.value("required", false) ? "" : ", where wanted", kind_of(each.at("schema")),
                    each.contains("description") ? "; " + each["description"].get<std::string>() : "");
  if (operation.contains("requestBody")) {
    const Json& body = operation["requestBody"];
    for (const auto& [type, content] : body.at("content").items())
      page += fmt::format("\nBody, {}{}{}\n", type, content.contains("schema") ? ": " + kind_of(content["schema"]) : "",
                          body.contains("description") ? "; " + body["description"].get<std::string>() : "");
  }
  page += "\n| answer | what |\n|---|---|\n";
  for (const auto& [status, answer] : operation.at("responses").items()) {
    std::string what = answer.at("description");
    const Json contents = answer.value("content", Json::object());  // items() keeps nothing alive
    for (const auto& [type, content] : contents.items())
      if (content.contains("schema")) what += ": " + kind_of(content["schema"]);
    page += fmt::format("| {} | {} |\n", status, cell(what));
  }
}

std::string page_of(const Json& api) {
  const Json& info = api.at("info");
  const std::string title = info.at("title");
  constexpr std::string_view kOurs = "Telefab ";
  std::string page = fmt::format(
      "# API of the {}\n\nMade by the verb `api` of its program; `--json` gives the same as OpenAPI {}, which the site "
      "answers at `/openapi.json`.\n\n{}\n",
      title.starts_with(kOurs) ? title.substr(kOurs.size()) : title, api.at("openapi").get<std::string>(),
      info.at("description").get<std::string>());
  page += "\n## Operations\n";
  for (const auto& [path, methods] : api.at("paths").items())
    for (const auto& [method, operation] : methods.items()) add_operation(page, api, method, path, operation);
  if (!api.at("components").contains("schemas")) return page;
  page += "\n## Bodies\n";
  for (const auto& [name, schema] : api["components"]["schemas"].items()) {
    page += fmt::format("\n### {}\n\n", name);
    if (schema.contains("description")) page += schema["description"].get<std::string>() + ".\n\n";
    page += "| key | is | meaning |\n|---|---|---|\n";
    for (const auto& [key, value] : schema.at("properties").items())
      page += fmt::format("| `{}` | {} | {} |\n", key, cell(kind_of(value)), cell(value.value("description", "")));
  }
  return page;
}

}  // namespace

Result<std::string> api_page(std::string_view openapi_json) {
  try {
    return page_of(parsed_json(openapi_json));
  } catch (const Json::exception& error) {
    return fail(ErrorCode::InvalidInput, fmt::format("not a description of an API: {}", error.what()));
  }
}

}  // namespace telefab
