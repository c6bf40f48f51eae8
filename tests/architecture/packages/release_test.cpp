// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <telefab/test/scratch_folder.hpp>
#include <vector>

// What a release holds (decision 0915): the packages that deploy/release made, where it has; else what it makes them
// from.
namespace {

namespace fs = std::filesystem;
using Names = std::set<std::string>;

fs::path source() { return std::getenv("TELEFAB_SOURCE"); }

std::string text_of(const fs::path& path) {
  std::ifstream in{path};
  return {std::istreambuf_iterator<char>{in}, {}};
}

/// What a command of the shell prints; its exit code must be 0.
std::string output_of(const std::string& command) {
  std::string text;
  FILE* pipe = ::popen(command.c_str(), "r");
  EXPECT_NE(pipe, nullptr);
  std::array<char, 4096> part{};
  while (const std::size_t read = std::fread(part.data(), 1, part.size(), pipe)) text.append(part.data(), read);
  EXPECT_EQ(::pclose(pipe), 0) << command << "\n" << text;
  return text;
}

/// Lines of a command's output.
std::vector<std::string> lines_of(const std::string& command) {
  std::istringstream text{output_of(command)};
  std::vector<std::string> lines;
  for (std::string line; std::getline(text, line);) lines.push_back(line);
  return lines;
}

fs::path release() { return source() / "build/packages/release"; }

/// Names of the files of a folder of deploy/config, as they lie below `to`.
void add_profiles(Names& names, const std::string& to) {
  for (const char* kind : {"machines", "resins", "prints"})
    for (const auto& entry : fs::directory_iterator{source() / "deploy/config" / kind})
      names.insert(to + "/" + kind + "/" + entry.path().filename().string());
}

/// Every file that a package holds.
Names expected_files(const std::string& package) {
  Names names{"/usr/bin/" + package,
              "/usr/share/man/man1/" + package + ".1.gz",
              "/usr/share/bash-completion/completions/" + package,
              "/usr/share/zsh/vendor-completions/_" + package,
              "/usr/share/fish/vendor_completions.d/" + package + ".fish",
              "/usr/share/lintian/overrides/" + package};
  for (const char* file : {"copyright", "changelog.gz", "changelog.Debian.gz"})
    names.insert("/usr/share/doc/" + package + "/" + file);
  if (package == "telefab") {
    names.insert("/usr/share/doc/telefab/README.md");
    for (const auto& entry : fs::directory_iterator{source() / "deploy/docs"})
      names.insert("/usr/share/doc/telefab/" + entry.path().filename().string());
    for (const auto& entry : fs::directory_iterator{source() / "deploy/containers"})
      names.insert("/usr/share/doc/telefab/examples/containers/" + entry.path().filename().string());
    return names;
  }
  const std::string site = package.substr(std::string{"telefab-"}.size());
  names.insert("/usr/lib/systemd/system/" + package + ".service");
  names.insert("/usr/lib/sysusers.d/" + package + ".conf");
  names.insert("/usr/lib/tmpfiles.d/" + package + ".conf");
  names.insert("/etc/telefab/" + site + ".conf");
  names.insert("/usr/share/doc/" + package + "/examples/" + site + ".conf");
  if (site == "scan") {
    add_profiles(names, "/usr/share/telefab");
    return names;
  }
  add_profiles(names, "/etc/telefab");
  add_profiles(names, "/usr/share/doc/telefab-fab/examples");
  names.insert("/etc/telefab/fab-machines.toml");
  names.insert("/usr/share/doc/telefab-fab/examples/fab-machines.toml");
  names.insert("/usr/lib/udev/rules.d/70-telefab.rules");
  names.insert("/usr/share/telefab/avahi/telefab-fab.service");
  return names;
}

const std::vector<std::string> kPackages{"telefab", "telefab-scan", "telefab-fab"};

/// The one file of a package in the release.
fs::path deb_of(const std::string& package) {
  std::vector<fs::path> found;
  for (const auto& entry : fs::directory_iterator{release()})
    if (entry.path().filename().string().starts_with(package + "_") && entry.path().extension() == ".deb")
      found.push_back(entry.path());
  EXPECT_EQ(found.size(), 1U) << package;
  return found.empty() ? fs::path{} : found.front();
}

class Release : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(release() / "SHA256SUMS")) GTEST_SKIP() << "no release in build/packages; deploy/release makes it";
    const auto made = fs::last_write_time(release() / "SHA256SUMS");
    for (const auto& entry : fs::recursive_directory_iterator{source() / "deploy"})
      if (entry.is_regular_file() && entry.last_write_time() > made)
        GTEST_SKIP() << "the release is older than " << entry.path() << "; deploy/release makes a new one";
  }
};

