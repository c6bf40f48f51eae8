// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

// Words that were given up, so that they do not come back: one word, one meaning. A row is a word and what is said
// instead; to take one back into use, take its row away, with the reason.
namespace {

namespace fs = std::filesystem;

struct Word {
  std::string_view old;  ///< lower case, snake_case: "offer_taken" also stands for OfferTaken and OFFER_TAKEN
  std::string_view instead;
  std::string_view in = {};  ///< of paths that begin so only; everywhere by default
};

/// Nowhere: identifiers, comments, messages, pages, documents. Other forms of a word are words of their own.
constexpr Word kNowhere[] = {
    {"desk", "service, JobService, StackReceiver, PageBackend"},
    {"greet", "handshake"},
    {"greets", "handshake"},
    {"greeted", "ready, past its handshake"},
    {"greeting", "handshake"},
    {"stranger", "unauthenticated peer"},
    {"strangers", "unauthenticated peers"},
    {"offer_taken", "OfferAccepted"},
    {"chunk_kept", "ChunkStored"},
    {"stack_kept", "StackStored"},
    {"send_more", "UploadReady"},
    {"take_up", "resume_unfinished"},
    {"put_away", "close"},
    {"spool_shelf", "SpoolRegistry"},
    {"locked_spool", "SharedSpool"},
    {"resume_again", "expose-again"},
    {"resume_dark", "expose-again"},
    {"resume_exposed", "treat-as-exposed"},
    {"decided_again", "DecidedExposeAgain"},
    {"reckon", "compute"},
    {"reckons", "computes"},
    {"reckoned", "computed"},
    {"reckoning", "computation"},
    {"fleck", "speck"},
    {"flecks", "specks"},
    {"crumb", "speck"},
    {"crumbs", "specks"},
    {"sliver", "speck; of a ring: thin"},
    {"slivers", "specks; of rings: thin ones"},
    {"bend_per_mm", "curvature_per_mm"},
    {"sift", "candidate search; of a cloud: pick the object"},
    {"sifts", "picks"},
    {"sifted", "picked"},
    {"sifting", "picking"},
    {"steep_sift_cos", "min_start_nz"},
    {"with_wider_kernel", "with_scaled_kernel"},
    {"polish", "project_in_plane"},
    {"onto_level", "project_in_plane"},
    {"false_sheet", "FalseBranch"},
    {"deed", "operation"},
    {"deeds", "operations"},
    {"misfortune", "injected fault"},
    {"witness", "recorder"},
    {"witnessed", "recorded"},
    {"anew", "again; of a ring on the wire: intra"},
    {"in_doubt", "exposure_unknown; of the graph: inconsistent"},
    {"doubt_about_scale", "scale_warning"},
    {"scale_doubt", "scale_warning"},
    {"dose_doubt", "dose_tolerance"},
};

/// No part of a name in code; in a sentence they are English.
constexpr Word kInNoName[] = {
    {"say", "send; or name what is made"},
    {"said", "sent, stated, sentences"},
    {"hear", "receive, handle"},
    {"heard", "received"},
    {"hears", "receives"},
    {"tell", "send, notify, print_figures"},
    {"told", "last_sent, own, listed"},
    {"mine", "own_job, own"},
    {"welcome", "on_connection"},
    {"met", "on_ready", "common/"},
    {"doubts", "inconsistencies, warnings"},
    {"doubt", "exposure_unknown, hold_reason", "fab_site/daemon/"},
    {"doubt", "inconsistency", "scan_site/topology/"},
    {"settle", "project_in_plane; settling is a state of the print", "scan_site/"},
    {"settled", "converged, relaxed", "scan_site/"},
};
/// Names of libraries.
constexpr std::string_view kForeign[] = {"zip_source_tell"};

/// The parts of a name in lower case: "is_greeted_", "IsGreeted" and "IS_GREETED" are "is" and "greeted".
std::string in_snake_case(std::string_view name) {
  std::string snake;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const auto at = [&](std::size_t k) { return k < name.size() ? static_cast<unsigned char>(name[k]) : 0U; };
    const bool is_new = i > 0 && std::isupper(at(i)) && (!std::isupper(at(i - 1)) || std::islower(at(i + 1)));
    if (is_new && !snake.empty() && snake.back() != '_') snake += '_';
    snake += static_cast<char>(std::tolower(at(i)));
  }
  return snake;
}

