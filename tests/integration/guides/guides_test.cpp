// SPDX-License-Identifier: GPL-3.0-or-later
#include <arpa/inet.h>
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <regex>
#include <sstream>
#include <telefab/test/loopback.hpp>
#include <telefab/test/process.hpp>
#include <telefab/test/scratch_folder.hpp>

#include "guide.hpp"

// What the pages for newcomers say is what the programs do: those that the packages install, beside their pages.

namespace telefab::test {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& file) {
  std::ostringstream text;
  text << std::ifstream{file}.rdbuf();
  return text.str();
}

fs::path installed() { return std::getenv("TELEFAB_INSTALLED"); }
fs::path docs() { return installed() / "share" / "doc" / "telefab"; }

/// A port that nobody listens on now.
std::uint16_t free_port() {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = loopback(0);
  socklen_t size = sizeof address;
  EXPECT_EQ(::bind(fd, reinterpret_cast<const sockaddr*>(&address), size), 0);
  EXPECT_EQ(::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size), 0);
  ::close(fd);
  return ntohs(address.sin_port);
}

class Guides : public testing::Test {
 protected:
  /// Runs the commands of a page in an empty folder that holds a scan, behind those of `before`.
  void walk(const std::string& page, const std::string& before = {}) {
    const std::string text = text_of(docs() / "getting-started" / page);
    ASSERT_FALSE(text.empty()) << page;
    walk_text(text, before);
  }
  void walk_text(std::string text, const std::string& before) {
    write_figure(folder() / "figure.ply");
    for (const char* usual : {"7410", "7420", "7470", "7480"})
      text = std::regex_replace(text, std::regex{fmt::format("127.0.0.1:{}", usual)},
                                fmt::format("127.0.0.1:{}", free_port()));
    // As small as it may be: masks of 8K panels take their time.
    text = std::regex_replace(text, std::regex{"--height-mm [0-9]+"}, "--height-mm 4");
    const fs::path script = folder() / "walk.sh";
    std::ofstream{script} << fmt::format(
        "cd {0}\nexport HOME={0}/home PATH={1}:$PATH\nmkdir -p home\nunset TELEFAB_SITE TELEFAB_TLS\n{2}\n{3}",
        folder().string(), (installed() / "bin").string(), before, script_of(text));
    const Outcome walked = run({"/bin/bash", script.string()});
    EXPECT_EQ(walked.code, 0) << walked.output << walked.errors;
    output_ = walked.output;
  }
  [[nodiscard]] const fs::path& folder() const { return folder_.path(); }
  [[nodiscard]] const std::string& output() const { return output_; }
  void is_there(const std::string& file, std::uintmax_t least_bytes) const {
    std::error_code error;
    EXPECT_GE(fs::file_size(folder() / file, error), least_bytes) << file << ": " << error.message();
  }

 private:
  ScratchFolder folder_;
  std::string output_;
};

TEST_F(Guides, BeginWithADemoThatEndsWithAPrintedPart) {
  write_figure(folder() / "figure.ply");
  const Outcome demo =
      run({fs::path{std::getenv("TELEFAB_SOURCE")} / "deploy" / "demo", "--skip-setup", "--programs",
           installed() / "bin", "--cloud", folder() / "figure.ply", "--height-mm", "4", "--out", folder() / "out"});
  EXPECT_EQ(demo.code, 0) << demo.output << demo.errors;
  EXPECT_THAT(demo.output, testing::HasSubstr("deploy/demo: done in"));
  for (const char* file : {"out/view.png", "out/preview.png", "out/report.json", "out/as-built.json"})
    is_there(file, 1000);
}

