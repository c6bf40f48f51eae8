// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

// "Who may see whom", as tables over every source line. A row is a rule; change a rule here, with its reason.
namespace {

namespace fs = std::filesystem;
using Strings = std::vector<std::string>;

/// The order of the tree is the order of dependence: a module may include those above it in its own site, and all of
/// common may be included by both sites.
const std::array<Strings, 3> kOrder{
    Strings{"common/base", "common/geometry", "common/machine", "common/image", "common/codec", "common/job",
            "common/command_line", "common/store", "common/transfer", "common/wire", "common/net", "common/web",
            "common/service", "common/client"},
    Strings{"scan_site/cloud", "scan_site/formats", "scan_site/digitize", "scan_site/registration", "scan_site/mls",
            "scan_site/completion", "scan_site/topology", "scan_site/contour", "scan_site/measure", "scan_site/slicing",
            "scan_site/inspect", "scan_site/web", "scan_site/daemon"},
    Strings{"fab_site/region", "fab_site/support", "fab_site/mask", "fab_site/verify", "fab_site/cure",
            "fab_site/device", "fab_site/print", "fab_site/planning", "fab_site/formats", "fab_site/usb",
            "fab_site/drivers", "fab_site/spool", "fab_site/web", "fab_site/daemon"}};

/// Nothing depends on these.
const Strings kLeaves{"common/client", "scan_site/daemon", "fab_site/daemon"};

/// What may see sockets, jobs on disk, the wire, the program frame: the daemons and the outer half of common. What a
/// job is and what may be asked of it are values that anybody may see.
const Strings kOuter{"common/command_line", "common/store", "common/transfer", "common/wire",
                     "common/net",          "common/web",   "common/service"};
const Strings kMayUseOuter{"common/command_line", "common/store",     "common/transfer", "common/wire",
                           "common/net",          "common/web",       "common/service",  "common/client",
                           "scan_site/web",       "scan_site/daemon", "fab_site/daemon", "fab_site/spool",
                           "fab_site/web"};

struct Heavy {
  std::string prefix;  ///< of the include path
  Strings folders;     ///< whose .cpp and private headers may have it
};
const std::vector<Heavy> kHeavy{
    {"pcl/", {"scan_site/cloud", "scan_site/registration", "scan_site/measure"}},
    {"CGAL/", {"fab_site/support"}},
    {"polyclipping/", {"fab_site/region"}},
    {"opencv2/", {"common/image", "fab_site/mask", "fab_site/cure"}},
    {"libusb", {"fab_site/usb"}},
    {"google/protobuf", {"common/wire"}},
    {"telefab/v1/", {"common/wire"}},
    {"sqlite3.h", {"common/store"}},
    {"zip.h", {"fab_site/formats"}},
    {"boost/asio", {"common/net", "common/client", "common/web", "scan_site/daemon", "fab_site/daemon"}},
    {"boost/beast", {"common/web"}},
    {"openssl/", {"common/base", "common/net", "common/web"}},
    {"xsimd/", {"scan_site/mls"}},
    // desk: the options that both serve verbs share.
    {"CLI/", {"common/command_line", "common/service", "common/client", "scan_site/daemon", "fab_site/daemon"}},
};

/// Libraries that no public header mentions, whoever uses them.
const Strings kNeverPublic{"tbb/", "fmt/", "nlohmann/", "spdlog/", "toml++/", "spng", "libdeflate", "zlib.h", "boost/"};

/// The only places that ask the machine what time it is, or sleep.
const Strings kMayReadClocks{"common/base/src/clock.cpp", "common/net/src/", "scan_site/daemon/", "fab_site/daemon/"};

bool starts_with_any(const std::string& text, const Strings& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(), [&](const auto& p) { return text.starts_with(p); });
}
bool holds(const Strings& list, const std::string& item) {
  return std::find(list.begin(), list.end(), item) != list.end();
}

/// "scan_site/mls" of "scan_site/mls/src/x.cpp".
std::string module_of(const std::string& path) {
  const auto second = path.find('/', path.find('/') + 1);
  return path.substr(0, second);
}

