// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <telefab/net/listener.hpp>
#include <telefab/net/port_holder.hpp>
#include <telefab/wire/message.hpp>

#include "loop_timer.hpp"
#include "stream_connection.hpp"
#include "tls_words.hpp"

namespace telefab::net {
namespace {

namespace asio = boost::asio;
namespace ssl = boost::asio::ssl;
using asio::ip::tcp;
using Code = boost::system::error_code;

std::string text_of(const tcp::socket& socket) {
  Code error;
  const auto end = socket.remote_endpoint(error);
  return error ? std::string{"unknown"} : to_text(Endpoint{end.address().to_string(), end.port()});
}

/// The host of "HOST:PORT" as a socket says it.
std::string host_of(const std::string& address) { return address.substr(0, address.rfind(':')); }

bool is_loopback_socket(const tcp::socket& socket) {
  Code error;
  const auto end = socket.remote_endpoint(error);
  return !error && end.address().is_loopback();
}

std::string plain_is_refused(const Endpoint& endpoint) {
  return fmt::format(
      "{} is not on loopback: plain TCP is refused there; give --tls FOLDER with a certificate of `telefab certs`",
      to_text(endpoint));
}

ConnectionPtr plain_connection(Loop& loop, tcp::socket socket, const ConnectionLimits& limits, End own_end) {
  Code ignored;  // without it the stream is slower, not wrong
  socket.set_option(tcp::no_delay{true}, ignored);
  Peer peer{text_of(socket), "local", {}};
  return std::make_shared<StreamConnection<tcp::socket>>(loop, std::move(socket), std::move(peer), limits,
                                                         std::shared_ptr<Trust>{}, own_end);
}

/// Shakes hands, then looks at the certificate. `done` is called once.
void shake_hands(Loop& loop, std::shared_ptr<Tls> stream, std::shared_ptr<ssl::context> context,
                 std::shared_ptr<Trust> trust, ssl::stream_base::handshake_type type, const ConnectionLimits& limits,
                 std::function<void(Result<ConnectionPtr>)> done) {
  Code ignored;
  stream->lowest_layer().set_option(tcp::no_delay{true}, ignored);
  const std::string address = text_of(stream->next_layer());
  auto timer = std::make_shared<LoopTimer>(loop);
  timer->start(limits.handshake_within, [stream] {
    Code closing;
    stream->lowest_layer().close(closing);
  });
  const End own_end = type == ssl::stream_base::client ? End::Caller : End::Called;
  const auto check = watch_check(*stream, own_end);
  stream->async_handshake(
      type, [&loop, stream, context, trust, timer, address, limits, done, check, own_end](const Code& error) {
        timer->cancel();
        if (error)
          return done(fail(ErrorCode::NotTrusted,
                           fmt::format("{}: TLS refused: {}", address, why_no_handshake(error, *check, own_end))));
        auto peer = peer_of(stream->native_handle(), address);
        if (!peer) return done(tl::unexpected{peer.error()});
        done(ConnectionPtr{std::make_shared<StreamConnection<Tls>>(loop, std::move(*stream), std::move(*peer), limits,
                                                                   trust, own_end)});
      });
}

}  // namespace

struct Listener::Impl : std::enable_shared_from_this<Listener::Impl> {
  Loop& loop;
  ListenOptions options;
  ListenEvents events;
  tcp::acceptor acceptor;
  LoopTimer breath;

  /// One that has not said who it is: a TLS handshake under way, or a connection before its hello.
  struct Pending {
    std::string host;
    std::weak_ptr<Tls> stream;
    std::weak_ptr<Connection> connection;

    [[nodiscard]] bool is_over() const {
      if (const auto made = connection.lock()) return made->is_ready();
      return stream.expired();
    }
    void end() const {
      if (const auto made = connection.lock())
        return made->drop({ErrorCode::Unreachable, "handshake-place: it gave way to a newer one"});
      Code ignored;
      if (const auto under_way = stream.lock()) under_way->lowest_layer().close(ignored);
    }
  };
  std::vector<Pending> pending;  ///< oldest first
  std::vector<std::weak_ptr<Connection>> connections;

