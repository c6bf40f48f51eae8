// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/net/connection.hpp>
#include <telefab/net/endpoint.hpp>
#include <telefab/net/loop.hpp>

namespace telefab::net {

struct ListenOptions {
  Endpoint endpoint;
  std::shared_ptr<Trust> trust;  ///< empty: plain TCP, which is refused off loopback
  ConnectionLimits limits;
  std::size_t max_connections = 64;  ///< past their handshake
  std::size_t operator_places = 8;   ///< of these, which nobody but operators can take
  std::size_t max_of_others = 32;    ///< past their handshake, of one address and no operators
  std::size_t max_handshakes = 32;   ///< under way; the oldest of the address with the most gives way to a newer one
  Nanoseconds refusals_every = std::chrono::seconds{60};  ///< of the same kind and address, summed up in one report
};

struct ListenEvents {
  std::function<void(ConnectionPtr)> accepted;  ///< after the TLS handshake; call start() on it
  /// Why somebody did not come in: the first of a kind and address at once, the others of refusals_every as one.
  std::function<void(const std::string& address, const Error&)> refused;
};

/// Accepts connections. Destruction closes the port and what came in by it; of those connections no event comes then.
class Listener {
 public:
  /// Fails with InvalidInput (address), NotPermitted (plain TCP off loopback, low port), Conflict (port in use).
  [[nodiscard]] static Result<std::unique_ptr<Listener>> open(Loop& loop, const ListenOptions& options,
                                                              ListenEvents events);
  ~Listener();
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;
  [[nodiscard]] std::uint16_t port() const;
  /// Somebody who was handed out and is refused after all, such as for a bad hello: reported and counted as the others.
  void count_refusal(const std::string& address, const Error& why);

 private:
  struct Impl;
  explicit Listener(std::shared_ptr<Impl> impl);
  std::shared_ptr<Impl> impl_;
};

struct ConnectOptions {
  Endpoint endpoint;
  std::shared_ptr<Trust> trust;  ///< empty: plain TCP, which is refused off loopback
  std::optional<Role> expected;  ///< of the other side's certificate; looked at with TLS only
  ConnectionLimits limits;
  Nanoseconds within = std::chrono::seconds{10};
  /// A name that the other side's certificate must vouch for, so that no other member of the authority can stand in for
  /// it; nothing: any name. Looked at with TLS only.
  std::optional<std::string> expected_name = {};
};

/// Connects, and calls `done` once on the loop's thread: Unreachable, NotTrusted (certificate or role), NotPermitted
/// (plain TCP off loopback).
void connect_to(Loop& loop, const ConnectOptions& options, std::function<void(Result<ConnectionPtr>)> done);

}  // namespace telefab::net