/// The module whose public header `include` names, e.g. scan_site/mls for telefab/scan/mls/mls_field.hpp.
std::optional<std::string> included_module(const std::string& include) {
  static const std::regex pattern{"telefab/(?:(scan|fab)/)?([a-z0-9_]+)/.*"};
  std::smatch parts;
  if (!std::regex_match(include, parts, pattern)) return std::nullopt;
  const std::string site = parts[1].matched ? parts[1].str() + "_site" : "common";
  return site + "/" + parts[2].str();
}

std::optional<std::pair<std::size_t, std::size_t>> rank_of(const std::string& module) {
  for (std::size_t site = 0; site < kOrder.size(); ++site) {
    const auto at = std::find(kOrder[site].begin(), kOrder[site].end(), module);
    if (at != kOrder[site].end()) return std::pair{site, static_cast<std::size_t>(at - kOrder[site].begin())};
  }
  return std::nullopt;
}

/// What is wrong with `module` (in `path`) including `include`; empty if nothing.
std::string complaint(const std::string& path, const std::string& include) {
  const std::string module = module_of(path);
  const bool is_public = path.find("/include/telefab/") != std::string::npos;
  for (const Heavy& heavy : kHeavy)
    if (include.starts_with(heavy.prefix)) {
      if (!holds(heavy.folders, module)) return include + " is the private matter of " + heavy.folders.front();
      if (is_public) return include + " must not appear in a public header";
    }
  if (is_public && starts_with_any(include, kNeverPublic)) return include + " must not appear in a public header";

  const auto target = included_module(include);
  if (!target || *target == module || include.starts_with("telefab/v1/")) return "";
  const auto own = rank_of(module);
  const auto other = rank_of(*target);
  if (!other) return *target + " is in no order of dependence; name it in kOrder";
  if (holds(kLeaves, *target)) return "nothing may depend on " + *target;
  if (other->first != 0 && other->first != own->first) return "the sites and common never see " + *target;
  if (other->first == own->first && other->second > own->second) return "points back up to " + *target;
  if (holds(kOuter, *target) && !holds(kMayUseOuter, module)) return "a domain module must not see " + *target;
  return "";
}

struct Line {
  std::string path;
  std::size_t number;
  std::string text;
};

