// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <stdlib.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/test/two_sites.hpp>

namespace telefab::test {
namespace {

using nlohmann::json;
using testing::HasSubstr;

/// `telefab` with a site book of its own.
class Sites : public TwoSites {
 protected:
  Sites() { ::setenv("TELEFAB_SITES", book().c_str(), 1); }
  ~Sites() override { ::unsetenv("TELEFAB_SITES"); }
  [[nodiscard]] std::filesystem::path book() const { return folder() / "config" / "sites.toml"; }
  [[nodiscard]] static Outcome ask(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), std::string{::getenv("TELEFAB_BIN")} + "/telefab");
    return run(arguments);
  }
};

TEST_F(Sites, AnEmptyBookSaysHowToAddASite) {
  const Outcome listed = ask({"sites"});
  EXPECT_EQ(listed.code, 0);
  EXPECT_THAT(listed.output, HasSubstr("telefab sites add"));
}

TEST_F(Sites, TheFirstSiteIsTheDefaultOfEveryVerb) {
  start_scan();
  ASSERT_EQ(ask({"sites", "add", "lab", "--address", scan_site()}).code, 0);
  EXPECT_EQ(ask({"jobs"}).code, 0);
  EXPECT_EQ(ask({"jobs", "--site", "lab"}).code, 0);
  EXPECT_EQ(ask({"sites", "check"}).code, 0);
}

TEST_F(Sites, CheckTellsWhichSiteDoesNotAnswer) {
  start_scan();
  ASSERT_EQ(ask({"sites", "add", "here", "--address", scan_site()}).code, 0);
  ASSERT_EQ(ask({"sites", "add", "gone", "--address", "127.0.0.1:1"}).code, 0);
  const Outcome checked = ask({"sites", "check"});
  EXPECT_EQ(checked.code, 3);
  EXPECT_THAT(checked.output, HasSubstr("answers at"));
  EXPECT_THAT(checked.output, HasSubstr("cannot reach 127.0.0.1:1"));
}

TEST_F(Sites, ABookIsChangedListedAndEmptied) {
  ASSERT_EQ(ask({"sites", "add", "a", "--address", "127.0.0.1:7000"}).code, 0);
  ASSERT_EQ(ask({"sites", "add", "b", "--address", "scan.example:7410", "--tls", "/certs"}).code, 0);
  ASSERT_EQ(ask({"sites", "default", "b"}).code, 0);
  const json listed = json::parse(ask({"sites", "--json"}).output);
  ASSERT_EQ(listed["sites"].size(), 2u);
  EXPECT_FALSE(listed["sites"][0]["default"]);
  EXPECT_TRUE(listed["sites"][1]["default"]);
  EXPECT_EQ(listed["sites"][1]["tls"], "/certs");
  ASSERT_EQ(ask({"sites", "remove", "b"}).code, 0);
  ASSERT_EQ(ask({"sites", "remove", "a"}).code, 0);
  EXPECT_THAT(ask({"sites"}).output, HasSubstr("no sites yet"));
}

TEST_F(Sites, RefusesWhatCouldNeverConnect) {
  EXPECT_EQ(ask({"sites", "add", "Bad Name", "--address", "127.0.0.1:7000"}).code, 2);
  EXPECT_EQ(ask({"sites", "add", "x", "--address", "nowhere"}).code, 1);
  const Outcome open = ask({"sites", "add", "x", "--address", "scan.example:7410"});
  EXPECT_EQ(open.code, 2);
  EXPECT_THAT(open.errors, HasSubstr("needs --tls FOLDER"));
  EXPECT_FALSE(std::filesystem::exists(book()));
}

TEST_F(Sites, ADamagedBookIsNamedWithLineAndKey) {
  std::filesystem::create_directories(book().parent_path());
  const auto error_of = [&](std::string_view text) {
    std::ofstream{book()} << text;
    const Outcome listed = ask({"sites"});
    EXPECT_EQ(listed.code, 2);
    return listed.errors;
  };
  EXPECT_THAT(error_of("default = \n"), HasSubstr("sites.toml: line 1"));
  EXPECT_THAT(error_of("[sites.a]\naddress = \"127.0.0.1:1\"\nport = 3\n"), HasSubstr("unknown key port"));
  EXPECT_THAT(error_of("[sites.a]\naddress = 7\n"), HasSubstr("address must be a string"));
  EXPECT_THAT(error_of("default = \"b\"\n"), HasSubstr("which is not a site of this file"));
}

TEST_F(Sites, AnUnknownNameSaysHowToKeepIt) {
  const Outcome jobs = ask({"jobs", "--site", "paris"});
  EXPECT_EQ(jobs.code, 2);
  EXPECT_THAT(jobs.errors, HasSubstr("telefab sites add paris"));
}

}  // namespace
}  // namespace telefab::test
