// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

// A library that is installed and found, but linked by nothing, costs every build minutes and says that it is used.
namespace {

namespace fs = std::filesystem;
using Names = std::set<std::string>;

/// How a library gets from the Debian package into a program.
struct Library {
  std::string package;  ///< in deploy/packages-build.txt
  std::string found;    ///< by find_package, pkg_check_modules or find_library under this name; empty: by its header
  std::string used;     ///< the target that somebody links; of a header: what somebody includes
};
const std::vector<Library> kLibraries{
    {"libexpected-dev", "", "tl/expected.hpp"},
    {"libfmt-dev", "fmt", "fmt::fmt"},
    {"nlohmann-json3-dev", "nlohmann_json", "nlohmann_json::nlohmann_json"},
    {"libtomlplusplus-dev", "tomlplusplus", "PkgConfig::tomlplusplus"},
    {"libssl-dev", "OpenSSL", "OpenSSL::Crypto"},
    {"libeigen3-dev", "Eigen3", "Eigen3::Eigen"},
    {"libprotobuf-dev", "Protobuf", "protobuf::libprotobuf-lite"},
    {"protobuf-compiler", "Protobuf", "protobuf::protoc"},
    {"libboost-dev", "Boost", "Boost::headers"},
    {"libsqlite3-dev", "SQLite3", "SQLite::SQLite3"},
    {"libpqxx-dev", "libpqxx", "PkgConfig::libpqxx"},
    {"libpq-dev", "libpq", "PkgConfig::libpq"},
    {"libcli11-dev", "CLI11", "CLI11::CLI11"},
    {"libspdlog-dev", "spdlog", "spdlog::spdlog"},
    {"libcurl4-openssl-dev", "libcurl", "PkgConfig::libcurl"},
    {"libsystemd-dev", "libsystemd", "PkgConfig::libsystemd"},
    {"prometheus-cpp-dev", "prometheus-cpp", "prometheus-cpp::core"},
    {"libtbb-dev", "TBB", "TBB::tbb"},
    {"libxsimd-dev", "xsimd", "xsimd"},
    {"libpolyclipping-dev", "polyclipping", "PkgConfig::polyclipping"},
    {"libcgal-dev", "CGAL", "CGAL::CGAL"},
    {"libopencv-core-dev", "opencv_core", "telefab_opencv"},
    {"libopencv-imgproc-dev", "opencv_imgproc", "telefab_opencv"},
    {"libspng-dev", "spng", "PkgConfig::spng"},
    {"libdeflate-dev", "libdeflate", "PkgConfig::libdeflate"},
    {"libpng-dev", "PNG", "PNG::PNG"},
    {"libzip-dev", "libzip", "PkgConfig::libzip"},
    {"zlib1g-dev", "ZLIB", "ZLIB::ZLIB"},
    {"lib3mf-dev", "lib3mf", "PkgConfig::lib3mf"},
    {"libpugixml-dev", "pugixml", "PkgConfig::pugixml"},
    {"libusb-1.0-0-dev", "libusb", "PkgConfig::libusb"},
    {"libudev-dev", "libudev", "PkgConfig::libudev"},
    {"libdrm-dev", "libdrm", "PkgConfig::libdrm"},
    {"libgtest-dev", "GTest", "GTest::gtest_main"},
    {"libgmock-dev", "GTest", "GTest::gmock"},
    {"libbenchmark-dev", "benchmark", "benchmark::benchmark_main"},
    {"libpcl-dev", "pcl_features", "telefab_pcl_features"},
    {"libnanoflann-dev", "nanoflann", "nanoflann::nanoflann"},
    {"libumockdev-dev", "umockdev", "PkgConfig::umockdev"},
};
/// Packages of programs, fonts and pages, which nothing links.
const Names kPrograms{"build-essential",
                      "cmake",
                      "ninja-build",
                      "ccache",
                      "pkg-config",
                      "git",
                      "curl",
                      "openssl",
                      "umockdev",
                      "clang",
                      "libclang-rt-14-dev",
                      "clang-format",
                      "clang-tidy",
                      "chromium",
                      "chromium-driver",
                      "fonts-dejavu-core",
                      "libjs-three"};
/// Found, and part of the compiler's own system.
const Names kOfTheSystem{"Threads", "PkgConfig"};
/// Used where they happen to be installed, to be compared with.
const Names kOptional{"agg", "pcl_surface", "pcl_search", "pcl_kdtree", "pcl_octree", "pcl_common"};

fs::path source() { return std::getenv("TELEFAB_SOURCE"); }

std::string text_of(const fs::path& path) {
  std::ifstream in{path};
  return {std::istreambuf_iterator<char>{in}, {}};
}

/// All that lies below a folder and ends so, without comments of CMake.
std::string all_text(const std::vector<std::string>& folders, const std::vector<std::string>& ends) {
  std::string all = text_of(source() / "CMakeLists.txt") + "\n";
  for (const std::string& folder : folders)
    for (const auto& entry : fs::recursive_directory_iterator{source() / folder}) {
      const std::string name = entry.path().filename().string();
      if (!entry.is_regular_file() ||
          std::none_of(ends.begin(), ends.end(), [&](const auto& end) { return name.ends_with(end); }))
        continue;
      all += text_of(entry.path()) + "\n";
    }
  return std::regex_replace(all, std::regex{"(^|\n)\\s*#[^i][^\n]*"}, "$1");
}

const std::string& build_text() {
  static const std::string text = all_text({"common", "scan_site", "fab_site", "tests"}, {"CMakeLists.txt", ".cmake"});
  return text;
}

Names packages() {
  Names names;
  std::istringstream lines{text_of(source() / "deploy/packages-build.txt")};
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words{line.substr(0, line.find('#'))};
    for (std::string word; words >> word;) names.insert(word);
  }
  return names;
}