TEST_F(Release, ItsPackagesHoldWhatEachSiteNeedsAndNothingElse) {
  for (const std::string& package : kPackages) {
    SCOPED_TRACE(package);
    Names held;
    const std::regex file{"^-\\S+ root/root +\\d+ \\S+ \\S+ \\.(/.*)$"};
    for (const std::string& line : lines_of("dpkg-deb --contents '" + deb_of(package).string() + "'"))
      if (std::smatch found; std::regex_match(line, found, file)) held.insert(found[1]);
    EXPECT_EQ(held, expected_files(package));
  }
}

TEST_F(Release, EveryFileBelowEtcIsASettingThatAnUpgradeKeeps) {
  for (const std::string package : {"telefab-scan", "telefab-fab"}) {
    SCOPED_TRACE(package);
    Names settings;
    for (const std::string& name : expected_files(package))
      if (name.starts_with("/etc/")) settings.insert(name);
    const auto kept = lines_of("dpkg-deb --info '" + deb_of(package).string() + "' conffiles");
    EXPECT_EQ(Names(kept.begin(), kept.end()), settings);
  }
}

TEST_F(Release, ItsIndexNamesEachPackageWithItsBytes) {
  const std::string index = text_of(release() / "Packages");
  for (const std::string& package : kPackages) {
    const fs::path deb = deb_of(package);
    EXPECT_NE(
        index.find("Filename: ./" + deb.filename().string() + "\nSize: " + std::to_string(fs::file_size(deb)) + "\n"),
        std::string::npos)
        << package;
    EXPECT_NE(index.find("\nSHA256: " + output_of("sha256sum <'" + deb.string() + "'").substr(0, 64) + "\n"),
              std::string::npos)
        << package;
  }
  const std::string top = text_of(release() / "Release");
  for (const char* name : {"Packages", "Packages.gz"})
    EXPECT_NE(top.find(" " + output_of("sha256sum <'" + (release() / name).string() + "'").substr(0, 64) + " " +
                       std::to_string(fs::file_size(release() / name)) + " " + name + "\n"),
              std::string::npos)
        << name;
}

TEST_F(Release, ItsSumsAreThoseOfEveryFile) {
  output_of("cd '" + release().string() + "' && sha256sum --check --quiet --strict SHA256SUMS");
  std::istringstream sums{text_of(release() / "SHA256SUMS")};
  Names summed;
  for (std::string line; std::getline(sums, line);) summed.insert(line.substr(66));
  Names there;
  for (const auto& entry : fs::recursive_directory_iterator{release()})
    if (entry.is_regular_file()) there.insert(entry.path().lexically_relative(release()).string());
  there.erase("SHA256SUMS");
  EXPECT_EQ(summed, there);
}

/// Scripts of a package with stand-ins for the tools of a running system, which note how they are called.
class MaintainerScripts : public testing::Test {
 protected:
  void SetUp() override {
    for (const char* folder : {"bin", "run", "jobs/j1"}) fs::create_directories(scratch_.path() / folder);
    tool("systemctl", "case \"$*\" in *MainPID*) echo " + std::to_string(::getpid()) + " ;; esac");
    for (const char* name : {"systemd-sysusers", "install", "deb-systemd-helper", "deb-systemd-invoke"}) tool(name, "");
  }

  void tool(const std::string& name, const std::string& does) {
    const fs::path path = scratch_.path() / "bin" / name;
    std::ofstream{path} << "#!/bin/sh\necho " << name << " \"$@\" >>'" << log().string() << "'\n" << does << "\n";
    fs::permissions(path, fs::perms::owner_all);
  }

