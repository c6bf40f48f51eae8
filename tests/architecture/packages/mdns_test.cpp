// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <pugixml.hpp>
#include <regex>
#include <sstream>
#include <string>

// What a fab says of itself by mDNS stands in a file of its own, so that nothing but this holds it to the settings.
namespace {

std::string text_of(const std::string& path) {
  std::stringstream text;
  text << std::ifstream{std::string{std::getenv("TELEFAB_SOURCE")} + "/" + path}.rdbuf();
  return text.str();
}

struct Service {
  std::string port;
  std::map<std::string, std::string> records;
};

/// By type.
std::map<std::string, Service> services() {
  pugi::xml_document document;
  EXPECT_TRUE(document.load_string(text_of("deploy/avahi/telefab-fab.service").c_str()));
  const pugi::xml_node group = document.child("service-group");
  EXPECT_TRUE(group.child("name"));
  std::map<std::string, Service> list;
  for (const pugi::xml_node service : group.children("service")) {
    Service& read = list[service.child_value("type")];
    read.port = service.child_value("port");
    for (const pugi::xml_node record : service.children("txt-record")) {
      const std::string text = record.child_value();
      EXPECT_NE(text.find('='), std::string::npos) << text;
      read.records[text.substr(0, text.find('='))] = text.substr(text.find('=') + 1);
    }
  }
  return list;
}

/// The port that the settings of an installed fab give `option`.
std::string port_of(const std::string& option) {
  const std::string settings = text_of("deploy/config/fab.conf");
  std::smatch found;
  EXPECT_TRUE(std::regex_search(settings, found, std::regex{option + "[ =][0-9.]+:([0-9]+)"})) << option;
  return found[1];
}

TEST(Mdns, NamesThePortsOfTheInstalledSettings) {
  const auto list = services();
  ASSERT_EQ(list.size(), 3U);
  EXPECT_EQ(list.at("_octoprint._tcp").port, port_of("--web"));
  EXPECT_EQ(list.at("_prusalink._tcp").port, port_of("--web"));
  EXPECT_EQ(list.at("_telefab._tcp").port, port_of("TELEFAB_FAB_LISTEN"));
  EXPECT_EQ(list.at("_telefab._tcp").records.at("page"), port_of("--web"));
}

TEST(Mdns, TellsWhatProgramsThatLookForPrintersRead) {
  auto list = services();
  for (const char* type : {"_octoprint._tcp", "_prusalink._tcp"})
    for (const char* key : {"path", "version", "api", "model", "vendor"})
      EXPECT_FALSE(list[type].records[key].empty()) << type << ' ' << key;
  EXPECT_EQ(list["_octoprint._tcp"].records["path"], "/");
  EXPECT_EQ(list["_prusalink._tcp"].records["path"], "/prusalink/");
}

TEST(Mdns, IsInThePackageAndOffUntilSomebodyTurnsItOn) {
  const std::string installed = text_of("deploy/CMakeLists.txt");
  EXPECT_TRUE(std::regex_search(
      installed, std::regex{R"(avahi/telefab-fab\.service\s+DESTINATION share/telefab/avahi COMPONENT fab-site)"}));
  EXPECT_EQ(installed.find("/etc/avahi"), std::string::npos);
  EXPECT_NE(text_of("deploy/docs/operators-guide.md").find("/etc/avahi/services"), std::string::npos);
}

}  // namespace
