// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <cstdlib>
#include <map>
#include <regex>
#include <set>
#include <sstream>

#include <telefab/job/slice_parameters.hpp>
#include <telefab/test/process.hpp>

// Examples rot when options change. Each is held against the --help of its verb: words, values of choices, what is
// required.
namespace telefab::test {
namespace {

using testing::HasSubstr;

struct Option {
  std::set<std::string> choices;  ///< none: anything goes
  bool takes_value = false;
  bool required = false;
};

struct Help {
  std::map<std::string, Option> options;
  std::size_t required_words = 0, words = 0;  ///< positional
  bool any_words = false;                     ///< as many as one likes
  std::vector<std::string> examples;
};

std::string help_text(const std::string& program, const std::string& verb) {
  const Outcome asked = run({std::string{::getenv("TELEFAB_BIN")} + "/" + program, verb, "--help"});
  EXPECT_EQ(asked.code, 0) << program << ' ' << verb;
  return asked.output;
}

std::vector<std::string> words_of(const std::string& line) {
  std::istringstream in{line};
  std::vector<std::string> words;
  for (std::string word; in >> word;) words.push_back(word);
  return words;
}

Help read_help(const std::string& text) {
  Help help;
  static const std::regex option{R"(^  (?:-\w,)?(--[\w-]+)(?: (\w+(?::[^=]*)?))?(?:=\S*)?(.*)$)"};
  static const std::regex word{R"(^  ([A-Z]+) (?:TEXT|FLOAT|INT|UINT)(\S*)(.*)$)"};
  static const std::regex choices{R"(\{([^}]*)\})"};
  bool in_examples = false;
  std::istringstream in{text};
  for (std::string line; std::getline(in, line);) {
    if (line == "Examples:") in_examples = true;
    std::smatch found;
    if (in_examples) {
      if (line.starts_with("    ")) help.examples.push_back(line.substr(4));
    } else if (std::regex_match(line, found, option)) {
      Option& known = help.options[found[1]];
      const std::string kind = found[2].str(), rest = line;
      static const std::set<std::string> kinds{"TEXT", "FLOAT", "INT", "UINT", "MACHINE", "RESIN", "PRINT", "SITE"};
      known.takes_value = kinds.contains(kind.substr(0, kind.find(':')));
      known.required = rest.find("REQUIRED") != std::string::npos;
      std::smatch list;
      if (known.takes_value && std::regex_search(line, list, choices)) {
        std::istringstream names{list[1]};
        for (std::string name; std::getline(names, name, ',');) known.choices.insert(name.substr(0, name.find("->")));
      }
    } else if (std::regex_match(line, found, word)) {
      ++help.words;
      help.required_words += line.find("REQUIRED") != std::string::npos;
      help.any_words |= line.find("...") != std::string::npos;
    }
  }
  return help;
}

void hold_against(const std::string& example, const Help& help) {
  SCOPED_TRACE(example);
  const std::vector<std::string> words = words_of(example);
  std::size_t positional = 0;
  std::set<std::string> given;
  for (std::size_t i = 2; i < words.size(); ++i) {
    if (!words[i].starts_with("--")) {
      ++positional;
      continue;
    }
    const auto option = help.options.find(words[i]);
    ASSERT_NE(option, help.options.end()) << words[i] << " is not an option";
    given.insert(words[i]);
    if (!option->second.takes_value) continue;
    ASSERT_LT(++i, words.size()) << "a value is missing";
    if (!option->second.choices.empty()) {
      EXPECT_TRUE(option->second.choices.contains(words[i])) << words[i];
    }
  }
  EXPECT_GE(positional, help.required_words);
  if (!help.any_words) {
    EXPECT_LE(positional, help.words);
  }
  for (const auto& [name, option] : help.options)
    if (option.required) {
      EXPECT_TRUE(given.contains(name)) << name << " is required";
    }
}

class HelpOf : public testing::TestWithParam<std::string> {};

TEST_P(HelpOf, EveryVerbGivesExamplesThatItsOptionsAllow) {
  const std::string program = GetParam();
  const Outcome asked = run({std::string{::getenv("TELEFAB_BIN")} + "/" + program, "--help"});
  ASSERT_EQ(asked.code, 0);
  std::map<std::string, Help> helps;
  static const std::regex verb{R"(^  ([a-z-]+)  +\S.*$)"};
  std::istringstream in{asked.output.substr(asked.output.find("Subcommands:"))};
  std::smatch found;
  for (std::string line; std::getline(in, line) && !line.starts_with("Example");)
    if (std::regex_match(line, found, verb) && found[1] != "manual" && found[1] != "completion")
      helps[found[1]] = read_help(help_text(program, found[1]));
  EXPECT_GE(helps.size(), 9U);
  for (const auto& [name, help] : helps) {
    EXPECT_FALSE(help.examples.empty()) << program << ' ' << name;
    for (const std::string& example : help.examples) {
      const auto words = words_of(example);
      ASSERT_GE(words.size(), 2U) << example;
      EXPECT_TRUE(words[0].starts_with("telefab")) << example;
      // An example may show the next step, with another verb or program.
      const Help other =
          words[0] == program && helps.contains(words[1]) ? helps[words[1]] : read_help(help_text(words[0], words[1]));
      hold_against(example, other);
    }
  }
}

// Knobs were once listed by hand for each program, and some could not be submitted.
TEST(SliceParameterOptions, AreTheSameForSliceAndSubmitAndMostOfThemForInspect) {
  const Help slice = read_help(help_text("telefab-scan", "slice")), submit = read_help(help_text("telefab", "submit"));
  const Help inspect = read_help(help_text("telefab-scan", "inspect"));
  for (const SliceParameter& row : slice_parameter_table()) {
    const bool is_of_fleet = row.subject == SliceParameter::Subject::Fleet;
    EXPECT_EQ(slice.options.contains(option_name(row)), !is_of_fleet) << row.key << ": of submitted jobs alone";
    for (const Help* help : {is_of_fleet ? &submit : &slice, &submit}) {
      const auto option = help->options.find(option_name(row));
      ASSERT_NE(option, help->options.end()) << row.key;
      EXPECT_EQ(option->second.takes_value, !std::holds_alternative<SliceParameter::Flag>(row.field)) << row.key;
      EXPECT_EQ(option->second.choices, (std::set<std::string>{row.choices.begin(), row.choices.end()})) << row.key;
    }
  }
  for (const char* placing : {"--height-mm", "--scale", "--fit", "--units", "--up", "--rotate", "--mirror",
                              "--scale-axes", "--position", "--surface", "--kernel-mm"})
    EXPECT_TRUE(inspect.options.contains(placing)) << placing;
}

TEST_P(HelpOf, ManualPageShowsTheExamplesToo) {
  const Outcome page = run({std::string{::getenv("TELEFAB_BIN")} + "/" + GetParam(), "manual"});
  ASSERT_EQ(page.code, 0);
  EXPECT_THAT(page.output, testing::AllOf(HasSubstr("\nExamples:\n"), HasSubstr(".SH EXIT STATUS")));
}
INSTANTIATE_TEST_SUITE_P(Programs, HelpOf, testing::Values("telefab", "telefab-scan", "telefab-fab"),
                         [](const auto& name) { return std::regex_replace(name.param, std::regex{"-"}, "_"); });

}  // namespace
}  // namespace telefab::test
