// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <charconv>
#include <deque>
#include <functional>
#include <telefab/base/text.hpp>
#include <telefab/fab/lan/printer_network.hpp>

#include "beast.hpp"

namespace telefab::fab {
namespace {

tl::unexpected<Error> failed(ErrorCode code, std::string_view doing, const PrinterAddress& where,
                             const beast::error_code& error) {
  return fail(code, fmt::format("cannot {} {}: {}", doing, to_text(where), error.message()));
}
tl::unexpected<Error> late(std::string_view doing, const PrinterAddress& where, Nanoseconds timeout) {
  return fail(ErrorCode::DeviceTimeout, fmt::format("cannot {} {}: no answer within {:.1f} s", doing, to_text(where),
                                                    double(timeout.count()) * 1e-9));
}

/// Runs one asynchronous call to its end or to the deadline; what is late is cancelled by closing `socket`. Nothing: it
/// was late.
template <class Start>
std::optional<beast::error_code> run_bounded(asio::io_context& io, tcp::socket& socket, Nanoseconds timeout,
                                             const Start& start) {
  std::optional<beast::error_code> done;
  start([&done](beast::error_code error, auto&&...) { done = error; });
  io.restart();
  io.run_for(timeout);
  if (done) return done;
  beast::error_code ignored;
  socket.close(ignored);
  io.restart();
  io.run();  // the cancelled call lets go of its buffers
  return std::nullopt;
}

Result<std::vector<tcp::endpoint>> resolved(asio::io_context& io, const PrinterAddress& where) {
  beast::error_code error;
  tcp::resolver resolver{io};
  const auto found = resolver.resolve(where.host, std::to_string(where.port), error);
  if (error) return failed(ErrorCode::Unreachable, "find", where, error);
  std::vector<tcp::endpoint> endpoints;
  for (const auto& entry : found) endpoints.push_back(entry.endpoint());
  if (endpoints.empty()) return fail(ErrorCode::Unreachable, fmt::format("cannot find {}", to_text(where)));
  return endpoints;
}

Result<void> reach(asio::io_context& io, tcp::socket& socket, const PrinterAddress& where, Nanoseconds timeout) {
  const auto endpoints = resolved(io, where);
  if (!endpoints) return tl::unexpected{endpoints.error()};
  const auto done = run_bounded(io, socket, timeout,
                                [&](auto handler) { socket.async_connect(endpoints->front(), std::move(handler)); });
  if (!done) return late("connect to", where, timeout);
  if (*done) return failed(ErrorCode::Unreachable, "connect to", where, *done);
  beast::error_code ignored;  // small messages go out at once where the system lets them
  socket.set_option(tcp::no_delay{true}, ignored);
  return {};
}

class BeastSocket final : public MessageSocket {
 public:
  explicit BeastSocket(PrinterAddress where) : where_{std::move(where)} {}
  ~BeastSocket() override {
    close();
    io_.restart();
    io_.run();
  }
  Result<void> open(std::string_view path, Nanoseconds timeout) {
    if (auto ok = reach(io_, socket(), where_, timeout); !ok) return ok;
    stream_.read_message_max(kMostMessageBytes);
    const std::string host = to_text(where_), target{path};
    const auto done = run_bounded(io_, socket(), timeout,
                                  [&](auto handler) { stream_.async_handshake(host, target, std::move(handler)); });
    if (!done) return late("shake hands with", where_, timeout);
    if (*done == websocket::error::upgrade_declined)
      return fail(ErrorCode::DeviceRefused,
                  fmt::format("{} declines another connection; close other programs that watch it", to_text(where_)));
    if (*done) return failed(ErrorCode::DeviceLost, "shake hands with", where_, *done);
    return {};
  }
  Result<void> send(std::string_view text, Nanoseconds timeout) override {
    if (is_closed_) return closed();
    stream_.text(true);
    std::optional<beast::error_code> done;
    const std::string kept{text};
    stream_.async_write(asio::buffer(kept), [&done](beast::error_code error, std::size_t) { done = error; });
    io_.restart();
    run_until([&done] { return done.has_value(); }, timeout);  // a read that waits goes on meanwhile
    if (done && !*done) return {};
    const bool was_late = !done;
    close();
    io_.restart();
    while (!done && io_.run_one() > 0) {
    }
    return was_late ? Result<void>{late("send to", where_, timeout)}
                    : Result<void>{failed(ErrorCode::DeviceLost, "send to", where_, *done)};
  }
  Result<std::optional<std::string>> receive(Nanoseconds timeout) override {
    if (received_.empty() && !is_closed_) {
      if (!is_reading_) read();
      io_.restart();
      run_until([this] { return !received_.empty() || is_closed_; }, timeout);
    }
    if (!received_.empty()) {
      std::optional<std::string> first{std::move(received_.front())};
      received_.pop_front();
      return first;
    }
    if (broken_)
      return fail(ErrorCode::ProtocolBroken,
                  fmt::format("{} sent a message of more than {} bytes", to_text(where_), kMostMessageBytes));
    if (is_closed_) return closed();
    return std::optional<std::string>{};
  }

