// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <telefab/command_line/manual.hpp>

namespace telefab {
namespace {

/// Single-quoted for a shell.
std::string shell_quoted(std::string_view text) {
  std::string out = "'";
  for (const char c : text) {
    if (c == '\'')
      out += "'\\''";
    else
      out += c == '\n' ? ' ' : c;
  }
  return out + "'";
}

std::string function_name(std::string_view program) {
  std::string name = "_";
  for (const char c : program) name += c == '-' ? '_' : c;
  return name;
}

std::string verb_names(const ProgramManual& program) {
  std::string names;
  for (const VerbManual& verb : program.verbs) names += (names.empty() ? "" : " ") + verb.name;
  return names;
}

/// The verb of this program whose --names are the values of an option, or of a word by its place: `machines` for
/// MACHINE, `jobs` for JOB. Empty: none.
std::string lister_of(const ProgramManual& program, const OptionManual& option) {
  std::string verb = (option.positional ? option.name : option.value) + "s";
  std::ranges::transform(verb, verb.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto lists = [&](const VerbManual& each) {
    return each.name == verb && std::ranges::any_of(each.options, [](const auto& o) { return o.name == "--names"; });
  };
  return std::ranges::any_of(program.verbs, lists) ? verb : std::string{};
}

/// What lists the words of a verb that stand by their place; empty: they are files.
std::string place_lister_of(const ProgramManual& program, const VerbManual& verb) {
  for (const OptionManual& option : verb.options)
    if (option.positional) return lister_of(program, option);
  return {};
}

/// What prints the names; a site that does not answer is not waited for.
std::string listing(const ProgramManual& program, const std::string& verb) {
  return fmt::format("timeout 3 {} {} --names 2>/dev/null", program.name, verb);
}

std::string bash_script(const ProgramManual& program) {
  std::string script = fmt::format(
      "# bash completion for {0}\n{1}() {{\n  local word=${{COMP_WORDS[COMP_CWORD]}} "
      "before=${{COMP_WORDS[COMP_CWORD-1]}} verb=\n"
      "  COMPREPLY=()\n  (( COMP_CWORD > 1 )) && verb=${{COMP_WORDS[1]}}\n"
      "  case $verb,$before in\n",
      program.name, function_name(program.name));
  for (const VerbManual& verb : program.verbs)
    for (const OptionManual& option : verb.options) {
      if (!option.positional && !option.choices.empty())
        script += fmt::format("    {},{}) mapfile -t COMPREPLY < <(compgen -W {} -- \"$word\"); return ;;\n", verb.name,
                              option.name, shell_quoted(fmt::format("{}", fmt::join(option.choices, " "))));
      if (const std::string lister = lister_of(program, option); !option.positional && !lister.empty())
        script += fmt::format("    {},{}) mapfile -t COMPREPLY < <(compgen -W \"$({})\" -- \"$word\"); return ;;\n",
                              verb.name, option.name, listing(program, lister));
    }
  script +=
      fmt::format("  esac\n  case $verb in\n    '') mapfile -t COMPREPLY < <(compgen -W {} -- \"$word\"); return ;;\n",
                  shell_quoted(verb_names(program) + " --help --version"));
  for (const VerbManual& verb : program.verbs) {
    std::string names = "--help";
    for (const OptionManual& option : verb.options)
      if (!option.positional) names += " " + option.name;
    script += fmt::format(
        "    {}) [[ $word == -* ]] && {{ mapfile -t COMPREPLY < <(compgen -W {} -- \"$word\"); return; }} ;;\n",
        verb.name, shell_quoted(names));
  }
  script += "  esac\n  case $verb in\n";
  for (const VerbManual& verb : program.verbs)
    if (const std::string lister = place_lister_of(program, verb); !lister.empty())
      // Behind an option stands its value, which is most likely a file.
      script += fmt::format(
          "    {}) [[ $before == -* ]] || {{ mapfile -t COMPREPLY < <(compgen -W \"$({})\" -- \"$word\"); return; }} "
          ";;\n",
          verb.name, listing(program, lister));
  script += fmt::format(
      "  esac\n  compopt -o filenames\n  mapfile -t COMPREPLY < <(compgen -f -- \"$word\")\n}}\n"
      "complete -F {} {}\n",
      function_name(program.name), program.name);
  return script;
}

std::string zsh_script(const ProgramManual& program) {
  std::string script = fmt::format("#compdef {0}\n{1}() {{\n  if (( CURRENT == 2 )); then\n    local -a verbs=(\n",
                                   program.name, function_name(program.name));
  const auto entry = [](std::string_view name, std::string_view description) {
    std::string escaped;
    for (const char c : name) escaped += c == ':' ? std::string{"\\:"} : std::string{c};
    return shell_quoted(fmt::format("{}:{}", escaped, description));
  };
  for (const VerbManual& verb : program.verbs) script += fmt::format("      {}\n", entry(verb.name, verb.summary));
  script +=
      "    )\n    _describe verb verbs\n    return\n  fi\n  local -a options=()\n  case $words[2],$words[CURRENT-1] "
      "in\n";
  for (const VerbManual& verb : program.verbs)
    for (const OptionManual& option : verb.options) {
      if (!option.positional && !option.choices.empty())
        script += fmt::format("    {},{}) compadd -- {}; return ;;\n", verb.name, option.name,
                              fmt::join(option.choices, " "));
      if (const std::string lister = lister_of(program, option); !option.positional && !lister.empty())
        script += fmt::format("    {},{}) compadd -- ${{(f)\"$({})\"}}; return ;;\n", verb.name, option.name,
                              listing(program, lister));
    }
  script += "  esac\n  case $words[2] in\n";
  for (const VerbManual& verb : program.verbs) {
    script += fmt::format("    {}) options=(\n", verb.name);
    for (const OptionManual& option : verb.options)
      if (!option.positional) script += fmt::format("      {}\n", entry(option.name, option.description));
    script += "    ) ;;\n";
  }
  script +=
      "  esac\n  if [[ $words[CURRENT] == -* ]]; then _describe option options; return; fi\n  case $words[2] in\n";
  for (const VerbManual& verb : program.verbs)
    if (const std::string lister = place_lister_of(program, verb); !lister.empty())
      script +=
          fmt::format("    {}) if [[ $words[CURRENT-1] != -* ]]; then compadd -- ${{(f)\"$({})\"}}; return; fi ;;\n",
                      verb.name, listing(program, lister));
  script += fmt::format("  esac\n  _files\n}}\n{} \"$@\"\n", function_name(program.name));
  return script;
}

std::string fish_script(const ProgramManual& program) {
  std::string script = fmt::format("# fish completion for {}\n", program.name);
  for (const VerbManual& verb : program.verbs) {
    script += fmt::format("complete -c {} -n __fish_use_subcommand -f -a {} -d {}\n", program.name, verb.name,
                          shell_quoted(verb.summary));
    for (const OptionManual& option : verb.options) {
      if (option.positional) continue;
      script += fmt::format("complete -c {} -n '__fish_seen_subcommand_from {}' -l {}", program.name, verb.name,
                            option.name.substr(option.name.find_first_not_of('-')));
      if (!option.choices.empty())
        script += fmt::format(" -x -a {}", shell_quoted(fmt::format("{}", fmt::join(option.choices, " "))));
      else if (const std::string lister = lister_of(program, option); !lister.empty())
        script += fmt::format(" -x -a {}", shell_quoted(fmt::format("({})", listing(program, lister))));
      else if (!option.value.empty())
        script += " -r";
      script += fmt::format(" -d {}\n", shell_quoted(option.description));
    }
    if (const std::string lister = place_lister_of(program, verb); !lister.empty())
      script += fmt::format("complete -c {} -n '__fish_seen_subcommand_from {}' -f -a {}\n", program.name, verb.name,
                            shell_quoted(fmt::format("({})", listing(program, lister))));
  }
  return script;
}

}  // namespace

Result<Shell> shell_from_name(std::string_view name) {
  if (name == "bash") return Shell::Bash;
  if (name == "zsh") return Shell::Zsh;
  if (name == "fish") return Shell::Fish;
  return fail(ErrorCode::InvalidInput, fmt::format("{} is not a shell known here; there are: bash, zsh, fish", name));
}

std::string completion_script(const ProgramManual& program, Shell shell) {
  switch (shell) {
    case Shell::Bash:
      return bash_script(program);
    case Shell::Zsh:
      return zsh_script(program);
    case Shell::Fish:
      return fish_script(program);
  }
  return {};
}

}  // namespace telefab
