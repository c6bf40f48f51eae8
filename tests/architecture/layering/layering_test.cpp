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

constexpr std::array kTrees{"common", "scan_site", "fab_site"};

/// A line of a tree's modules.txt.
struct Room {
  std::string name;  ///< with its tree: "scan_site/mls"
  Strings may_use;   ///< the same, of its own tree and of common
  std::string sentence;
};

fs::path source() {
  const char* root = std::getenv("TELEFAB_SOURCE");
  return root ? root : "";
}

std::string trimmed(const std::string& text) {
  const auto from = text.find_first_not_of(' '), to = text.find_last_not_of(' ');
  return from == std::string::npos ? "" : text.substr(from, to - from + 1);
}

/// The rooms of a tree, in the order of dependence.
std::vector<Room> read_rooms(const std::string& tree) {
  std::vector<Room> rooms;
  std::ifstream in{source() / tree / "modules.txt"};
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line.front() == '#') continue;
    Strings cells;
    std::istringstream row{line};
    for (std::string cell; std::getline(row, cell, '|');) cells.push_back(trimmed(cell));
    if (tree == "common") cells.insert(cells.begin() + 1, "");
    Room room{tree + "/" + cells.at(0), {}, cells.at(3)};
    for (const auto& [cell, of] : {std::pair{cells[1], std::string{"common"}}, std::pair{cells[2], tree}}) {
      std::istringstream names{cell};
      for (std::string name; names >> name;) room.may_use.push_back(of + "/" + name);
    }
    rooms.push_back(std::move(room));
  }
  return rooms;
}

const std::vector<std::vector<Room>>& all_rooms() {
  static const std::vector<std::vector<Room>> rooms = [] {
    std::vector<std::vector<Room>> all;
    for (const char* tree : kTrees) all.push_back(read_rooms(tree));
    return all;
  }();
  return rooms;
}

/// Nothing depends on these.
const Strings kLeaves{"common/client", "scan_site/commands", "fab_site/commands"};

/// What may see sockets, jobs on disk, the wire, the program frame: the daemons and the outer half of common. What a
/// job is and what may be asked of it are values that anybody may see.
const Strings kOuter{"common/command_line", "common/store", "common/transfer", "common/wire",
                     "common/net",          "common/web",   "common/service"};
const Strings kMayUseOuter{"common/command_line", "common/store",     "common/transfer",    "common/wire",
                           "common/net",          "common/web",       "common/service",     "common/client",
                           "scan_site/web",       "scan_site/daemon", "scan_site/commands", "fab_site/web",
                           "fab_site/daemon",     "fab_site/commands"};

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
    {"xf86drm", {"fab_site/screen"}},
    {"drm_fourcc", {"fab_site/screen"}},
    {"google/protobuf", {"common/wire"}},
    {"telefab/v1/", {"common/wire"}},
    {"sqlite3.h", {"common/store"}},
    {"pqxx/", {"common/store"}},
    {"libpq-fe.h", {"common/store"}},
    {"zip.h", {"fab_site/formats"}},
    {"boost/asio",
     {"common/net", "common/client", "common/web", "scan_site/daemon", "fab_site/daemon", "fab_site/lan"}},
    {"boost/beast", {"common/web", "fab_site/lan"}},
    {"boost/graph", {"fab_site/carry"}},
    {"openssl/", {"common/base", "common/net", "common/web"}},
    {"xsimd/", {"scan_site/mls"}},
    {"CLI/", {"common/command_line"}},
};

/// Libraries that no public header mentions, whoever uses them.
const Strings kNeverPublic{"tbb/", "fmt/", "nlohmann/", "spdlog/", "toml++/", "spng", "libdeflate", "zlib.h", "boost/"};

/// The only places that ask the machine what time it is, or sleep.
const Strings kMayReadClocks{"common/base/src/clock.cpp", "common/net/src/", "scan_site/daemon/", "fab_site/daemon/"};

/// A regular expression is slow; most lines have none of the words that could make it match.
bool holds_any(const std::string& line, std::initializer_list<const char*> words) {
  return std::any_of(words.begin(), words.end(),
                     [&](const char* word) { return line.find(word) != std::string::npos; });
}

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

