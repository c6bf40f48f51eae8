// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <memory>
#include <string>
#include <telefab/command_line/options.hpp>
#include <telefab/net/listener.hpp>
#include <telefab/service/disk_room.hpp>
#include <telefab/service/retention.hpp>
#include <telefab/service/state_hooks.hpp>

namespace telefab {

/// What both daemons take from the command line.
struct ServeOptions {
  std::string listen;
  std::string data;
  std::string machines;
  std::string tls_folder;
  std::string tls_name;
  std::string web;                     ///< HOST:PORT of the page and its API; empty: none
  std::vector<std::string> web_hosts;  ///< further names under which it may be asked for
  HookOptions hooks;
  std::string log_level = "info";
  std::uint64_t reserve_mib = 64;  ///< of the data folder's disk, kept for the books
  RetentionPolicy retention;
  // Not from the command line: what a test puts in place of the file system, and how long what it puts off waits.
  AskSpace ask_space;
  std::chrono::milliseconds retry_every{10'000};
};

/// An option for the HOST:PORT of a site or page; another text is an error of the command line.
Option add_address(VerbOptions& options, const std::string& name, std::string& into, const std::string& help);
/// The same, where an empty text is as good as no option: a settings file may leave it so.
Option add_address_or_none(VerbOptions& options, const std::string& name, std::string& into, const std::string& help);
/// Adds --listen, --data, --machines, --tls, --tls-name, --web, --hook, --webhook, --log-level, --reserve-mib,
/// --keep-days and --keep-gib; what `options` holds already is the default.
void declare_serve_options(VerbOptions& app, ServeOptions& options);

/// The certificates of --tls; empty where none is given. Fails as net::Trust::load.
[[nodiscard]] Result<std::shared_ptr<net::Trust>> trust_of(const ServeOptions& options);

/// Listens on --listen; what may not connect is noted as refused. Fails as net::endpoint_from_text and Listener::open.
[[nodiscard]] Result<std::unique_ptr<net::Listener>> open_listener(
    net::Loop& loop, const ServeOptions& options, std::shared_ptr<net::Trust> trust,
    std::function<void(const net::ConnectionPtr&)> on_connection,
    std::function<void(std::string_view who, std::string_view what)> note);

}  // namespace telefab
