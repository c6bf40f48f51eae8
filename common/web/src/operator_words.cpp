// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/web/operator_words.hpp>

#include <array>
#include <nlohmann/json.hpp>
#include <telefab/base/json_text.hpp>
#include <utility>

namespace telefab {

Result<std::string> although_of(std::string_view body) {
  if (body.empty()) return std::string{};
  const auto wrong = [] { return fail(ErrorCode::InvalidInput, R"(the body is empty or {"although":["NAME"]})"); };
  const auto stated = json_or_discarded(body);
  if (!stated.is_object()) return wrong();
  if (stated.empty()) return std::string{};
  const auto names = stated.find("although");
  if (stated.size() != 1 || names == stated.end() || !names->is_array()) return wrong();
  std::string although;
  for (const auto& name : *names) {
    if (!name.is_string()) return wrong();
    although += (although.empty() ? "" : ",") + name.get<std::string>();
  }
  return although;
}

Result<JobCommand> resumption_of(std::string_view body) {
  if (body.empty()) return JobCommand::Resume;
  const auto stated = json_or_discarded(body);
  if (stated.is_object() && stated.empty()) return JobCommand::Resume;
  constexpr std::array kWords{
      std::pair{"treat-as-exposed", JobCommand::TreatAsExposed}, std::pair{"expose-again", JobCommand::ExposeAgain},
      std::pair{"treat-as-started", JobCommand::TreatAsStarted}, std::pair{"start-again", JobCommand::StartAgain}};
  if (stated.is_object() && stated.size() == 1 && stated.contains("as"))
    for (const auto& [name, word] : kWords)
      if (stated["as"] == name) return word;
  return fail(ErrorCode::InvalidInput,
              R"(the body is empty or {"as":"treat-as-exposed|expose-again|treat-as-started|start-again"})");
}

}  // namespace telefab