TEST_F(Guides, OfTheReadmeLeadFromAScanToAPrintFileByHand) {
  const std::string readme = text_of(docs() / "README.md");
  const auto begin = readme.find("By hand, without daemons:"), end = readme.find("As two sites");
  ASSERT_LT(begin, end);
  // A part from elsewhere: contours of this one, as another program would write them.
  const std::string import = "    telefab-fab import part.cli";
  std::string text = readme.substr(begin, end - begin);
  ASSERT_NE(text.find(import), std::string::npos);
  text.insert(text.find(import), "    telefab-fab export statue-plan --format cli --out part.cli\n");
  walk_text(text, "telefab-scan clean figure.ply --units m --out statue.ply");
  for (const char* file : {"ways.png", "statue.png", "statue-plan/plan.json", "cured.png"}) is_there(file, 1000);
  is_there("statue.goo", 10000);
  is_there("part.tfc", 500);
}

TEST_F(Guides, LeadFromAScanToAPrintFile) {
  walk("scan-to-file.md");
  for (const char* file : {"look.png", "ways.png", "figure.png", "figure-plan/view.png", "cured.png"})
    is_there(file, 5000);
  is_there("figure.goo", 20000);
}

TEST_F(Guides, LeadToFilesOfThreeKindsOfPrinters) {
  walk("your-printer.md",
       "telefab-scan slice figure.ply --units m --machine elegoo-mars-4-dlp --height-mm 4 --out figure.tfc");
  for (const char* file : {"figure.goo", "figure.sl1", "figure.nanodlp", "cover.goo"}) is_there(file, 10000);
  is_there("read-back/plan.json", 1000);
}

TEST_F(Guides, LeadToTwoSitesThatKnowEachOther) {
  walk("two-sites.md");
  EXPECT_THAT(output(), testing::HasSubstr("figure.ply"));
}

TEST_F(Guides, LeadToFiguresOfAResin) {
  walk("your-resin.md");
  for (const char* file : {"fitted.toml", "size.toml", "supports.toml"}) is_there(file, 50);
}

TEST(GuideScript, LeavesOutWhatAnAdministratorDoesAndKeepsTheRest) {
  const std::string script = script_of(
      "# Page\n\nText.\n\n    first\n\n<!-- not run: why -->\n\n    sudo second\n    sudo third\n\nMore.\n\n    fourth "
      "&\n");
  EXPECT_THAT(script, testing::HasSubstr("\nfirst\n"));
  EXPECT_THAT(script, testing::Not(testing::HasSubstr("second")));
  EXPECT_THAT(script, testing::Not(testing::HasSubstr("third")));
  EXPECT_THAT(script, testing::HasSubstr("\nfourth &\n"));
}

/// All sources of the programs, with strings that are split over lines joined.
std::string sources() {
  std::string all;
  for (const char* tree : {"common", "scan_site", "fab_site"})
    for (const auto& entry : fs::recursive_directory_iterator{fs::path{std::getenv("TELEFAB_SOURCE")} / tree})
      if (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp") all += text_of(entry.path());
  std::string joined;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const auto next = all[i] == '"' ? all.find_first_not_of(" \n", i + 1) : std::string::npos;
    if (next != std::string::npos && all[next] == '"' && all.find('\n', i) < next)
      i = next;
    else
      joined += all[i];
  }
  return joined;
}

TEST(Troubleshooting, KnowsMessagesAsTheProgramsHaveThem) {
  const std::string code = sources();
  std::istringstream lines{text_of(docs() / "troubleshooting.md")};
  const std::regex message{R"(^\| `([^`]+)` \|)"};
  int found = 0;
  for (std::string line; std::getline(lines, line);) {
    std::smatch match;
    if (!std::regex_search(line, match, message)) continue;
    ++found;
    // Names and numbers stand between the parts that are always the same.
    std::string rest = match[1];
    while (!rest.empty()) {
      const auto gap = rest.find("…");
      const std::string part = rest.substr(0, gap);
      rest = gap == std::string::npos ? "" : rest.substr(gap + std::string_view{"…"}.size());
      const auto begin = part.find_first_not_of(' '), end = part.find_last_not_of(' ');
      if (begin == std::string::npos || end - begin <= 3) continue;
      EXPECT_NE(code.find(part.substr(begin, end - begin + 1)), std::string::npos) << part;
    }
  }
  EXPECT_GE(found, 25);
}

}  // namespace
}  // namespace telefab::test