  /// Refusals of one kind from one address that were not reported yet.
  struct Refusals {
    std::uint64_t count = 0;
    Error last;
  };
  static constexpr std::size_t kMostKinds = 256;                     ///< told apart; beyond, addresses are not
  std::map<std::pair<std::string, std::string>, Refusals> refusals;  ///< by host and reason
  LoopTimer report;

  Impl(Loop& with, const ListenOptions& given, ListenEvents with_events)
      : loop{with},
        options{given},
        events{std::move(with_events)},
        acceptor{with.impl().context},
        breath{with},
        report{with} {}

  void accept() {
    acceptor.async_accept([self = shared_from_this()](const Code& error, tcp::socket socket) {
      if (error == asio::error::operation_aborted || !self->acceptor.is_open()) return;
      if (error) return self->rest();
      self->on_socket(std::move(socket));
      self->accept();
    });
  }

  /// Out of file descriptors or memory: wait a little instead of spinning.
  void rest() {
    breath.start(std::chrono::milliseconds{100}, [self = shared_from_this()] {
      if (self->acceptor.is_open()) self->accept();
    });
  }

  /// Whoever floods us fills no log: what follows the first is counted.
  void refuse(const std::string& address, const Error& why) {
    // What differs from one to the next of a kind is the port.
    const std::string reason = why.what.starts_with(address + ": ") ? why.what.substr(address.size() + 2) : why.what;
    std::pair kind{host_of(address), reason};
    if (!refusals.contains(kind) && refusals.size() >= kMostKinds) kind = {"many addresses", "many reasons"};
    const auto [known, is_new] = refusals.try_emplace(kind);
    if (is_new) {
      events.refused(address, why);
      if (refusals.size() == 1) report_later();
      return;
    }
    ++known->second.count;
    known->second.last = why;
  }

  void report_later() {
    report.start(options.refusals_every, [self = shared_from_this()] {
      for (const auto& [kind, refused] : std::exchange(self->refusals, {}))
        if (refused.count > 0)
          self->events.refused(kind.first, {refused.last.code,
                                            fmt::format("{} times more, last: {}", refused.count, refused.last.what)});
    });
  }

  /// Room for one more that has not said who it is. Who does so in time is gone from here long before its turn to give
  /// way; of a flood, the flood's own oldest goes.
  void make_room() {
    std::erase_if(pending, [](const Pending& each) { return each.is_over(); });
    while (pending.size() >= options.max_handshakes) {
      std::map<std::string_view, std::size_t> counts;
      for (const Pending& each : pending) ++counts[each.host];
      const auto most = std::ranges::max_element(counts, {}, [](const auto& each) { return each.second; })->first;
      const auto oldest =
          std::ranges::find(pending, most, [](const Pending& each) { return std::string_view{each.host}; });
      const Pending gone = std::move(*oldest);
      pending.erase(oldest);
      gone.end();
    }
  }

  void on_socket(tcp::socket socket) {
    const std::string address = text_of(socket);
    if (!options.trust && !is_loopback_socket(socket))
      return refuse(address, {ErrorCode::NotPermitted, "plain TCP from another machine"});
    make_room();
    if (!options.trust) {
      pending.push_back({host_of(address), {}, {}});
      return hand_out(plain_connection(loop, std::move(socket), options.limits, End::Called), pending.back());
    }
    if (auto fresh = options.trust->refresh(); !fresh) refuse("certificates", fresh.error());
    auto context = options.trust->impl().context;
    auto stream = std::make_shared<Tls>(std::move(socket), *context);
    pending.push_back({host_of(address), stream, {}});
    shake_hands(loop, stream, context, options.trust, ssl::stream_base::server, options.limits,
                [self = shared_from_this(), address, stream = std::weak_ptr{stream}](Result<ConnectionPtr> made) {
                  const auto own = std::ranges::find_if(self->pending, [&](const Pending& each) {
                    return !each.stream.owner_before(stream) && !stream.owner_before(each.stream);
                  });
                  if (!made) {
                    if (own != self->pending.end()) self->pending.erase(own);
                    return self->refuse(address, made.error());
                  }
                  if (own != self->pending.end()) return self->hand_out(std::move(*made), *own);
                  Pending late{host_of(address), {}, {}};  // it gave way in this very moment
                  self->hand_out(std::move(*made), late);
                });
  }

