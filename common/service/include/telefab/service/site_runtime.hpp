// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <telefab/command_line/options.hpp>
#include <telefab/net/listener.hpp>
#include <telefab/service/state_hooks.hpp>

namespace telefab {

/// What both daemons are told on the command line.
struct ServeOptions {
  std::string listen;
  std::string data;
  std::string machines;
  std::string tls_folder;
  std::string tls_name;
  std::string web;  ///< HOST:PORT of the page and its API; empty: none
  HookOptions hooks;
  std::string log_level = "info";
};

/// Adds --listen, --data, --machines, --tls, --tls-name, --web, --hook, --webhook and --log-level; what `options` holds
/// already is the default.
void declare_serve_options(VerbOptions& app, ServeOptions& options);

/// The certificates of --tls; empty where none is given. Fails as net::Trust::load.
[[nodiscard]] Result<std::shared_ptr<net::Trust>> trust_of(const ServeOptions& options);

/// Listens on --listen; what may not connect is noted as refused. Fails as net::endpoint_from_text and Listener::open.
[[nodiscard]] Result<std::unique_ptr<net::Listener>> open_listener(
    net::Loop& loop, const ServeOptions& options, std::shared_ptr<net::Trust> trust,
    std::function<void(const net::ConnectionPtr&)> on_connection,
    std::function<void(std::string_view who, std::string_view what)> note);

/// A daemon's folder: jobs.sqlite, audit.log, port, incoming/ and jobs/ID/. Locked while the daemon lives, so that two
/// daemons never share one.
class DataFolder {
 public:
  /// Makes what is missing. Fails with NotPermitted, StorageFailed, Conflict (another daemon works there).
  [[nodiscard]] static Result<DataFolder> open(const std::filesystem::path& path);
  ~DataFolder();
  DataFolder(DataFolder&& other) noexcept;
  DataFolder& operator=(DataFolder&&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  [[nodiscard]] std::filesystem::path incoming() const { return path_ / "incoming"; }
  /// The folder of a job, which exists afterwards.
  [[nodiscard]] Result<std::filesystem::path> job(std::string_view id) const;
  /// Tells which port was bound: one line on standard output and the file `port`.
  [[nodiscard]] Result<void> announce_port(std::uint16_t port) const;

 private:
  DataFolder(std::filesystem::path path, int lock) : path_{std::move(path)}, lock_{lock} {}
  std::filesystem::path path_;
  int lock_ = -1;
};

/// Names the calling thread, as the site's README lists it; at most 15 bytes.
void set_thread_name(const char* name);

}  // namespace telefab
