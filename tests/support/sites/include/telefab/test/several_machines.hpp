// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <telefab/test/two_sites.hpp>
#include <thread>

namespace telefab::test {

/// A fab in which several machines stand, all virtual unless the list says otherwise.
class SeveralMachines : public TwoSites {
 protected:
  using Json = nlohmann::json;

  /// The list of machines: a table for each name, with what `more` states of it.
  void write_list(const std::vector<std::string>& names, const std::map<std::string, std::string>& more = {}) const {
    std::ofstream list{folder() / "fab.toml"};
    for (const std::string& name : names) {
      const auto own = more.find(name);
      list << fmt::format("[[machine]]\nname = \"{}\"\nprofile = \"toy\"\n{}\n", name,
                          own == more.end() ? "" : own->second);
    }
  }
  [[nodiscard]] std::vector<std::string> with_list(std::vector<std::string> more = {}) const {
    more.insert(more.end(), {"--instances", (folder() / "fab.toml").string()});
    return more;
  }
  /// Both sites with the list; the scan site knows the fab's machines.
  void start_sites(const std::vector<std::string>& more = {}) {
    start_fab(with_list(more));
    start_scan();
    ASSERT_TRUE(await([&] { return telefab({"machines"}).output.find("any of") != std::string::npos; })) << says();
  }
  [[nodiscard]] std::string submit_for(const std::string& machine, const std::string& height_mm = "4",
                                       const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words{"submit", torus().string(), "--machine", machine, "--height-mm", height_mm};
    words.insert(words.end(), more.begin(), more.end());
    const Outcome outcome = telefab(words);
    EXPECT_EQ(outcome.code, 0) << outcome.errors;
    return outcome.output.substr(0, outcome.output.find('\n'));
  }
  [[nodiscard]] Outcome at_fab(std::vector<std::string> words) const {
    words.insert(words.end(), {"--site", fab_site()});
    return telefab(std::move(words));
  }
  [[nodiscard]] std::string says() const { return at_fab({"jobs"}).output + at_fab({"machines"}).output; }
  /// What a machine is at, as the fab tells its clients.
  [[nodiscard]] Json status_of(const std::string& machine) const {
    const Json list = Json::parse(at_fab({"machines", "--json"}).output, nullptr, false);
    if (list.is_array())
      for (const Json& each : list)
        if (each["name"] == machine) return each["status"];
    return {};
  }
  [[nodiscard]] std::string state_of(const std::string& machine) const {
    const Json status = status_of(machine);
    return status.is_object() ? status["state"].get<std::string>() : "not there";
  }
  [[nodiscard]] Json job_of(const std::string& job) const {
    return Json::parse(at_fab({"status", job, "--json"}).output, nullptr, false);
  }
  [[nodiscard]] std::string job_state(const std::string& job) const {
    const Json found = job_of(job);
    return found.is_object() ? found["state"].get<std::string>() : "not there";
  }
  /// Between two looks, each of which starts a client.
  std::chrono::milliseconds look_every{20};
  template <class Condition>
  [[nodiscard]] bool await(Condition condition, int seconds = 60) const {
    for (const auto until = std::chrono::steady_clock::now() + std::chrono::seconds{seconds};
         std::chrono::steady_clock::now() < until; std::this_thread::sleep_for(look_every))
      if (condition()) return true;
    return condition();
  }
  [[nodiscard]] std::filesystem::path job_folder(const std::string& job) const {
    return folder() / "fab" / "jobs" / job;
  }
  [[nodiscard]] Json record_of(const std::string& job) const {
    const auto path = job_folder(job) / "report" / "as-built.json";
    const Json sealed = Json::parse(text_of(path), nullptr, false);
    EXPECT_TRUE(sealed.is_object() && sealed.contains("record")) << "no record of " << job << "\n" << says();
    return sealed.is_object() ? sealed.value("record", Json::object()) : Json::object();
  }
  /// Lights that the job's journal announced.
  [[nodiscard]] std::size_t lights(const std::string& job) const {
    const auto path = job_folder(job) / "journal";
    const std::string text = std::filesystem::exists(path) ? text_of(path) : "";
    std::size_t count = 0;
    for (std::size_t at = 0; (at = text.find(R"("step":"exposing")", at)) != std::string::npos; ++at) ++count;
    return count;
  }
};

}  // namespace telefab::test