  /// Whether one more of this role and address may stay. Operators have places that nobody else can take.
  [[nodiscard]] bool has_place(const Peer& peer) {
    std::erase_if(connections, [](const auto& each) { return each.expired(); });
    const auto is_operator = [](const Peer& who) { return !who.role || *who.role == Role::Operator; };
    std::size_t all = 0, operators = 0, others_there = 0;
    for (const auto& each : connections) {
      const auto made = each.lock();
      if (!made || !made->is_ready()) continue;
      ++all;
      if (is_operator(made->peer()))
        ++operators;
      else
        others_there += host_of(made->peer().address) == host_of(peer.address);
    }
    if (is_operator(peer)) return all < options.max_connections || operators < options.operator_places;
    return all - std::min(all, operators) <
               options.max_connections - std::min(options.max_connections, options.operator_places) &&
           all < options.max_connections && others_there < options.max_of_others;
  }

  void hand_out(ConnectionPtr connection, Pending& place) {
    place.connection = connection;
    if (!has_place(connection->peer())) {
      const Error busy{ErrorCode::TooLarge, "connection-limit: too many connections; try again later"};
      refuse(connection->peer().address, busy);
      connection->start({});
      return connection->close(to_frame(Fault{{}, busy, {}}));
    }
    connections.push_back(connection);
    events.accepted(std::move(connection));
  }
};

Listener::Listener(std::shared_ptr<Impl> impl) : impl_{std::move(impl)} {}

Listener::~Listener() {
  Code ignored;
  impl_->acceptor.close(ignored);
  impl_->breath.cancel();
  impl_->report.cancel();
  // Whoever serves a connection is held by its events and holds it: nobody else parts the two.
  for (const auto& each : impl_->connections)
    if (const auto open = each.lock()) open->close({});
}

void Listener::count_refusal(const std::string& address, const Error& why) { impl_->refuse(address, why); }

std::uint16_t Listener::port() const { return impl_->acceptor.local_endpoint().port(); }

Result<std::unique_ptr<Listener>> Listener::open(Loop& loop, const ListenOptions& options, ListenEvents events) {
  if (!options.trust && !is_loopback(options.endpoint))
    return fail(ErrorCode::NotTrusted, plain_is_refused(options.endpoint));
  auto impl = std::make_shared<Impl>(loop, options, std::move(events));
  Code error;
  const std::string host = options.endpoint.host == "localhost" ? "127.0.0.1" : options.endpoint.host;
  const auto address = asio::ip::make_address(host, error);
  if (error)
    return fail(ErrorCode::InvalidInput,
                fmt::format("cannot listen on {}: give an IP address", to_text(options.endpoint)));
  const tcp::endpoint end{address, options.endpoint.port};
  impl->acceptor.open(end.protocol(), error);
  if (!error) impl->acceptor.set_option(asio::socket_base::reuse_address{true}, error);
  if (!error) impl->acceptor.bind(end, error);
  if (!error) impl->acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error)
    return fail(
        error == asio::error::access_denied    ? ErrorCode::NotPermitted
        : error == asio::error::address_in_use ? ErrorCode::Conflict
                                               : ErrorCode::InvalidInput,
        fmt::format("cannot listen on {}: {}", to_text(options.endpoint),
                    error == asio::error::address_in_use  ? why_port_is_taken(options.endpoint.port)
                    : error == asio::error::access_denied ? "ports below 1024 are the system's; take a higher one"
                                                          : error.message()));
  impl->accept();
  return std::unique_ptr<Listener>{new Listener{std::move(impl)}};
}

namespace {

/// One try to connect; alive as long as an operation of it is under way.
class Attempt : public std::enable_shared_from_this<Attempt> {
 public:
  Attempt(Loop& loop, const ConnectOptions& options, std::function<void(Result<ConnectionPtr>)> done)
      : loop_{loop},
        options_{options},
        done_{std::move(done)},
        resolver_{loop.impl().context},
        socket_{loop.impl().context},
        timer_{loop} {}