/// Every line of every source of the three product trees.
const std::vector<Line>& all_lines() {
  static const std::vector<Line> lines = [] {
    const char* root = std::getenv("TELEFAB_SOURCE");
    std::vector<Line> found;
    if (!root) return found;
    for (const char* tree : {"common", "scan_site", "fab_site"}) {
      std::vector<fs::path> files;
      for (const auto& entry : fs::recursive_directory_iterator(fs::path{root} / tree))
        if (entry.is_regular_file() && (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp"))
          files.push_back(entry.path());
      std::sort(files.begin(), files.end());
      for (const fs::path& file : files) {
        std::ifstream in{file};
        std::string text;
        for (std::size_t number = 1; std::getline(in, text); ++number)
          found.push_back({fs::relative(file, root).generic_string(), number, text});
      }
    }
    return found;
  }();
  return lines;
}

std::string place(const Line& line) { return line.path + ":" + std::to_string(line.number) + ": "; }

TEST(Layering, LooksAtTheWholeTree) {
  EXPECT_GT(all_lines().size(), 5000u) << "TELEFAB_SOURCE must name the repository";
}

TEST(Layering, EveryModuleHasItsPlaceInTheOrder) {
  for (const Line& line : all_lines())
    if (line.number == 1) {
      EXPECT_TRUE(rank_of(module_of(line.path))) << place(line) << "name its module in kOrder";
    }
}

TEST(Layering, EveryIncludeKeepsTheOrderOfTheTree) {
  static const std::regex pattern{R"re(\s*#\s*include\s*[<"]([^>"]+)[>"].*)re"};
  std::smatch parts;
  for (const Line& line : all_lines()) {
    if (!rank_of(module_of(line.path)) || !std::regex_match(line.text, parts, pattern)) continue;
    EXPECT_EQ(complaint(line.path, parts[1].str()), "") << place(line);
  }
}

TEST(Layering, TimeIsAnArgument) {
  static const std::regex pattern{
      R"((steady|system|high_resolution)_clock::now|this_thread::sleep|\b(usleep|nanosleep)\s*\(|\bsleep\s*\(\d)"};
  for (const Line& line : all_lines())
    if (std::regex_search(line.text, pattern)) {
      EXPECT_TRUE(starts_with_any(line.path, kMayReadClocks)) << place(line) << "takes a Clock& instead";
    }
}

TEST(Layering, TheVersionStandsInOnePlace) {
  std::ifstream project{fs::path{std::getenv("TELEFAB_SOURCE")} / "CMakeLists.txt"};
  const std::string text{std::istreambuf_iterator<char>{project}, {}};
  std::smatch version;
  ASSERT_TRUE(std::regex_search(text, version, std::regex{R"(project\(telefab VERSION (\d+\.\d+\.\d+))"}));
  for (const Line& line : all_lines())
    EXPECT_EQ(line.text.find(version[1]), std::string::npos) << place(line) << "takes kVersion of base";
}

TEST(Layering, WhatAProgramSaysGoesThroughOnePlace) {
  // What throws or ends the process where a pipe is closed or a disk is full; a file of one's own is another matter.
  static const std::regex pattern{R"(fmt::print|std::(cout|cerr|clog)\b|\bf?printf\s*\(|\bputs\s*\(|\bstd(out|err)\b)"};
  for (const Line& line : all_lines())
    if (std::regex_search(line.text, pattern) && !line.text.starts_with("#include")) {
      EXPECT_TRUE(line.path == "common/command_line/src/output.cpp" ||
                  line.text.find("stderr_sink") != std::string::npos)
          << place(line) << "takes write_output or write_note";
    }
}

TEST(Layering, PublicHeadersDoNotChangeWithFlags) {
  static const std::regex pattern{R"(\s*#\s*(if|ifdef|ifndef|elif)\b.*)"};
  for (const Line& line : all_lines())
    if (line.path.find("/include/telefab/") != std::string::npos) {
      EXPECT_FALSE(std::regex_match(line.text, pattern)) << place(line) << "a type must mean one thing everywhere";
    }
}

TEST(Layering, ChangesNothingGlobally) {
  static const std::regex pattern{R"(^\s*using\s+namespace\b.*)"};
  for (const Line& line : all_lines())
    if (line.path.ends_with(".hpp")) {
      EXPECT_FALSE(std::regex_match(line.text, pattern)) << place(line) << "no using namespace in a header";
    }
}

// The rules themselves, on lines that must be refused.
TEST(Layering, RefusesWhatItShouldRefuse) {
  EXPECT_NE(complaint("scan_site/mls/src/a.cpp", "telefab/fab/mask/mask.hpp"), "");
  EXPECT_NE(complaint("scan_site/mls/src/a.cpp", "telefab/scan/contour/grid_tracer.hpp"), "");
  EXPECT_NE(complaint("scan_site/mls/src/a.cpp", "telefab/net/listener.hpp"), "");
  EXPECT_NE(complaint("common/codec/src/a.cpp", "telefab/scan/mls/mls_field.hpp"), "");
  EXPECT_NE(complaint("fab_site/print/src/a.cpp", "libusb-1.0/libusb.h"), "");
  EXPECT_NE(complaint("common/net/src/a.cpp", "telefab/v1/scan.pb.h"), "");
  EXPECT_NE(complaint("fab_site/support/include/telefab/fab/support/a.hpp", "CGAL/number_utils.h"), "");
  EXPECT_NE(complaint("scan_site/mls/include/telefab/scan/mls/a.hpp", "fmt/format.h"), "");
  EXPECT_NE(complaint("common/net/src/a.cpp", "telefab/client/client.hpp"), "");
  EXPECT_EQ(complaint("scan_site/contour/src/a.cpp", "telefab/scan/mls/mls_field.hpp"), "");
  EXPECT_EQ(complaint("fab_site/daemon/src/a.cpp", "telefab/net/listener.hpp"), "");
  EXPECT_EQ(complaint("common/wire/src/a.cpp", "telefab/v1/scan.pb.h"), "");
}

}  // namespace