 private:
  tcp::socket& socket() { return beast::get_lowest_layer(stream_); }
  /// Handles what comes until it is done or that time is over.
  void run_until(const std::function<bool()>& is_done, Nanoseconds timeout) {
    bool is_late = false;
    asio::steady_timer deadline{io_, timeout};
    deadline.async_wait([&is_late](beast::error_code error) { is_late = !error; });
    while (!is_done() && !is_late && io_.run_one() > 0) {
    }
    deadline.cancel();
    while (io_.poll_one() > 0) {  // the timer's handler lets go of what stands here
    }
  }
  tl::unexpected<Error> closed() const {
    return fail(ErrorCode::DeviceLost, fmt::format("the connection to {} was closed", to_text(where_)));
  }
  void close() {
    is_closed_ = true;
    beast::error_code ignored;  // the peer may have gone first
    socket().close(ignored);
  }
  void read() {
    is_reading_ = true;
    stream_.async_read(buffer_, [this](beast::error_code error, std::size_t) {
      is_reading_ = false;
      if (error) {
        broken_ = error == websocket::error::message_too_big;
        return close();
      }
      received_.push_back(beast::buffers_to_string(buffer_.data()));
      buffer_.consume(buffer_.size());
      read();
    });
  }
  PrinterAddress where_;
  asio::io_context io_;
  websocket::stream<tcp::socket> stream_{io_};
  beast::flat_buffer buffer_;
  std::deque<std::string> received_;
  bool is_reading_ = false;
  bool is_closed_ = false;
  bool broken_ = false;
};

class BeastNetwork final : public PrinterNetwork {
 public:
  Result<std::vector<Datagram>> ask(std::string_view host, std::uint16_t port, std::string_view text,
                                    Nanoseconds wait) override {
    asio::io_context io;
    beast::error_code error;
    udp::socket socket{io};
    const auto refused = [&](std::string_view what) {
      return fail(ErrorCode::Unreachable, fmt::format("cannot {} on the local network: {}", what, error.message()));
    };
    if (socket.open(udp::v4(), error); error) return refused("open a socket");
    if (socket.set_option(asio::socket_base::broadcast{true}, error); error) return refused("broadcast");
    const std::string where{host.empty() ? "255.255.255.255" : host};
    udp::resolver resolver{io};
    const auto found = resolver.resolve(udp::v4(), where, std::to_string(port), error);
    if (error || found.empty()) return refused(fmt::format("find {}", where));
    if (socket.send_to(asio::buffer(text.data(), text.size()), found.begin()->endpoint(), 0, error); error)
      return refused(fmt::format("send to {}", where));
    std::vector<Datagram> all;
    std::array<char, 4096> bytes{};
    udp::endpoint from;
    std::function<void()> next = [&] {
      socket.async_receive_from(asio::buffer(bytes), from, [&](beast::error_code failure, std::size_t size) {
        if (failure == asio::error::operation_aborted) return;
        constexpr std::size_t kMostReplies = 1000;
        if (!failure && all.size() < kMostReplies)
          all.push_back({from.address().to_string(), std::string(bytes.data(), size)});
        // Of one printer one reply is all; of a broadcast nobody knows how many come.
        if (host.empty() || failure) next();
      });
    };
    next();
    io.run_for(wait);
    socket.close(error);
    io.restart();
    io.run();
    return all;
  }

