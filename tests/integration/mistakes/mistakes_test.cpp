// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <telefab/test/two_sites.hpp>

#include "mistake.hpp"

namespace telefab::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Not;

/// A ball of 5 units around the origin, with normals: x y z nx ny nz a line.
std::string ball(double radius) {
  constexpr int kPoints = 3000;
  std::string lines;
  for (int i = 0; i < kPoints; ++i) {
    const double z = 1 - (2.0 * i + 1) / kPoints, r = std::sqrt(1 - z * z), a = 2.399963229728653 * i;
    const double x = r * std::cos(a), y = r * std::sin(a);
    for (const double value : {radius * x, radius * y, radius * z, x, y, z}) lines += std::to_string(value) + ' ';
    lines.back() = '\n';
  }
  return lines;
}

std::string ply(const std::string& lines) {
  return "ply\nformat ascii 1.0\nelement vertex " + std::to_string(std::ranges::count(lines, '\n')) +
         "\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float "
         "nz\nend_header\n" +
         lines;
}

/// A folder with what people have at hand, two plain sites with a page and one with certificates. One for all tests:
/// whoever makes a mistake must not harm the others.
class Workplace final : public TwoSites {
 public:
  Workplace() {
    setenv("PATH", (bin() + ":" + ::getenv("PATH")).c_str(), 1);
    setenv("XDG_CONFIG_HOME", (folder() / "config").c_str(), 1);
    make_profiles();
    keep("ball.ply", ply(ball(5)));
    keep("metres.ply", ply(ball(0.005)));
    keep("Größe.xyz", ball(5));
    keep("short.ply", ply(ball(5)).substr(0, 50'000));
    keep("no-point.ply", ply(""));
    keep("empty.ply", "");
    keep("letter.txt", "Dear aunt,\nthis is a letter and not a scan.\n");
    keep("picture.png", "\x89PNG\r\n\x1a\n and so on");
    made("telefab-scan slice ball.ply --machine toy --height-mm 7 --out ball.tfc");
    made("telefab-fab plan ball.tfc --out plan");
    made("head -c 300 ball.tfc >short.tfc");
    made("telefab certs authority --dir certs && telefab certs issue scan-site scan-site --host 127.0.0.1 --dir certs");
    made("telefab certs issue operator operator --dir certs && telefab certs issue viewer read-only --dir certs");
    made("telefab certs issue expired operator --days -1 --dir certs");
    made("telefab certs issue revoked operator --dir certs && telefab certs revoke revoked --dir certs");
    made("telefab certs authority --dir other-certs && telefab certs issue operator operator --dir other-certs");
    // Believes in the site, and is not believed there.
    made("cp -r other-certs mixed-certs && cp certs/authority.crt certs/revoked.crl mixed-certs");
    start_sites();
  }

  void TestBody() override {}

  [[nodiscard]] Outcome run_in_folder(const std::string& command) const {
    return run({"/bin/sh", "-c", "cd '" + folder().string() + "' && " + command});
  }

 private:
  [[nodiscard]] static std::string bin() { return ::getenv("TELEFAB_BIN"); }
  void keep(const std::string& file, const std::string& text) const {
    std::ofstream{folder() / file, std::ios::binary} << text;
  }
  void made(const std::string& command) const {
    const Outcome outcome = run_in_folder(command);
    if (outcome.code != 0) throw std::runtime_error{command + ": " + outcome.errors};
  }
  /// What is looked for first of all, so that no command has to name it.
  void make_profiles() const {
    fs::create_directories(folder() / "config/telefab");
    fs::create_directory_symlink(folder() / "machines", folder() / "config/telefab/machines");
  }
  void start_sites() {
    start_fab();
    const std::string page = free_address();
    start_scan({"--web", page});
    setenv("PAGE", page.c_str(), 1);
    setenv("FAB_SITE", fab_site().c_str(), 1);
    setenv("SCAN_SITE", scan_site().c_str(), 1);
    const std::string free = free_address();
    setenv("FREE_PORT", free.substr(free.find(':') + 1).c_str(), 1);
    tls_site_ = std::make_unique<Process>(
        std::vector<std::string>{bin() + "/telefab-scan", "serve", "--listen", "127.0.0.1:0", "--fab", fab_site(),
                                 "--data", (folder() / "tls").string(), "--tls", (folder() / "certs").string(),
                                 "--machines", (folder() / "machines").string()});
    setenv("TLS_SITE", ("127.0.0.1:" + tls_site_->read_line()).c_str(), 1);
    const std::string job = submit_torus();
    setenv("JOB", job.c_str(), 1);
    made("telefab watch " + job + " --plain --site " + scan_site());
  }
  /// Nobody listens there: a site had it a moment ago.
  [[nodiscard]] std::string free_address() const {
    Process site{
        {bin() + "/telefab-fab", "serve", "--listen", "127.0.0.1:0", "--data", (folder() / "moment").string()}};
    return "127.0.0.1:" + site.read_line();
  }

  std::unique_ptr<Process> tls_site_;
};

/// Made at the first mistake, gone with the last one.
class WorkplaceOfAll : public testing::Environment {
 public:
  static Workplace& get() {
    if (!workplace()) workplace() = std::make_unique<Workplace>();
    return *workplace();
  }
  void TearDown() override { workplace().reset(); }

 private:
  static std::unique_ptr<Workplace>& workplace() {
    static std::unique_ptr<Workplace> only;
    return only;
  }
};
[[maybe_unused]] const auto* const kEnvironment = testing::AddGlobalTestEnvironment(new WorkplaceOfAll);

class Mistakes : public testing::TestWithParam<Mistake> {};

TEST_P(Mistakes, AreAnsweredWithWhatWhereAndWhatToDo) {
  const Mistake& mistake = GetParam();
  const Outcome outcome = WorkplaceOfAll::get().run_in_folder(std::string{mistake.command});
  const std::string printed = outcome.output + outcome.errors;
  EXPECT_EQ(outcome.code, mistake.code) << printed;
  for (const std::string_view word : mistake.words) EXPECT_THAT(printed, HasSubstr(std::string{word}));
  for (const std::string_view word : mistake.not_words) {
    if (word.empty()) continue;
    EXPECT_THAT(printed, Not(HasSubstr(std::string{word})));
  }
  // Whoever watches is told each state that is seen besides; how many are seen is a matter of time.
  const int states = mistake.command.find("--watch") == std::string_view::npos ? 0 : 4;
  EXPECT_LT(std::ranges::count(outcome.errors, '\n'), 4 + states) << "an answer, not a flood: " << outcome.errors;
}

std::string name_of(const testing::TestParamInfo<Mistake>& info) { return std::string{info.param.name}; }

INSTANTIATE_TEST_SUITE_P(CommandLine, Mistakes,
                         testing::ValuesIn(command_line_mistakes().begin(), command_line_mistakes().end()), name_of);
INSTANTIATE_TEST_SUITE_P(Files, Mistakes, testing::ValuesIn(file_mistakes().begin(), file_mistakes().end()), name_of);
INSTANTIATE_TEST_SUITE_P(Sites, Mistakes, testing::ValuesIn(site_mistakes().begin(), site_mistakes().end()), name_of);

}  // namespace
}  // namespace telefab::test
