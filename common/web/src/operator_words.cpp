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
  const auto said = json_or_discarded(body);
  if (!said.is_object()) return wrong();
  if (said.empty()) return std::string{};
  const auto names = said.find("although");
  if (said.size() != 1 || names == said.end() || !names->is_array()) return wrong();
  std::string although;
  for (const auto& name : *names) {
    if (!name.is_string()) return wrong();
    although += (although.empty() ? "" : ",") + name.get<std::string>();
  }
  return although;
}

Result<JobCommand> resumption_of(std::string_view body) {
  if (body.empty()) return JobCommand::Resume;
  const auto said = json_or_discarded(body);
  if (said.is_object() && said.empty()) return JobCommand::Resume;
  constexpr std::array kWords{
      std::pair{"treat-as-exposed", JobCommand::TreatAsExposed}, std::pair{"expose-again", JobCommand::ExposeAgain},
      std::pair{"treat-as-started", JobCommand::TreatAsStarted}, std::pair{"start-again", JobCommand::StartAgain}};
  if (said.is_object() && said.size() == 1 && said.contains("as"))
    for (const auto& [name, word] : kWords)
      if (said["as"] == name) return word;
  return fail(ErrorCode::InvalidInput,
              R"(the body is empty or {"as":"treat-as-exposed|expose-again|treat-as-started|start-again"})");
}

}  // namespace telefab
