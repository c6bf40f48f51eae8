// SPDX-License-Identifier: GPL-3.0-or-later
#include "sites.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <telefab/test/toy.hpp>
#include <thread>

namespace telefab::test {
namespace {

constexpr auto kLookEvery = std::chrono::milliseconds{20};

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in{file, std::ios::binary};
  return {std::istreambuf_iterator<char>{in}, {}};
}

/// Runs it with standard output and error in these files; the child's id.
pid_t spawn(const std::vector<std::string>& command, const std::string& output, const std::string& errors) {
  std::vector<char*> words;
  for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::dup2(::open(output.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), STDOUT_FILENO);
    ::dup2(::open(errors.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0644), STDERR_FILENO);
    ::execv(words[0], words.data());
    ::_exit(127);
  }
  return pid;
}

}  // namespace

Sites::Sites(std::filesystem::path bin, std::filesystem::path folder)
    : bin_{std::move(bin)}, folder_{std::move(folder)} {
  std::filesystem::remove_all(folder_);
  std::filesystem::create_directories(folder_ / "machines");
  std::ofstream{folder_ / "machines" / "toy.toml"} << kToyProfile;
  write_torus(folder_ / "torus.xyz", 180, 72);
  submit_ = {(folder_ / "torus.xyz").string(),
             "--machine",
             "toy",
             "--height-mm",
             "5",
             "--layer-mm",
             "0.01",
             "--coding",
             "exact"};
}

Sites::~Sites() {
  kill_scan();
  kill_fab();
}

pid_t Sites::start(const std::vector<std::string>& command, const std::string& name, std::uint16_t& port) {
  const auto port_file = folder_ / name / "port";
  std::filesystem::remove(port_file);
  const pid_t pid = spawn(command, (folder_ / (name + ".out")).string(), (folder_ / (name + ".log")).string());
  for (int i = 0; i < 1500; ++i) {
    const std::string text = text_of(port_file);
    if (!text.empty() && text.back() == '\n') {
      port = static_cast<std::uint16_t>(std::stoi(text));
      return pid;
    }
    std::this_thread::sleep_for(kLookEvery);
  }
  throw std::runtime_error{name + " does not start; see " + (folder_ / (name + ".log")).string()};
}

void Sites::start_fab() {
  fab_ = start({bin_ / "telefab-fab", "serve", "--listen", fmt::format("127.0.0.1:{}", fab_port_), "--data",
                folder_ / "fab", "--machines", folder_ / "machines", "--start", "on-approval"},
               "fab", fab_port_);
}

void Sites::start_scan(std::uint16_t way) {
  scan_ = start({bin_ / "telefab-scan", "serve", "--listen", fmt::format("127.0.0.1:{}", scan_port_), "--fab",
                 fmt::format("127.0.0.1:{}", way), "--data", folder_ / "scan", "--machines", folder_ / "machines"},
                "scan", scan_port_);
}

void Sites::kill(pid_t& pid) {
  if (pid <= 0) return;
  ::kill(pid, SIGKILL);
  ::waitpid(pid, nullptr, 0);
  pid = -1;
}

std::string Sites::client(const std::vector<std::string>& words) const {
  std::vector<std::string> command{bin_ / "telefab"};
  command.insert(command.end(), words.begin(), words.end());
  command.insert(command.end(), {"--site", fmt::format("127.0.0.1:{}", scan_port_)});
  const auto out = folder_ / "client.out";
  int status = 0;
  ::waitpid(spawn(command, out.string(), (folder_ / "client.log").string()), &status, 0);
  return status == 0 ? text_of(out) : std::string{};
}

std::string Sites::submit() const {
  std::vector<std::string> words{"submit"};
  words.insert(words.end(), submit_.begin(), submit_.end());
  const std::string text = client(words);
  if (text.empty()) throw std::runtime_error{"the job is refused; see " + (folder_ / "client.log").string()};
  return text.substr(0, text.find('\n'));
}

nlohmann::json Sites::job(const std::string& id) const {
  auto value = nlohmann::json::parse(client({"status", id, "--json"}), nullptr, false);
  return value.is_discarded() ? nlohmann::json{} : value;
}

bool Sites::wait_until_kept(const std::string& id, double patience_s) const {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(patience_s);
  // The fab's own mark: it is written when chain, digest and signature were checked.
  while (std::chrono::steady_clock::now() < end) {
    if (std::filesystem::exists(folder_ / "fab" / "jobs" / id / "end")) return true;
    std::this_thread::sleep_for(kLookEvery);
  }
  return false;
}

bool Sites::same_chunks(const std::string& id) const {
  // The fab's end is written a moment before the last record of its chunks.
  for (int i = 0; i < 250; ++i) {
    const std::string sent = text_of(folder_ / "scan" / "jobs" / id / "chunks");
    if (!sent.empty() && sent == text_of(folder_ / "fab" / "jobs" / id / "chunks")) return true;
    std::this_thread::sleep_for(kLookEvery);
  }
  return false;
}

}  // namespace telefab::test