const Room* room_of(const std::string& module) {
  for (const auto& tree : all_rooms())
    for (const Room& room : tree)
      if (room.name == module) return &room;
  return nullptr;
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
  const bool declares_only = include == "nlohmann/json_fwd.hpp";
  if (is_public && !declares_only && starts_with_any(include, kNeverPublic))
    return include + " must not appear in a public header";

  const auto target = included_module(include);
  if (!target || *target == module || include.starts_with("telefab/v1/")) return "";
  const Room* own = room_of(module);
  if (!own) return module + " is in no modules.txt";
  if (!room_of(*target)) return *target + " is in no modules.txt";
  if (holds(kLeaves, *target)) return "nothing may depend on " + *target;
  if (!holds(own->may_use, *target))
    return "must not see " + *target + "; what " + module + " may use stands in modules.txt";
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
    const fs::path root = source();
    std::vector<Line> found;
    if (root.empty()) return found;
    for (const char* tree : kTrees) {
      std::vector<fs::path> files;
      for (const auto& entry : fs::recursive_directory_iterator(root / tree))
        if (entry.is_regular_file() && (entry.path().extension() == ".cpp" || entry.path().extension() == ".hpp"))
          files.push_back(entry.path());
      std::sort(files.begin(), files.end());
      for (const fs::path& file : files) {
        std::ifstream in{file};
        const std::string path = fs::relative(file, root).generic_string();
        std::string text;
        for (std::size_t number = 1; std::getline(in, text); ++number) found.push_back({path, number, text});
      }
    }
    return found;
  }();
  return lines;
}

std::string place(const Line& line) { return line.path + ":" + std::to_string(line.number) + ": "; }

/// What a line includes; nothing where it includes nothing.
std::optional<std::string> include_of(const std::string& line) {
  static const std::regex pattern{R"re(\s*#\s*include\s*[<"]([^>"]+)[>"].*)re"};
  std::smatch parts;
  if (line.find("#") == std::string::npos || !std::regex_match(line, parts, pattern)) return std::nullopt;
  return parts[1].str();
}

TEST(Layering, LooksAtTheWholeTree) {
  EXPECT_GT(all_lines().size(), 5000u) << "TELEFAB_SOURCE must name the repository";
}

TEST(Layering, EveryModuleStandsInTheListOfItsTree) {
  for (const Line& line : all_lines())
    if (line.number == 1) {
      EXPECT_TRUE(room_of(module_of(line.path))) << place(line) << "name its module in modules.txt";
    }
  for (const auto& tree : all_rooms())
    for (const Room& room : tree) EXPECT_TRUE(fs::is_directory(source() / room.name)) << room.name << " does not exist";
}

TEST(Layering, ARoomMayUseOnlyWhatStandsAboveIt) {
  for (const auto& tree : all_rooms()) {
    Strings above;
    for (const Room& room : all_rooms().front()) above.push_back(room.name);
    if (&tree == &all_rooms().front()) above.clear();
    for (const Room& room : tree) {
      for (const std::string& used : room.may_use)
        EXPECT_TRUE(holds(above, used)) << room.name << " may not use " << used << ", which is not above it";
      above.push_back(room.name);
    }
  }
}

TEST(Layering, ARoomUsesWhatItMayUse) {
  std::map<std::string, Strings> used;
  for (const Line& line : all_lines())
    if (const auto include = include_of(line.text))
      if (const auto target = included_module(*include)) used[module_of(line.path)].push_back(*target);
  for (const auto& tree : all_rooms())
    for (const Room& room : tree)
      for (const std::string& other : room.may_use)
        EXPECT_TRUE(holds(used[room.name], other))
            << room.name << " does not use " << other << "; take it off its line";
}

// The tables of the READMEs once named a room that did not exist, and others in another order.
TEST(Layering, TheTablesOfTheReadmesSayWhatTheListsSay) {
  static const std::regex row{R"re(\| (?:\[([a-z_]+)\]\([^)]*\)|([a-z_]+)) \| (.*) \|)re"};
  for (std::size_t i = 0; i < kTrees.size(); ++i) {
    std::ifstream in{source() / kTrees[i] / "README.md"};
    std::vector<std::pair<std::string, std::string>> table, expected;
    for (const Room& room : all_rooms()[i]) expected.emplace_back(room.name, room.sentence);
    bool is_in_rooms = false;
    std::smatch cells;
    for (std::string line; std::getline(in, line);) {
      if (line.starts_with("| room |") || line.starts_with("| module |")) is_in_rooms = true;
      if (!line.starts_with("|")) is_in_rooms = false;
      if (is_in_rooms && std::regex_match(line, cells, row) && cells[1].str() + cells[2].str() != "room" &&
          cells[2] != "module")
        table.emplace_back(kTrees[i] + ("/" + cells[1].str() + cells[2].str()), cells[3]);
    }
    EXPECT_EQ(table, expected) << kTrees[i];
  }
}

TEST(Layering, EveryIncludeIsOneThatItsRoomMayUse) {
  for (const Line& line : all_lines())
    if (const auto include = include_of(line.text)) {
      EXPECT_EQ(complaint(line.path, *include), "") << place(line);
    }
}

