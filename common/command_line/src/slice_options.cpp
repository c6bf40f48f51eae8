// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <map>
#include <telefab/command_line/slice_options.hpp>

namespace telefab {
namespace {

Option declare(VerbOptions& options, SliceParameters& into, const SliceParameter& row, const ReadText& read) {
  const std::string name = option_name(row), help{row.help};
  if (const auto* flag = std::get_if<SliceParameter::Flag>(&row.field)) return options.flag(name, into.**flag, help);
  if (const auto* number = std::get_if<SliceParameter::Number>(&row.field))
    return options.add(name, into.**number, help).such_that(text_of(row.range), [range = row.range](double value) {
      return contains(range, value);
    });
  const Option choice = options.add(name, into.*std::get<SliceParameter::Choice>(row.field), help);
  if (row.subject == SliceParameter::Subject::Profile) choice.names(row.key == "resin" ? "RESIN" : "PRINT");
  if (!row.choices.empty())
    choice.one_of({row.choices.begin(), row.choices.end()});
  else if (read && row.subject == SliceParameter::Subject::Slicing)
    choice.read_by([&row, read](const std::string& text) { return read(row, text); });
  return row.fallback.empty() ? choice : choice.shows_default(std::string{row.fallback});
}

template <class IsWanted>
void declare_rows(VerbOptions& options, SliceParameters& into, const IsWanted& is_wanted, const ReadText& read = {}) {
  std::map<std::string_view, Option> declared;
  for (const SliceParameter& row : slice_parameter_table()) {
    if (!is_wanted(row)) continue;
    const Option option = declared.emplace(row.key, declare(options, into, row, read)).first->second;
    for (const std::string_view other : row.not_with)
      if (const auto excluded = declared.find(other); excluded != declared.end()) option.excludes(excluded->second);
  }
}

}  // namespace

void declare_slice_parameters(VerbOptions& options, SliceParameters& into, std::span<const std::string_view> keys,
                              const ReadText& read) {
  declare_rows(
      options, into,
      [keys](const SliceParameter& row) {
        return keys.empty() ? row.subject == SliceParameter::Subject::Slicing
                            : std::ranges::find(keys, row.key) != keys.end();
      },
      read);
}

void declare_job_parameters(VerbOptions& options, SliceParameters& into) {
  declare_rows(options, into, [](const SliceParameter&) { return true; });
}

}  // namespace telefab
