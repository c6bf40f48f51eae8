// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <charconv>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <sstream>
#include <telefab/base/text.hpp>
#include <telefab/net/port_holder.hpp>

namespace telefab::net {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kListens = "0A";  // TCP_LISTEN of the kernel's include/net/tcp_states.h

/// "socket:[INODE]" of every socket that listens on the port, as /proc/net/tcp has them:
/// "  0: 0100007F:1CFC 00000000:0000 0A tx:rx tr:when retrnsmt uid timeout inode ...".
std::set<std::string> listening_sockets(std::uint16_t port) {
  std::set<std::string> sockets;
  const std::string ending = fmt::format(":{:04X}", port);
  for (const char* table : {"/proc/net/tcp", "/proc/net/tcp6"}) {
    std::ifstream file{table};
    for (std::string line; std::getline(file, line);) {
      std::istringstream words{line};
      std::string number, local, remote, state, queues, timer, retries, user, timeout, inode;
      words >> number >> local >> remote >> state >> queues >> timer >> retries >> user >> timeout >> inode;
      if (state == kListens && local.ends_with(ending)) sockets.insert(fmt::format("socket:[{}]", inode));
    }
  }
  return sockets;
}

bool has_one_of(const fs::path& process, const std::set<std::string>& sockets) {
  std::error_code unknown;  // processes end while they are looked at, and those of others show nothing
  for (fs::directory_iterator at{process / "fd", unknown}, end; !unknown && at != end; at.increment(unknown)) {
    std::error_code closed;
    if (sockets.contains(fs::read_symlink(at->path(), closed).string())) return true;
  }
  return false;
}

/// "telefab-fab (process 123)".
std::optional<std::string> holder_of(std::uint16_t port) {
  const auto sockets = listening_sockets(port);
  if (sockets.empty()) return std::nullopt;
  std::error_code unknown;
  for (fs::directory_iterator at{"/proc", unknown}, end; !unknown && at != end; at.increment(unknown)) {
    const std::string id = at->path().filename().string();
    if (id.find_first_not_of("0123456789") != std::string::npos || !has_one_of(at->path(), sockets)) continue;
    // Its command line, not its comm, which is the name of a thread.
    std::ifstream file{at->path() / "cmdline"};
    std::string program;
    std::getline(file, program, '\0');
    const std::string name = to_printable(fs::path{program}.filename().string());
    return fmt::format("{} (process {})", name.empty() ? "a program" : name, id);
  }
  return std::nullopt;
}

}  // namespace

std::string why_port_is_taken(std::uint16_t port) {
  return fmt::format("{} has that port already; stop it, or take another port (0: any that is free)",
                     holder_of(port).value_or("another program"));
}

}  // namespace telefab::net