/// What CMake looks for.
Names found() {
  Names names;
  static const std::regex call{R"((?:find_package|pkg_check_modules)\((\S+)[ )]|find_library\(\S+ (\S+)[ )])"};
  const std::string& text = build_text();
  for (std::sregex_iterator it{text.begin(), text.end(), call}, end; it != end; ++it)
    names.insert((*it)[1].matched ? (*it)[1].str() : (*it)[2].str());
  return names;
}

TEST(Packages, EveryPackageThatIsInstalledHasItsUse) {
  for (const std::string& package : packages()) {
    const bool is_library = std::any_of(kLibraries.begin(), kLibraries.end(),
                                        [&](const Library& library) { return library.package == package; });
    EXPECT_TRUE(is_library || kPrograms.contains(package)) << package << ": say in the table what it is for";
  }
  for (const Library& library : kLibraries)
    EXPECT_TRUE(packages().contains(library.package)) << library.package << " is not in deploy/packages-build.txt";
}

TEST(Packages, EverythingThatIsFoundIsLinked) {
  for (const std::string& name : found()) {
    if (kOfTheSystem.contains(name) || kOptional.contains(name)) continue;
    EXPECT_TRUE(std::any_of(kLibraries.begin(), kLibraries.end(), [&](const Library& l) { return l.found == name; }))
        << name << " is found and belongs to no package of the table";
  }
}

TEST(Packages, EveryLibraryIsFoundAndUsedBySomebody) {
  const std::string code = all_text({"common", "scan_site", "fab_site"}, {".cpp", ".hpp"});
  for (const Library& library : kLibraries) {
    if (library.found.empty()) {
      EXPECT_NE(code.find("#include <" + library.used + ">"), std::string::npos)
          << library.package << ": nobody includes it";
      continue;
    }
    EXPECT_TRUE(found().contains(library.found)) << library.package << " is found by nobody";
    // A target counts as used where it stands among what somebody links, not where it is made.
    std::string quoted;
    for (const char c : library.used) quoted += std::string{c == '.' || c == '+' ? "\\" : ""} + c;
    const std::regex link{"(?:HIDES|USES|PUBLIC|PRIVATE|COMMAND)[^()]*[\\s]" + quoted + "[\\s)]"};
    EXPECT_TRUE(std::regex_search(build_text(), link)) << library.package << ": nobody links " << library.used;
  }
}

/// The values of a key of a unit, in order.
std::vector<std::string> values_of(const std::string& unit, const std::string& key) {
  std::vector<std::string> values;
  std::istringstream lines{unit};
  for (std::string line; std::getline(lines, line);)
    if (line.starts_with(key + "=")) values.push_back(line.substr(key.size() + 1));
  return values;
}

// 4.6 before; 1.8 and 1.3 when this was written.
TEST(Services, AreExposedByTwoOfTenAtMostAsSystemdCountsIt) {
  if (std::system("command -v systemd-analyze >/dev/null") != 0) GTEST_SKIP() << "no systemd-analyze on this machine";
  for (const std::string site : {"fab", "scan"}) {
    const std::string ask = "systemd-analyze security --offline=true --no-pager --threshold=20 '" +
                            (source() / ("deploy/systemd/telefab-" + site + ".service")).string() + "'";
    EXPECT_EQ(std::system((ask + " >/dev/null").c_str()), 0) << ask;
  }
}

TEST(Services, SeeAndMayDoOnlyWhatTheyNeed) {
  for (const std::string site : {"fab", "scan"}) {
    SCOPED_TRACE(site);
    const std::string unit = text_of(source() / ("deploy/systemd/telefab-" + site + ".service"));
    for (const auto& [key, value] :
         std::vector<std::pair<std::string, std::string>>{{"User", "telefab"},
                                                          {"UMask", "0077"},
                                                          {"LimitCORE", "0"},
                                                          {"MemoryMax", "75%"},
                                                          {"CapabilityBoundingSet", ""},
                                                          {"AmbientCapabilities", ""},
                                                          {"NoNewPrivileges", "yes"},
                                                          {"ProtectSystem", "strict"},
                                                          {"ProtectHome", "yes"},
                                                          {"ProtectProc", "invisible"},
                                                          {"ProtectClock", "yes"},
                                                          {"ProtectHostname", "yes"},
                                                          {"ProtectKernelLogs", "yes"},
                                                          {"RestrictNamespaces", "yes"},
                                                          {"KeyringMode", "private"},
                                                          {"SystemCallArchitectures", "native"},
                                                          {"SystemCallErrorNumber", "EPERM"}})
      EXPECT_EQ(values_of(unit, key), std::vector<std::string>{value}) << key;
    const auto filters = values_of(unit, "SystemCallFilter");
    ASSERT_GE(filters.size(), 2U);
    EXPECT_EQ(filters[0], "@system-service");
    EXPECT_EQ(filters[1], "~@privileged @resources");
  }
  const std::string scan = text_of(source() / "deploy/systemd/telefab-scan.service");
  EXPECT_EQ(values_of(scan, "PrivateDevices"), std::vector<std::string>{"yes"});
  const std::string fab = text_of(source() / "deploy/systemd/telefab-fab.service");
  EXPECT_EQ(values_of(fab, "DevicePolicy"), std::vector<std::string>{"closed"});
  const std::vector<std::string> devices{"char-usb_device rw", "char-ttyACM rw", "char-ttyUSB rw",
                                         "char-drm rw",        "char-fb rw",     "/dev/tty0 rw"};
  EXPECT_EQ(values_of(fab, "DeviceAllow"), devices);
}

}  // namespace