  void begin() {
    timer_.start(options_.within,
                 [self = shared_from_this()] { self->finish(self->unreachable("no answer in time")); });
    resolver_.async_resolve(options_.endpoint.host, std::to_string(options_.endpoint.port),
                            [self = shared_from_this()](const Code& error, const tcp::resolver::results_type& found) {
                              if (!self->done_) return;
                              if (error) return self->finish(self->unreachable(error.message()));
                              self->connect(found);
                            });
  }

 private:
  tl::unexpected<Error> unreachable(std::string_view why) const {
    return fail(ErrorCode::Unreachable, fmt::format("cannot reach {}: {}", to_text(options_.endpoint), why));
  }

  tl::unexpected<Error> unreachable(const Code& error) const {
    return unreachable(error == asio::error::connection_refused
                           ? "nobody listens there; is the site running (`systemctl status telefab-scan telefab-fab` "
                             "on its machine), and is this its port?"
                           : error.message());
  }

  void connect(const tcp::resolver::results_type& found) {
    // Looked at before a byte leaves: without TLS nothing goes to another machine, whatever its name is.
    const bool stays_here = std::all_of(found.begin(), found.end(),
                                        [](const auto& each) { return each.endpoint().address().is_loopback(); });
    if (!options_.trust && !stays_here) return finish(fail(ErrorCode::NotTrusted, plain_is_refused(options_.endpoint)));
    asio::async_connect(socket_, found, [self = shared_from_this()](const Code& error, const tcp::endpoint&) {
      if (!self->done_) return;
      if (error) return self->finish(self->unreachable(error));
      self->connected();
    });
  }

  void connected() {
    if (!options_.trust) {
      return finish(plain_connection(loop_, std::move(socket_), options_.limits, End::Caller));
    }
    if (auto fresh = options_.trust->refresh(); !fresh) return finish(tl::unexpected{fresh.error()});
    auto context = options_.trust->impl().context;
    auto stream = std::make_shared<Tls>(std::move(socket_), *context);
    (void)SSL_set_tlsext_host_name(stream->native_handle(), options_.endpoint.host.c_str());
    shake_hands(
        loop_, stream, context, options_.trust, ssl::stream_base::client, options_.limits,
        [self = shared_from_this()](Result<ConnectionPtr> made) {
          if (!self->done_) return;
          if (made && self->options_.expected && (*made)->peer().role != self->options_.expected)
            made = fail(ErrorCode::NotTrusted,
                        fmt::format("{} shows the certificate of \"{}\", a {}, where a {} was expected",
                                    to_text(self->options_.endpoint), (*made)->peer().name,
                                    name_of(*(*made)->peer().role), name_of(*self->options_.expected)));
          if (made && self->options_.expected_name &&
              std::ranges::find((*made)->peer().names, *self->options_.expected_name) == (*made)->peer().names.end())
            made = fail(
                ErrorCode::NotTrusted,
                fmt::format("{} shows a certificate for {}, and {} was expected: name the one you mean "
                            "(--site-certificate), or have it issued again: telefab certs issue ... --host {}",
                            to_text(self->options_.endpoint),
                            (*made)->peer().names.empty() ? std::string{"no name"}
                                                          : fmt::format("{}", fmt::join((*made)->peer().names, ", ")),
                            *self->options_.expected_name, *self->options_.expected_name));
          self->finish(std::move(made));
        });
  }

  void finish(Result<ConnectionPtr> outcome) {
    const auto done = std::exchange(done_, {});
    timer_.cancel();
    resolver_.cancel();
    Code ignored;
    if (!outcome) socket_.close(ignored);
    if (done) done(std::move(outcome));
  }

  Loop& loop_;
  ConnectOptions options_;
  std::function<void(Result<ConnectionPtr>)> done_;
  tcp::resolver resolver_;
  tcp::socket socket_;
  LoopTimer timer_;
};

}  // namespace

void connect_to(Loop& loop, const ConnectOptions& options, std::function<void(Result<ConnectionPtr>)> done) {
  std::make_shared<Attempt>(loop, options, std::move(done))->begin();
}

}  // namespace telefab::net