  /// Runs a script of the fab's package; which tools it called is in called().
  /// \return what it prints; its exit code must be 0
  std::string run_script(const std::string& script, const std::string& arguments) {
    fs::remove(log());
    std::string text = text_of(source() / "deploy/debian" / (script + ".in"));
    const std::map<std::string, std::string> stands_for{{"@unit@", "telefab-fab.service"},
                                                        {"@name@", "telefab-fab"},
                                                        {"/run/systemd/system", (scratch_.path() / "run").string()}};
    for (const auto& [from, to] : stands_for)
      for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
        text.replace(at, from.size(), to);
    const fs::path path = scratch_.path() / script;
    std::ofstream{path} << text;
    return output_of("PATH='" + (scratch_.path() / "bin").string() + "':\"$PATH\" sh '" + path.string() + "' " +
                     arguments);
  }

  [[nodiscard]] bool called(const std::string& line) const {
    return ("\n" + text_of(log())).find("\n" + line + "\n") != std::string::npos;
  }

 private:
  [[nodiscard]] fs::path log() const { return scratch_.path() / "log"; }

 protected:
  telefab::test::ScratchFolder scratch_;
};

TEST_F(MaintainerScripts, AnUpgradeLeavesAPrintUnderWayToTheProgramThatRuns) {
  {
    const std::ofstream journal{scratch_.path() / "jobs/j1/journal"};  // the service's process is this one
    EXPECT_NE(run_script("postinst", "configure 0.1.0-1").find("a print is under way"), std::string::npos);
    EXPECT_FALSE(called("deb-systemd-invoke restart telefab-fab.service"));
  }
  EXPECT_EQ(run_script("postinst", "configure 0.1.0-1"), "");
  EXPECT_TRUE(called("deb-systemd-invoke restart telefab-fab.service"));
}

TEST_F(MaintainerScripts, AnInstalledServiceStartsUnlessTheAdministratorDisabledIt) {
  run_script("postinst", "configure");
  EXPECT_TRUE(called("deb-systemd-helper enable telefab-fab.service"));
  EXPECT_TRUE(called("deb-systemd-invoke start telefab-fab.service"));
  tool("deb-systemd-helper", "case \"$*\" in *was-enabled*) exit 1 ;; esac");
  run_script("postinst", "configure");
  EXPECT_FALSE(called("deb-systemd-helper enable telefab-fab.service"));
}

TEST_F(MaintainerScripts, RemovalStopsTheServiceAndAnUpgradeDoesNot) {
  run_script("prerm", "upgrade 0.2.0-1");
  EXPECT_FALSE(called("deb-systemd-invoke stop telefab-fab.service"));
  run_script("prerm", "remove");
  EXPECT_TRUE(called("deb-systemd-invoke stop telefab-fab.service"));
}

TEST_F(MaintainerScripts, APurgeForgetsTheServiceAndNoJob) {
  run_script("postrm", "remove");
  EXPECT_FALSE(called("deb-systemd-helper purge telefab-fab.service"));
  run_script("postrm", "purge");
  EXPECT_TRUE(called("deb-systemd-helper purge telefab-fab.service"));
  EXPECT_TRUE(fs::exists(scratch_.path() / "jobs/j1"));
  EXPECT_EQ(text_of(source() / "deploy/debian/postrm.in").find("rm "), std::string::npos);
}

/// The lines of compose.yaml that belong to a service or to the anchor all share, by its first line.
std::string block_of(const std::string& head) {
  std::istringstream lines{text_of(source() / "deploy/containers/compose.yaml")};
  std::string block;
  const std::size_t depth = head.find_first_not_of(' ');
  bool inside = false;
  for (std::string line; std::getline(lines, line);) {
    const std::size_t first = line.find_first_not_of(' ');
    if (first == std::string::npos || line[first] == '#') continue;
    if (inside && first <= depth) break;
    if (inside) block += line + "\n";
    inside = inside || line == head;
  }
  EXPECT_FALSE(block.empty()) << head;
  return block;
}

