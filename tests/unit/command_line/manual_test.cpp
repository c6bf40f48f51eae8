// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <telefab/command_line/manual.hpp>

namespace telefab {
namespace {

using ::testing::HasSubstr;

ProgramManual printer() {
  OptionManual coding;
  coding.name = "--coding";
  coding.value = "TEXT";
  coding.choices = {"exact", "curve"};
  coding.description = "how it's sent; .dots and \\slashes survive";
  coding.default_value = "curve";
  OptionManual fit;
  fit.name = "--fit";
  fit.description = "as large as possible";
  OptionManual scan;
  scan.name = "SCAN";
  scan.value = "TEXT";
  scan.description = "the file";
  scan.required = true;
  scan.positional = true;
  return {"prog-x",
          "1.2.3",
          "A program.",
          "Example: prog-x send a.ply\n",
          {{"send", "sends it", {coding, fit, scan}}, {"list", "lists", {}}}};
}

/// What bash offers after `words`, the last of them being typed.
std::string bash_offers(std::string_view words) {
  const auto folder = std::filesystem::temp_directory_path() / ("telefab-completion-" + std::to_string(::getpid()));
  std::filesystem::create_directories(folder);
  std::ofstream{folder / "script"} << completion_script(printer(), Shell::Bash);
  std::ofstream{folder / "ask"} << "compopt() { :; }\nsource " << (folder / "script").string() << "\nCOMP_WORDS=("
                                << words
                                << ")\nCOMP_CWORD=$(( ${#COMP_WORDS[@]} - 1 ))\n_prog_x\necho \"${COMPREPLY[*]}\" > "
                                << (folder / "answer").string() << "\n";
  const int code = std::system(("bash " + (folder / "ask").string()).c_str());
  std::string answer;
  std::getline(std::ifstream{folder / "answer"}, answer);
  std::filesystem::remove_all(folder);
  return code == 0 ? answer : "bash failed";
}

// The names are those that the verb prints when the shell asks, not those of the day the script was made.
TEST(Completion, AsksTheVerbThatListsThemForNames) {
  ProgramManual program = printer();
  OptionManual names, machine, resin;
  names.name = "--names";
  machine.name = "--machine", machine.value = "MACHINE";
  resin.name = "--resin", resin.value = "RESIN";
  program.verbs[0].options = {machine, resin};
  program.verbs[1] = {"machines", "lists", {names}};
  EXPECT_THAT(completion_script(program, Shell::Bash),
              HasSubstr("send,--machine) mapfile -t COMPREPLY < <(compgen -W \"$(timeout 3 prog-x machines --names"));
  EXPECT_THAT(completion_script(program, Shell::Zsh),
              HasSubstr("send,--machine) compadd -- ${(f)\"$(timeout 3 prog-x machines --names"));
  EXPECT_THAT(completion_script(program, Shell::Fish),
              HasSubstr("-l machine -x -a '(timeout 3 prog-x machines --names"));
  for (const Shell shell : {Shell::Bash, Shell::Zsh, Shell::Fish})
    EXPECT_THAT(completion_script(program, shell), testing::Not(HasSubstr("resins"))) << "no such verb";
}

TEST(Completion, OffersJobsWhereAJobIsNamed) {
  ProgramManual program = printer();
  OptionManual names, job;
  names.name = "--names";
  job.name = "JOB", job.positional = true;
  program.verbs[0].options = {job};
  program.verbs[1] = {"jobs", "lists", {names}};
  EXPECT_THAT(
      completion_script(program, Shell::Bash),
      HasSubstr(
          "    send) [[ $before == -* ]] || { mapfile -t COMPREPLY < <(compgen -W \"$(timeout 3 prog-x jobs --names"));
  EXPECT_THAT(
      completion_script(program, Shell::Zsh),
      HasSubstr("    send) if [[ $words[CURRENT-1] != -* ]]; then compadd -- ${(f)\"$(timeout 3 prog-x jobs --names"));
  EXPECT_THAT(completion_script(program, Shell::Fish),
              HasSubstr("__fish_seen_subcommand_from send' -f -a '(timeout 3 prog-x jobs --names"));
}

TEST(ManPage, names_every_verb_option_choice_and_exit_code) {
  const std::string page = man_page(printer());
  EXPECT_THAT(page, HasSubstr(".TH PROG\\-X 1"));
  EXPECT_THAT(page, HasSubstr(".SS send\nsends it\n"));
  EXPECT_THAT(page, HasSubstr("\\fB\\-\\-coding\\fR \\fIexact|curve\\fR"));
  EXPECT_THAT(page, HasSubstr("(default: curve)"));
  EXPECT_THAT(page, HasSubstr("\\fBprog\\-x send\\fR [\\fIoptions\\fR] \\fISCAN\\fR"));
  EXPECT_THAT(page, HasSubstr(".SH EXIT STATUS"));
}

TEST(ManPage, keeps_characters_that_mean_something_to_man) {
  ProgramManual program = printer();
  program.verbs[0].options[0].description = ".starts with a dot and has a \\ in it";
  EXPECT_THAT(man_page(program), HasSubstr("\n\\&.starts with a dot and has a \\e in it"));
}

TEST(Completion, bash_offers_verbs_first) { EXPECT_EQ(bash_offers("prog-x ''"), "send list --help --version"); }

TEST(Completion, bash_offers_the_options_of_the_verb) {
  EXPECT_EQ(bash_offers("prog-x send --"), "--help --coding --fit");
  EXPECT_EQ(bash_offers("prog-x list --"), "--help");
}

TEST(Completion, bash_offers_the_choices_of_an_option) {
  EXPECT_EQ(bash_offers("prog-x send --coding ''"), "exact curve");
  EXPECT_EQ(bash_offers("prog-x send --coding ex"), "exact");
}

TEST(Completion, quotes_what_a_shell_would_take_apart) {
  for (const Shell shell : {Shell::Zsh, Shell::Fish})
    EXPECT_THAT(completion_script(printer(), shell), HasSubstr("how it'\\''s sent"));
}

TEST(Completion, an_unknown_shell_is_refused_with_the_known_ones) {
  const auto shell = shell_from_name("csh");
  ASSERT_FALSE(shell);
  EXPECT_THAT(shell.error().what, HasSubstr("bash, zsh, fish"));
}

}  // namespace
}  // namespace telefab
