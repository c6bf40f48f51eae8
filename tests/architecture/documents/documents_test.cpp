// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

// Lists that people keep by hand, held against the tree: licences, notices, the index of decisions, thread tables.
namespace {

namespace fs = std::filesystem;
using Strings = std::vector<std::string>;

fs::path root() {
  const char* source = std::getenv("TELEFAB_SOURCE");
  return source ? fs::path{source} : fs::path{};
}

std::string text_of(const fs::path& file) {
  std::ifstream in{file, std::ios::binary};
  std::ostringstream all;
  all << in.rdbuf();
  return all.str();
}

/// Every file of the repository's trees that is not a build's, a corpus' or hidden.
const std::vector<fs::path>& all_files() {
  static const std::vector<fs::path> files = [] {
    std::vector<fs::path> found;
    for (const char* tree : {"common", "scan_site", "fab_site", "tests", "proto", "deploy"})
      for (const auto& entry : fs::recursive_directory_iterator(root() / tree)) {
        const std::string path = entry.path().generic_string();
        if (entry.is_regular_file() && path.find("/corpus/") == std::string::npos) found.push_back(entry.path());
      }
    found.push_back(root() / "CMakeLists.txt");
    std::sort(found.begin(), found.end());
    return found;
  }();
  return files;
}

bool is_source(const fs::path& file, const std::string& text) {
  static const Strings kEndings{".cpp", ".hpp", ".proto", ".js", ".css", ".html", ".cmake", ".sh"};
  return std::find(kEndings.begin(), kEndings.end(), file.extension().string()) != kEndings.end() ||
         file.filename() == "CMakeLists.txt" || text.starts_with("#!");
}

TEST(Licences, EverySourceNamesTheLicenceInItsFirstTwoLines) {
  std::size_t sources = 0;
  for (const fs::path& file : all_files()) {
    const std::string text = text_of(file);
    if (!is_source(file, text)) continue;
    ++sources;
    const std::size_t second = text.find('\n', text.find('\n') + 1);
    EXPECT_NE(text.substr(0, second).find("SPDX-License-Identifier: GPL-3.0-or-later"), std::string::npos)
        << fs::relative(file, root()) << " lacks the SPDX line";
  }
  EXPECT_GT(sources, 800U) << "TELEFAB_SOURCE must name the repository";
}

TEST(Licences, TheNoticesNameEveryLibraryThatIsInstalledToBuild) {
  const std::string notices = text_of(root() / "THIRD_PARTY.md");
  std::istringstream packages{text_of(root() / "deploy" / "packages-build.txt")};
  std::size_t libraries = 0;
  for (std::string line; std::getline(packages, line);) {
    const std::string package = line.substr(0, line.find_first_of(" #"));
    // libclang-rt-14-dev belongs to the compiler; libpng-dev is measured against, in a bench, and linked by nothing
    // else
    if (!package.ends_with("-dev") || package.starts_with("libclang") || package == "libpng-dev") continue;
    ++libraries;
    EXPECT_NE(notices.find(package), std::string::npos) << package << " is in no row of THIRD_PARTY.md";
  }
  EXPECT_GT(libraries, 20U);
}

/// Number to file names of the notes in `folder`.
std::multimap<std::string, std::string> notes_of(const char* folder) {
  static const std::regex pattern{R"((\d{4})-.*\.md)"};
  std::multimap<std::string, std::string> notes;
  std::smatch parts;
  for (const auto& entry : fs::directory_iterator(root() / "common" / folder)) {
    const std::string name = entry.path().filename().string();
    if (std::regex_match(name, parts, pattern)) notes.emplace(parts[1].str(), name);
  }
  return notes;
}

TEST(Decisions, ANumberIsGivenOnceAndEveryNoteIsInTheIndex) {
  auto notes = notes_of("decisions");
  EXPECT_GT(notes.size(), 30U);
  const std::string index = text_of(root() / "common" / "decisions" / "README.md");
  const std::string measurements = text_of(root() / "common" / "measurements" / "README.md");
  for (const auto& [number, name] : notes_of("measurements")) {
    EXPECT_NE(measurements.find(name), std::string::npos) << name << " is not in measurements/README.md";
    notes.emplace(number, name);
  }
  for (const auto& [number, name] : notes) {
    EXPECT_EQ(notes.count(number), 1U) << number << " names two notes";
    EXPECT_NE(index.find(name), std::string::npos) << name << " is not in decisions/README.md";
  }
}

TEST(Decisions, ANoteBeginsWithItsNumber) {
  for (const char* folder : {"decisions", "measurements"})
    for (const auto& [number, name] : notes_of(folder))
      EXPECT_TRUE(text_of(root() / "common" / folder / name).starts_with("# " + number + " ")) << name;
}

TEST(Threads, TheTableOfEachSiteNamesEveryThreadThatIsNamedInItsCode) {
  static const std::regex pattern{
      R"re((?:set_thread_name\(|pthread_setname_np\(pthread_self\(\), |\b\w+_\{)"([a-z]+)"(?:\)|, \[this\]\(const std::string& job, std::stop_token))re"};
  for (const char* site : {"scan_site", "fab_site"}) {
    std::string code;
    for (const fs::path& file : all_files()) {
      const std::string path = fs::relative(file, root()).generic_string();
      if (file.extension() == ".cpp" && (path.starts_with("common/") || path.starts_with(site))) code += text_of(file);
    }
    const std::string readme = text_of(root() / site / "README.md");
    std::size_t threads = 0;
    for (std::sregex_iterator at{code.begin(), code.end(), pattern}, end; at != end; ++at, ++threads)
      EXPECT_NE(readme.find("| " + (*at)[1].str() + " |"), std::string::npos)
          << site << "/README.md has no row for the thread " << (*at)[1].str();
    EXPECT_GT(threads, 3U);
  }
}

}  // namespace
