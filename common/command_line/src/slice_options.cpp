// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <map>
#include <telefab/command_line/slice_options.hpp>

namespace telefab {
namespace {

std::string out_of_range(const SliceParameter& row, const std::string& text) {
  double value = 0;
  if (CLI::detail::lexical_cast(text, value) && contains(row.range, value)) return {};
  return fmt::format("{} is not a number {}", text, text_of(row.range));
}

CLI::Option* declare(CLI::App& options, SliceParameters& into, const SliceParameter& row) {
  const std::string name = option_name(row), help{row.help};
  if (const auto* flag = std::get_if<SliceParameter::Flag>(&row.field))
    return options.add_flag(name, into.**flag, help);
  if (const auto* number = std::get_if<SliceParameter::Number>(&row.field))
    return options.add_option(name, into.**number, help)->check([&row](const std::string& text) {
      return out_of_range(row, text);
    });
  CLI::Option* choice = options.add_option(name, into.*std::get<SliceParameter::Choice>(row.field), help)
                            ->check(CLI::IsMember(std::vector<std::string>{row.choices.begin(), row.choices.end()}));
  return row.fallback.empty() ? choice : choice->default_str(std::string{row.fallback});
}

}  // namespace

void declare_slice_parameters(CLI::App& options, SliceParameters& into, std::span<const std::string_view> keys) {
  std::map<std::string_view, CLI::Option*> declared;
  for (const SliceParameter& row : slice_parameter_table()) {
    if (!keys.empty() && std::ranges::find(keys, row.key) == keys.end()) continue;
    CLI::Option* option = declared[row.key] = declare(options, into, row);
    for (const std::string_view other : row.not_with)
      if (const auto excluded = declared.find(other); excluded != declared.end()) option->excludes(excluded->second);
  }
}

}  // namespace telefab
