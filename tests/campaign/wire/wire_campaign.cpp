// SPDX-License-Identifier: GPL-3.0-or-later
// Campaigns on the line between two real sites, by hand; figures on standard output.
//   campaign_wire BIN FOLDER link [CLOUD MACHINES_FOLDER WORDS OF SUBMIT...]
//   campaign_wire BIN FOLDER cuts 1000
//   campaign_wire BIN FOLDER kills 200
//   campaign_wire BIN FOLDER damage 100000
#include <fmt/format.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <telefab/test/campaign_main.hpp>
#include <thread>

#include "damage.hpp"
#include "line_proxy.hpp"
#include "sites.hpp"

namespace telefab::test {
namespace {

double seconds_since(std::chrono::steady_clock::time_point began) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

struct Sent {
  double seconds = -1;
  LineCount count;
  nlohmann::json job;
};

Sent send_over(Sites& sites, const Line& line) {
  LineProxy proxy{sites.fab_port(), line};
  sites.start_scan(proxy.port());
  const auto began = std::chrono::steady_clock::now();
  const std::string id = sites.submit();
  Sent sent;
  if (sites.wait_until_kept(id, 600)) sent.seconds = seconds_since(began);
  std::this_thread::sleep_for(std::chrono::milliseconds{300});
  sent.count = proxy.count();
  sent.job = sites.job(id);
  if (!sites.same_chunks(id)) fmt::print("job {}: THE CHUNKS DIFFER\n", id);
  sites.kill_scan();
  return sent;
}

int link_campaign(Sites& sites) {
  sites.start_fab();
  fmt::print(
      "| line | s from submit to whole at the fab | of it slicing | bytes up | chunk bytes | chunks again "
      "|\n|---|---|---|---|---|---|\n");
  const std::pair<const char*, Line> lines[]{
      {"loopback", {}},
      {"60 ms, 10 Mbit/s", {.one_way_ms = 30, .bits_per_s = 1e7}},
      {"60 ms, 10 Mbit/s, 1 % loss", {.one_way_ms = 30, .bits_per_s = 1e7, .loss = 0.01}},
      {"60 ms, 1 Mbit/s, 1 % loss", {.one_way_ms = 30, .bits_per_s = 1e6, .loss = 0.01}}};
  for (const auto& [name, line] : lines) {
    const Sent sent = send_over(sites, line);
    double slice = 0;
    if (sent.job.contains("stages") && sent.job["stages"].contains("slice")) slice = sent.job["stages"]["slice"];
    fmt::print("| {} | {:.2f} | {:.2f} | {} | {} | {} |\n", name, sent.seconds, slice, sent.count.bytes_up,
               sent.count.chunk_bytes, sent.count.chunks_again);
    std::fflush(stdout);
  }
  return 0;
}

int cuts_campaign(Sites& sites, int wanted) {
  sites.start_fab();
  const LineCount clean = send_over(sites, {}).count;
  fmt::print("clean: {} chunks, {} bytes up\n", clean.chunks, clean.bytes_up);
  LineCount all;
  int jobs = 0;
  int whole = 0;
  while (all.cuts < wanted) {
    Line line{.cuts = wanted - all.cuts, .longest_bytes = 24'000, .seed = static_cast<std::uint32_t>(100 + jobs)};
    LineProxy proxy{sites.fab_port(), line};
    sites.start_scan(proxy.port());
    const std::string id = sites.submit();
    ++jobs;
    if (sites.wait_until_kept(id, 600) && sites.same_chunks(id)) ++whole;
    const LineCount count = proxy.count();
    all.cuts += count.cuts;
    all.chunks += count.chunks;
    all.chunks_again += count.chunks_again;
    all.kept_again += count.kept_again;
    all.bytes_up += count.bytes_up;
    all.connections += count.connections;
    sites.kill_scan();
    if (jobs % 10 == 0) fmt::print("{} cuts in {} jobs\n", all.cuts, jobs), std::fflush(stdout);
  }
  fmt::print(
      "| jobs | cuts | connections | stacks byte-identical | chunks sent | again, unacknowledged | again, acknowledged "
      "|\n"
      "|---|---|---|---|---|---|---|\n| {} | {} | {} | {} | {} | {} | {} |\n",
      jobs, all.cuts, all.connections, whole, all.chunks, all.chunks_again, all.kept_again);
  return whole == jobs && all.kept_again == 0 ? 0 : 5;
}

int kills_campaign(Sites& sites, int wanted) {
  sites.start_fab();
  // Slow enough that most kills fall into the transfer.
  LineProxy proxy{sites.fab_port(), {.bits_per_s = 4e5}};
  sites.start_scan(proxy.port());
  std::mt19937 random{7};
  int kills[2] = {0, 0};
  int in_transfer = 0;
  int jobs = 0;
  int whole = 0;
  while (kills[0] + kills[1] < wanted) {
    const std::string id = sites.submit();
    ++jobs;
    while (!sites.wait_until_kept(id, 0.05 + static_cast<double>(random() % 1000) / 1000) &&
           kills[0] + kills[1] < wanted) {
      const std::uint64_t before = proxy.count().chunks;
      if (random() % 2 == 0) {
        sites.kill_fab();
        sites.start_fab();
        ++kills[0];
      } else {
        sites.kill_scan();
        sites.start_scan(proxy.port());
        ++kills[1];
      }
      if (before > 0) ++in_transfer;
    }
    if (sites.wait_until_kept(id, 600) && sites.same_chunks(id)) ++whole;
    if (jobs % 5 == 0) fmt::print("{} kills in {} jobs\n", kills[0] + kills[1], jobs), std::fflush(stdout);
  }
  const LineCount count = proxy.count();
  fmt::print(
      "| jobs | kills of the fab | of the scan site | stacks byte-identical | chunks sent | again, unacknowledged | "
      "again, acknowledged |\n"
      "|---|---|---|---|---|---|---|\n| {} | {} | {} | {} | {} | {} | {} |\n",
      jobs, kills[0], kills[1], whole, count.chunks, count.chunks_again, count.kept_again);
  return whole == jobs && count.kept_again == 0 ? 0 : 5;
}

int run(const std::vector<std::string>& words) {
  if (words.size() < 3) {
    fmt::print(stderr, "campaign_wire BIN FOLDER link | cuts N | kills N | damage N\n");
    return 1;
  }
  Sites sites{words[0], words[1]};
  const int many = words.size() > 3 ? std::atoi(words[3].c_str()) : 100;
  if (words[2] == "link") {
    if (words.size() > 4) {
      std::filesystem::copy(words[4], sites.folder() / "machines", std::filesystem::copy_options::recursive);
      std::vector<std::string> submit{words[3]};
      submit.insert(submit.end(), words.begin() + 5, words.end());
      sites.set_scan(submit);
    }
    return link_campaign(sites);
  }
  if (words[2] == "cuts") return cuts_campaign(sites, many);
  if (words[2] == "kills") return kills_campaign(sites, many);
  if (words[2] == "damage") return damage_campaign(sites, many);
  return 1;
}

}  // namespace
}  // namespace telefab::test

int main(int count, char** words) { return telefab::test::campaign_main(count, words, telefab::test::run); }