TEST(Containers, AreConfinedAndRunAsTheUserOfTheServices) {
  const std::string shared = block_of("x-site: &site");
  for (const char* line : {"user: telefab\n", "read_only: true\n", "cap_drop: [\"ALL\"]\n", "stop_signal: SIGTERM\n",
                           "security_opt: [\"no-new-privileges:true\"]\n", "ulimits: { core: 0 }\n"})
    EXPECT_NE(shared.find(line), std::string::npos) << line;
  EXPECT_NE(text_of(source() / "deploy/containers/Containerfile").find("\nUSER telefab\n"), std::string::npos);
  for (const std::string site : {"fab", "scan"})
    EXPECT_NE(block_of("  " + site + ":").find("<<: *site\n"), std::string::npos);
}

TEST(Containers, HaveAsLongToEndAnExposureAsTheServices) {
  for (const std::string site : {"fab", "scan"}) {
    std::smatch container;
    std::smatch service;
    const std::string block = block_of("  " + site + ":");
    const std::string unit = text_of(source() / ("deploy/systemd/telefab-" + site + ".service"));
    ASSERT_TRUE(std::regex_search(block, container, std::regex{"stop_grace_period: ([0-9]+)s\n"})) << site;
    ASSERT_TRUE(std::regex_search(unit, service, std::regex{"\nTimeoutStopSec=([0-9]+)\n"})) << site;
    EXPECT_EQ(container[1], service[1]) << site;
  }
}

TEST(Containers, GetNoScreenWhoseGuardWouldEndWithThem) {
  EXPECT_EQ(text_of(source() / "deploy/containers/compose.yaml").find("/dev/dri"), std::string::npos);
  EXPECT_EQ(text_of(source() / "deploy/containers/compose.yaml").find("/dev/fb"), std::string::npos);
}

TEST(Containers, AreDescribedInYamlWhereEveryNameIsKnown) {
  if (std::system("python3 -c 'import yaml' 2>/dev/null") != 0) GTEST_SKIP() << "no python3-yaml on this machine";
  output_of("cd '" + (source() / "deploy/containers").string() +
            "' && python3 -c 'import yaml\n"
            "c = yaml.safe_load(open(\"compose.yaml\"))\n"
            "for name, s in c[\"services\"].items():\n"
            "    assert s[\"read_only\"] and s[\"user\"] == \"telefab\", name\n"
            "    for needed in s.get(\"depends_on\", {}): assert needed in c[\"services\"], needed\n"
            "    for v in s[\"volumes\"]: assert v.split(\":\")[0] in c[\"volumes\"], v\n"
            "    assert name == \"certificates\" or s[\"healthcheck\"][\"test\"][1] == \"healthy\", name\n"
            "'");
}

TEST(Containers, CertificatesGiveEachSiteItsOwnAndNoneTheKeyOfTheAuthority) {
  const fs::path bin = std::getenv("TELEFAB_BIN");
  if (!fs::exists(bin / "telefab")) GTEST_SKIP() << "the client is not built";
  const telefab::test::ScratchFolder scratch;
  for (const char* name : {"fab-tls", "scan-tls"}) fs::create_directories(scratch.path() / name);
  const std::string command = "PATH='" + bin.string() + "':\"$PATH\" sh '" +
                              (source() / "deploy/containers/certificates").string() + "' '" + scratch.path().string() +
                              "'";
  output_of(command);
  const auto names = [&](const char* folder) {
    Names list;
    for (const auto& entry : fs::directory_iterator{scratch.path() / folder})
      list.insert(entry.path().filename().string());
    return list;
  };
  EXPECT_EQ(names("fab-tls"), (Names{"authority.crt", "revoked.crl", "fab.crt", "fab.key", "scan.sign.pub"}));
  EXPECT_EQ(names("scan-tls"), (Names{"authority.crt", "revoked.crl", "scan.crt", "scan.key", "scan.sign.key"}));
  const std::string first = text_of(scratch.path() / "fab-tls/fab.crt");
  output_of(command);
  EXPECT_EQ(text_of(scratch.path() / "fab-tls/fab.crt"), first) << "a second start makes no new certificates";
}

}  // namespace