TEST(Layering, TimeIsAnArgument) {
  static const std::regex pattern{
      R"((steady|system|high_resolution)_clock::now|this_thread::sleep|\b(usleep|nanosleep)\s*\(|\bsleep\s*\(\d)"};
  for (const Line& line : all_lines())
    if (holds_any(line.text, {"clock::now", "sleep"}) && std::regex_search(line.text, pattern)) {
      EXPECT_TRUE(starts_with_any(line.path, kMayReadClocks)) << place(line) << "takes a Clock& instead";
    }
}

// A plan that said 8e51 for a layer was undefined behaviour.
TEST(Layering, AWholeNumberOfJsonIsReadWhereItsRangeIsChecked) {
  static const std::regex pattern{
      R"((\.|->)(get<|value\("[a-z_0-9]+", *)(std::)?(u?int[0-9_t]*|size_t|unsigned|long))"};
  for (const Line& line : all_lines())
    if (holds_any(line.text, {"get<", "value("}) && std::regex_search(line.text, pattern)) {
      ADD_FAILURE() << place(line) << "takes whole_number of base";
    }
}

// Its parser and its writer cost a second and a half wherever they are compiled; and a writer of one's own threw on a
// name that is no UTF-8.
TEST(Layering, TheTextOfJsonIsReadAndWrittenInOnePlace) {
  static const std::regex pattern{R"(\b[Jj]son::parse\(|\.dump\()"};
  for (const Line& line : all_lines())
    if (holds_any(line.text, {"parse(", "dump("}) && std::regex_search(line.text, pattern)) {
      EXPECT_EQ(line.path, "common/base/src/json_text.cpp") << place(line) << "takes json_text of base";
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
    if (holds_any(line.text, {"fmt::print", "printf", "puts", "std::c", "stdout", "stderr"}) &&
        !line.text.starts_with("#include") && std::regex_search(line.text, pattern)) {
      EXPECT_TRUE(line.path == "common/command_line/src/output.cpp" ||
                  line.text.find("stderr_sink") != std::string::npos)
          << place(line) << "takes write_output or write_note";
    }
}

// Masks were once encoded, decoded to be darkened, and encoded again.
TEST(Layering, ThePlannerReadsNoPictureThatItMade) {
  for (const Line& line : all_lines())
    if (line.path.starts_with("fab_site/planning/") && line.text.find("decode_png") != std::string::npos) {
      EXPECT_EQ(line.path, "fab_site/planning/src/plan_folder.cpp") << place(line) << "reads plans of others alone";
    }
}

TEST(Layering, PublicHeadersDoNotChangeWithFlags) {
  static const std::regex pattern{R"(\s*#\s*(if|ifdef|ifndef|elif)\b.*)"};
  for (const Line& line : all_lines())
    if (line.path.find("/include/telefab/") != std::string::npos) {
      EXPECT_FALSE(holds_any(line.text, {"#"}) && std::regex_match(line.text, pattern))
          << place(line) << "a type must mean one thing everywhere";
    }
}

TEST(Layering, ChangesNothingGlobally) {
  static const std::regex pattern{R"(^\s*using\s+namespace\b.*)"};
  for (const Line& line : all_lines())
    if (line.path.ends_with(".hpp")) {
      EXPECT_FALSE(holds_any(line.text, {"using"}) && std::regex_match(line.text, pattern))
          << place(line) << "no using namespace in a header";
    }
}

/// A member that holds a state, or a sentence for people about one, compared with a literal: what a program decides by
/// is an enumeration.
bool decides_by_text(const std::string& line) {
  static const std::regex compared{
      R"re((?:\.|->)(?:state|phase|verdict|note|outcome|message|reason|why|cause|what|text)(?:\(\))?\s*(?:==|!=)\s*"|)re"
      R"re((?:\.|->)(?:state|phase|verdict|note|outcome|message|reason|why|cause|what|text)(?:\(\))?\.)re"
      R"re((?:starts_with|ends_with|find|contains)\(\s*"|name_of\([^"]*\)\s*(?:==|!=)\s*"|"\s*(?:==|!=)\s*name_of\()re"};
  return line.find('"') != std::string::npos && std::regex_search(line, compared);
}

// "Waits for approval" was once a message that was not empty, and a hold a sentence that began in a certain way.
TEST(Layering, NoProgramDecidesByATextForPeople) {
  for (const Line& line : all_lines())
    EXPECT_FALSE(decides_by_text(line.text)) << place(line) << "makes it an enumeration, and its text at the edge";
  for (const char* wrong :
       {R"(if (progress.state == "paused") return;)", R"(hold.reason.starts_with("open"))", R"(x = job->message != "")",
        R"(item.verdict == "held")", R"(if (name_of(state) == "done"))", R"(certificate.why.find("gap") == 0)"})
    EXPECT_TRUE(decides_by_text(wrong)) << wrong;
  for (const char* right : {R"(if (request.method == "GET"))", R"(job.message.empty() ? "" : ": ")", R"(word == "ok")"})
    EXPECT_FALSE(decides_by_text(right)) << right;
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