  Result<std::unique_ptr<MessageSocket>> connect(const PrinterAddress& where, std::string_view path,
                                                 Nanoseconds timeout) override {
    auto socket = std::make_unique<BeastSocket>(where);
    if (auto ok = socket->open(path, timeout); !ok) return tl::unexpected{ok.error()};
    return socket;
  }

  Result<HttpReply> post(const PrinterAddress& where, std::string_view path, std::string_view content_type,
                         std::string body, Nanoseconds timeout) override {
    asio::io_context io;
    tcp::socket socket{io};
    if (auto ok = reach(io, socket, where, timeout); !ok) return tl::unexpected{ok.error()};
    http::request<http::string_body> request{http::verb::post, {path.data(), path.size()}, 11};
    request.set(http::field::host, to_text(where));
    request.set(http::field::content_type, beast::string_view{content_type.data(), content_type.size()});
    request.set(http::field::connection, "close");
    request.body() = std::move(body);
    request.prepare_payload();
    const auto sent =
        run_bounded(io, socket, timeout, [&](auto handler) { http::async_write(socket, request, std::move(handler)); });
    if (!sent) return late("send to", where, timeout);
    if (*sent) return failed(ErrorCode::DeviceLost, "send to", where, *sent);
    beast::flat_buffer buffer;
    http::response_parser<http::string_body> parser;
    parser.body_limit(kMostMessageBytes);
    const auto got = run_bounded(io, socket, timeout,
                                 [&](auto handler) { http::async_read(socket, buffer, parser, std::move(handler)); });
    if (!got) return late("read the reply of", where, timeout);
    if (*got) {
      const bool is_cut = *got == http::error::end_of_stream || *got == http::error::partial_message ||
                          *got == asio::error::connection_reset || *got == asio::error::eof;
      return failed(is_cut ? ErrorCode::DeviceLost : ErrorCode::ProtocolBroken, "read the reply of", where, *got);
    }
    return HttpReply{parser.get().result_int(), std::move(parser.get().body())};
  }
};

}  // namespace

Result<PrinterAddress> printer_address_from_text(std::string_view text, std::uint16_t port_otherwise) {
  PrinterAddress address{std::string{text}, port_otherwise};
  std::string_view port;
  if (text.starts_with('[')) {
    const auto end = text.find(']');
    if (end == std::string_view::npos)
      return fail(ErrorCode::InvalidInput, fmt::format("\"{}\" is not an address", to_printable(text)));
    address.host = text.substr(1, end - 1);
    port = text.substr(end + 1);
    if (port.starts_with(':')) port.remove_prefix(1);
  } else if (const auto colon = text.find(':'); colon != std::string_view::npos && text.rfind(':') == colon) {
    address.host = text.substr(0, colon);
    port = text.substr(colon + 1);
  }
  if (!port.empty()) {
    const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), address.port);
    if (error != std::errc{} || end != port.data() + port.size() || address.port == 0)
      return fail(ErrorCode::InvalidInput, fmt::format("\"{}\" is not a port from 1 to 65535", to_printable(port)));
  }
  if (address.host.empty() || address.host.find_first_of(" /\t\n") != std::string::npos || !is_printable(address.host))
    return fail(ErrorCode::InvalidInput,
                fmt::format("\"{}\" is not an address; give HOST or HOST:PORT", to_printable(text)));
  return address;
}

std::string to_text(const PrinterAddress& address) {
  const bool is_v6 = address.host.find(':') != std::string::npos;
  return is_v6 ? fmt::format("[{}]:{}", address.host, address.port) : fmt::format("{}:{}", address.host, address.port);
}

std::unique_ptr<PrinterNetwork> make_printer_network() { return std::make_unique<BeastNetwork>(); }

}  // namespace telefab::fab
