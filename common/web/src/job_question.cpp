// SPDX-License-Identifier: GPL-3.0-or-later
#include <telefab/web/job_question.hpp>

#include <fmt/format.h>

#include <telefab/base/text.hpp>
#include <telefab/web/web_message.hpp>

namespace telefab {
namespace {

constexpr std::size_t kMostWords_bytes = 200;

Result<std::vector<JobState>> states_of(std::string_view names) {
  std::vector<JobState> states;
  while (true) {
    const std::string_view name = names.substr(0, names.find(','));
    const auto state = job_state_from_name(name);
    if (!state) return tl::unexpected{state.error()};
    states.push_back(*state);
    if (name.size() == names.size()) return states;
    names.remove_prefix(name.size() + 1);
  }
}

}  // namespace

Result<std::optional<JobQuery>> job_question_of(std::string_view target) {
  const auto search = query_text(target, "search"), state = query_text(target, "state"),
             most = query_text(target, "most"), before = query_text(target, "before");
  if (!search && !state && !most && !before) return std::optional<JobQuery>{};
  JobQuery query;
  if (search) {
    if (!is_printable(*search) || search->size() > kMostWords_bytes)
      return fail(ErrorCode::InvalidInput, fmt::format("search: up to {} bytes of words", kMostWords_bytes));
    query.words = *search;
  }
  if (state) {
    auto states = states_of(*state);
    if (!states) return fail_in("state", states.error());
    query.states = std::move(*states);
  }
  if (most) {
    const auto number = query_number(target, "most");
    if (!number || *number < 1 || *number > kMostJobsOfAPage)
      return fail(ErrorCode::InvalidInput, fmt::format("most: 1 to {}", kMostJobsOfAPage));
    query.most = static_cast<std::uint32_t>(*number);
  }
  if (before) {
    const auto number = query_number(target, "before");
    if (!number || *number < 1 || *number > std::uint64_t{1} << 62U)
      return fail(ErrorCode::InvalidInput, "before: \"next\" of the page before");
    query.before = *number;
  }
  return std::optional{query};
}

}  // namespace telefab