/// Whether the parts of `old` stand one behind the other among those of the name.
bool has_part(std::string_view snake, std::string_view old) {
  for (std::size_t at = snake.find(old); at != std::string_view::npos; at = snake.find(old, at + 1)) {
    const std::size_t end = at + old.size();
    if ((at == 0 || snake[at - 1] == '_') && (end == snake.size() || snake[end] == '_')) return true;
  }
  return false;
}

bool is_word(char c) { return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_'; }

/// The names and words of a text, each with where it begins.
template <class Use>
void for_each_name(std::string_view text, const Use& use) {
  for (std::size_t at = 0; at < text.size();) {
    if (!is_word(text[at])) {
      ++at;
      continue;
    }
    std::size_t end = at;
    while (end < text.size() && is_word(text[end])) ++end;
    use(text.substr(at, end - at), at);
    at = end;
  }
}

/// The source with comments and literals blanked, or with all but the string literals: same length, same lines.
std::string blanked(std::string_view source, bool keeps_strings) {
  std::string kept(source);
  std::size_t at = 0;
  const auto blank = [&](std::size_t end) {
    for (; at < end; ++at)
      if (kept[at] != '\n') kept[at] = ' ';
  };
  const auto pass_literal = [&](std::size_t end, bool is_string) {
    end = std::min(end, source.size());
    if (is_string == keeps_strings && is_string)
      at = end;
    else
      blank(end);
  };
  while (at < source.size()) {
    if (source.substr(at).starts_with("//")) {
      blank(std::min(source.find('\n', at), source.size()));
    } else if (source.substr(at).starts_with("/*")) {
      blank(std::min(source.find("*/", at), source.size() - 2) + 2);
    } else if (source.substr(at).starts_with("R\"") && (at == 0 || !is_word(source[at - 1]))) {
      const std::size_t open = source.find('(', at);
      const std::string close = ")" + std::string{source.substr(at + 2, open - at - 2)} + "\"";
      pass_literal(std::min(source.find(close, open), source.size() - close.size()) + close.size(), true);
    } else if (source[at] == '"' || (source[at] == '\'' && (at == 0 || !is_word(source[at - 1])))) {
      std::size_t end = at + 1;
      while (end < source.size() && source[end] != source[at] && source[end] != '\n')
        end += source[end] == '\\' ? 2 : 1;
      pass_literal(end + 1, source[at] == '"');
    } else if (source.substr(at).starts_with("#include") || source.substr(at).starts_with("TEST")) {
      // Names of files are held by kNowhere, and the name of a test is a sentence.
      const std::size_t end = std::min(source.find('\n', at), source.size());
      blank(end);
    } else {
      if (keeps_strings && kept[at] != '\n') kept[at] = ' ';
      ++at;
    }
  }
  return kept;
}

/// "is no number" and the like; "there is no such job" is English. Where it begins, or npos.
std::size_t is_no_something(std::string_view text, std::size_t from) {
  static constexpr std::string_view kFine[] = {"longer", "other", "more", "such", "telling", "need"};
  constexpr std::string_view kIsNo = "is no ";
  for (std::size_t at = text.find(kIsNo, from); at != std::string_view::npos; at = text.find(kIsNo, at + 1)) {
    if (at > 0 && is_word(text[at - 1])) continue;
    if (text.substr(0, at).ends_with("there ") || text.substr(0, at).ends_with("There ")) continue;
    const std::string_view noun = text.substr(at + kIsNo.size());
    if (std::none_of(std::begin(kFine), std::end(kFine), [&](std::string_view fine) { return noun.starts_with(fine); }))
      return at;
  }
  return std::string_view::npos;
}

struct File {
  std::string path, text;
  [[nodiscard]] bool is_code() const { return path.ends_with(".cpp") || path.ends_with(".hpp"); }
  [[nodiscard]] std::string place(std::size_t at) const {
    const auto line = std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n') + 1;
    return path + ":" + std::to_string(line) + ": ";
  }
};

/// Sources, pages, scripts and documents; no corpus, no library, and not this table.
const std::vector<File>& all_files() {
  static const std::vector<File> files = [] {
    const char* source = std::getenv("TELEFAB_SOURCE");
    const fs::path root = source ? source : "";
    std::vector<fs::path> found;
    for (const char* tree : {"common", "scan_site", "fab_site", "tests", "proto", "deploy"})
      for (const auto& entry : fs::recursive_directory_iterator(root / tree))
        if (entry.is_regular_file()) found.push_back(entry.path());
    for (const char* name : {"README.md", "CONTRIBUTING.md", "SECURITY.md", "CMakeLists.txt"})
      found.push_back(root / name);
    std::sort(found.begin(), found.end());
    static constexpr std::string_view kText[] = {".cpp",     ".hpp",  ".proto", ".js", ".css",  ".html",
                                                 ".cmake",   ".sh",   ".txt",   ".md", ".json", ".toml",
                                                 ".service", ".conf", ".py",    ""};
    std::vector<File> read;
    for (const fs::path& file : found) {
      const std::string path = fs::relative(file, root).generic_string();
      if (path.find("/corpus/") != std::string::npos || path.find("/data/") != std::string::npos ||
          path.find("three") != std::string::npos || path == "tests/architecture/words/words_test.cpp" ||
          std::none_of(std::begin(kText), std::end(kText), [&](auto end) { return file.extension().string() == end; }))
        continue;
      std::ifstream in{file, std::ios::binary};
      std::ostringstream all;
      all << in.rdbuf();
      if (all.str().find('\0') == std::string::npos) read.push_back({path, all.str()});
    }
    return read;
  }();
  return files;
}

TEST(Words, LooksAtTheWholeTree) { EXPECT_GT(all_files().size(), 900U) << "TELEFAB_SOURCE must name the repository"; }

TEST(Words, GivenUpDoNotComeBack) {
  for (const File& file : all_files()) {
    for_each_name(file.text, [&](std::string_view name, std::size_t at) {
      const std::string snake = in_snake_case(name);
      for (const Word& word : kNowhere)
        if (has_part(snake, word.old)) ADD_FAILURE() << file.place(at) << name << ": say " << word.instead;
    });
    for_each_name(file.path, [&](std::string_view name, std::size_t) {
      for (const Word& word : kNowhere)
        if (has_part(in_snake_case(name), word.old)) ADD_FAILURE() << file.path << ": say " << word.instead;
    });
  }
}

TEST(Words, OfConversationAreNoNames) {
  for (const File& file : all_files())
    if (file.is_code())
      for_each_name(blanked(file.text, false), [&](std::string_view name, std::size_t at) {
        const std::string snake = in_snake_case(name);
        for (const Word& word : kInNoName)
          if (file.path.starts_with(word.in) && has_part(snake, word.old) &&
              std::find(std::begin(kForeign), std::end(kForeign), name) == std::end(kForeign))
            ADD_FAILURE() << file.place(at) << name << ": say " << word.instead;
      });
}

TEST(Words, OfMessagesSayIsNotA) {
  for (const File& file : all_files())
    if (file.is_code()) {
      const std::string strings = blanked(file.text, true);
      for (std::size_t at = is_no_something(strings, 0); at != std::string::npos; at = is_no_something(strings, at + 1))
        ADD_FAILURE() << file.place(at) << "say \"is not a ...\"";
    }
}

// The rules themselves, on texts that must be refused.
TEST(Words, RefuseWhatTheyShouldRefuse) {
  EXPECT_EQ(in_snake_case("OfferTaken"), "offer_taken");
  EXPECT_EQ(in_snake_case("is_HTTPDesk_"), "is_http_desk_");
  EXPECT_TRUE(has_part(in_snake_case("SiteDesk"), "desk"));
  EXPECT_TRUE(has_part(in_snake_case("desk_"), "desk"));
  EXPECT_FALSE(has_part(in_snake_case("desktop"), "desk"));
  EXPECT_FALSE(has_part(in_snake_case("take_upload"), "take_up"));
  EXPECT_EQ(blanked("int told;  // told\n\"told\"", false), "int told;         \n      ");
  EXPECT_EQ(blanked("say(\"told\", 'x');", true), "    \"told\"       ");
  EXPECT_EQ(blanked("R\"(told)\" hear", false).find("told"), std::string::npos);
  EXPECT_EQ(is_no_something("7 is no number", 0), 2U);
  EXPECT_EQ(is_no_something("there is no number; it is no longer one; this no", 0), std::string_view::npos);
}

}  // namespace
