// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <fmt/format.h>
#include <pwd.h>
#include <signal.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <string>
#include <telefab/test/scratch_folder.hpp>

namespace telefab::test {

/// A PostgreSQL server of its own, on a socket in a folder of its own; it is gone with this. The server refuses to run
/// as root: then it runs as the user `postgres` of Debian's package.
class PostgresServer {
 public:
  /// Null where this computer has none.
  static std::unique_ptr<PostgresServer> start() {
    const std::filesystem::path programs = "/usr/lib/postgresql/15/bin";
    std::error_code error;
    if (!std::filesystem::exists(programs / "initdb", error)) return nullptr;
    if (::geteuid() == 0 && ::getpwnam("postgres") == nullptr) return nullptr;
    auto server = std::unique_ptr<PostgresServer>{new PostgresServer{programs}};
    return server->make() && server->run() ? std::move(server) : nullptr;
  }
  ~PostgresServer() { (void)control("stop -m immediate"); }
  PostgresServer(const PostgresServer&) = delete;
  PostgresServer& operator=(const PostgresServer&) = delete;

  /// Of a database of that name, which is made.
  [[nodiscard]] std::string uri_of(const std::string& database) {
    (void)as_owner(fmt::format("{}/createdb -h {} {}", programs_.string(), folder_.string(), database));
    return fmt::format("postgresql://{}@/{}?host={}", owner_, database, folder_.string());
  }
  /// The same as another role than the owner, which must be there.
  [[nodiscard]] std::string uri_of(const std::string& database, const std::string& role) const {
    return fmt::format("postgresql://{}@/{}?host={}", role, database, folder_.string());
  }
  /// Has a file of statements carried out by the owner, or some of them; false: one of them failed.
  bool carry_out(const std::string& database, const std::filesystem::path& file) const {
    return as_owner(fmt::format("psql -v ON_ERROR_STOP=1 -h {} -U {} -d {} < {}", folder_.string(), owner_, database,
                                file.string()));
  }
  bool carry_out(const std::string& database, const std::string& statements) const {
    return as_owner(fmt::format("psql -v ON_ERROR_STOP=1 -h {} -U {} -d {} -c '{}'", folder_.string(), owner_, database,
                                statements));
  }
  /// Tried again for a while: what a killed one left behind holds its memory until it has seen that.
  bool run() {
    for (int tries = 0; tries < 50; ++tries) {
      if (control(fmt::format("start -w -l {}/log -o \"-k {} -h ''\"", folder_.string(), folder_.string())))
        return true;
      ::usleep(200'000);
    }
    return false;
  }
  /// Of the server and what it has begun; 0: it does not run.
  [[nodiscard]] pid_t id() const {
    std::ifstream file{folder_ / "data" / "postmaster.pid"};
    pid_t pid = 0;
    return file >> pid ? pid : 0;
  }
  /// As the power would: nothing is ended in order.
  void kill() {
    if (const pid_t pid = id(); pid > 0) ::kill(pid, SIGKILL);  // what it left behind ends once it sees that
  }

 private:
  explicit PostgresServer(std::filesystem::path programs) : programs_{std::move(programs)} {
    if (::geteuid() == 0) {
      owner_ = "postgres";
      as_ = "runuser -u postgres -- ";
    } else {
      owner_ = ::getpwuid(::geteuid())->pw_name;
    }
  }
  bool make() {
    if (!as_.empty() && std::system(fmt::format("chown {} {}", owner_, folder_.string()).c_str()) != 0) return false;
    return as_owner(
        fmt::format("{}/initdb -D {}/data -A trust -U {} --no-sync", programs_.string(), folder_.string(), owner_));
  }
  bool control(const std::string& words) const {
    return as_owner(fmt::format("{}/pg_ctl -D {}/data {}", programs_.string(), folder_.string(), words));
  }
  bool as_owner(const std::string& command) const {
    return std::system(fmt::format("cd {} && {}{} > /dev/null 2>&1", folder_.string(), as_, command).c_str()) == 0;
  }

  std::filesystem::path programs_;
  ScratchFolder scratch_;
  std::filesystem::path folder_ = scratch_.path();
  std::string owner_, as_;
};

}  // namespace telefab::test
