// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <array>
#include <deque>
#include <set>
#include <telefab/fab/lan/printer_server.hpp>

#include "beast.hpp"

namespace telefab::fab {
namespace {

constexpr std::size_t kMostPostBytes = 4U << 20U;
constexpr auto kTick = std::chrono::milliseconds{20};

class Server;

/// One connection: a request, which either becomes a WebSocket or gets one reply.
class Client : public std::enable_shared_from_this<Client> {
 public:
  Client(tcp::socket socket, Server& server) : stream_{std::move(socket)}, server_{server} {}
  void start() {
    parser_.body_limit(kMostPostBytes);
    http::async_read(stream_.next_layer(), buffer_, parser_,
                     [self = shared_from_this()](beast::error_code error, auto) {
                       if (!error) self->on_request();
                     });
  }
  void push(const std::string& text) {
    if (!is_open_) return;
    unsent_.push_back(text);
    if (unsent_.size() == 1) write();
  }
  void close() {
    is_open_ = false;
    beast::error_code ignored;  // the peer may have gone first
    stream_.next_layer().close(ignored);
  }
  [[nodiscard]] bool is_open() const { return is_open_; }

 private:
  void on_request();
  void on_post();
  void read();
  void write() {
    stream_.text(true);
    stream_.async_write(asio::buffer(unsent_.front()), [self = shared_from_this()](beast::error_code error, auto) {
      if (error) return self->close();
      self->unsent_.pop_front();
      if (!self->unsent_.empty())
        self->write();
      else if (self->hangs_up_)
        self->close();
    });
  }
  websocket::stream<tcp::socket> stream_;
  Server& server_;
  beast::flat_buffer buffer_;
  http::request_parser<http::string_body> parser_;
  http::response<http::string_body> reply_;
  std::deque<std::string> unsent_;
  bool is_open_ = false;
  bool hangs_up_ = false;
};

class Server {
 public:
  Server(PrinterPeer& with, std::stop_token stop) : peer{with}, stop_{std::move(stop)} {}

  Result<PrinterServerPorts> listen(const PrinterServerPorts& ports) {
    beast::error_code error;
    const auto address = asio::ip::make_address(ports.address, error);
    if (error) return fail(ErrorCode::InvalidInput, fmt::format("{} is not an IP address", ports.address));
    const tcp::endpoint at{address, ports.port};
    acceptor_.open(at.protocol(), error);
    if (!error) acceptor_.set_option(asio::socket_base::reuse_address{true}, error);
    if (!error) acceptor_.bind(at, error);
    if (!error) acceptor_.listen(asio::socket_base::max_listen_connections, error);
    const udp::endpoint udp_at{address, ports.udp_port};
    if (!error) udp_.open(udp_at.protocol(), error);
    if (!error) udp_.set_option(asio::socket_base::reuse_address{true}, error);
    if (!error) udp_.bind(udp_at, error);
    if (error)
      return fail(ErrorCode::Unreachable, fmt::format("cannot listen at {} (ports {} and {}): {}", ports.address,
                                                      ports.port, ports.udp_port, error.message()));
    return PrinterServerPorts{ports.address, acceptor_.local_endpoint(error).port(), udp_.local_endpoint(error).port()};
  }
  void run() {
    accept();
    receive();
    tick();
    io_.run();
  }
  [[nodiscard]] std::size_t open_clients() {
    std::erase_if(clients_, [](const auto& c) { return !c->is_open(); });
    return clients_.size();
  }
  void add(std::shared_ptr<Client> client) { clients_.insert(std::move(client)); }

  PrinterPeer& peer;

 private:
  void accept() {
    acceptor_.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (!error) std::make_shared<Client>(std::move(socket), *this)->start();
      accept();
    });
  }
  void receive() {
    udp_.async_receive_from(asio::buffer(bytes_), from_, [this](beast::error_code error, std::size_t size) {
      if (error == asio::error::operation_aborted) return;
      if (!error)
        if (const auto reply = peer.on_datagram({bytes_.data(), size})) {
          beast::error_code ignored;  // whoever asked may be gone
          udp_.send_to(asio::buffer(*reply), from_, 0, ignored);
        }
      receive();
    });
  }
  void tick() {
    if (stop_.stop_requested()) {
      beast::error_code ignored;  // all of it ends here
      acceptor_.close(ignored);
      udp_.close(ignored);
      for (const auto& client : clients_) client->close();
      io_.stop();
      return;
    }
    for (const std::string& text : peer.pushed())
      for (const auto& client : clients_) client->push(text);
    timer_.expires_after(kTick);
    timer_.async_wait([this](beast::error_code) { tick(); });
  }
  std::stop_token stop_;
  asio::io_context io_;
  tcp::acceptor acceptor_{io_};
  udp::socket udp_{io_};
  asio::steady_timer timer_{io_};
  std::array<char, 4096> bytes_{};
  udp::endpoint from_;
  std::set<std::shared_ptr<Client>> clients_;
};

void Client::on_request() {
  const auto& request = parser_.get();
  if (!websocket::is_upgrade(request)) return on_post();
  if (request.target() != "/websocket" || !server_.peer.lets_in(server_.open_clients())) {
    reply_ = {http::status::service_unavailable, request.version()};
    reply_.prepare_payload();
    http::async_write(stream_.next_layer(), reply_,
                      [self = shared_from_this()](beast::error_code, auto) { self->close(); });
    return;
  }
  stream_.read_message_max(kMostMessageBytes);
  stream_.async_accept(parser_.get(), [self = shared_from_this()](beast::error_code error) {
    if (error) return;
    self->is_open_ = true;
    self->buffer_.consume(self->buffer_.size());
    self->server_.add(self);
    self->read();
  });
}

void Client::on_post() {
  const auto& request = parser_.get();
  const auto type = request[http::field::content_type];
  const auto reply = request.method() == http::verb::post
                         ? server_.peer.on_post({request.target().data(), request.target().size()},
                                                {type.data(), type.size()}, request.body())
                         : std::optional<HttpReply>{HttpReply{405, ""}};
  if (!reply) return close();
  reply_ = {http::int_to_status(reply->status), request.version()};
  reply_.set(http::field::content_type, "application/json");
  reply_.keep_alive(false);
  reply_.body() = reply->body;
  reply_.prepare_payload();
  http::async_write(stream_.next_layer(), reply_, [self = shared_from_this()](beast::error_code, auto) {
    beast::error_code ignored;  // the peer may have gone first
    self->stream_.next_layer().shutdown(tcp::socket::shutdown_send, ignored);
  });
}

void Client::read() {
  stream_.async_read(buffer_, [self = shared_from_this()](beast::error_code error, auto) {
    if (error) return self->close();
    const std::string text = beast::buffers_to_string(self->buffer_.data());
    self->buffer_.consume(self->buffer_.size());
    const PeerAnswer answer = self->server_.peer.on_message(text);
    self->hangs_up_ = answer.hangs_up;
    for (const std::string& message : answer.messages) self->push(message);
    if (answer.hangs_up && answer.messages.empty()) return self->close();
    self->read();
  });
}

}  // namespace

Result<void> serve_printer(PrinterPeer& peer, const PrinterServerPorts& ports,
                           const std::function<void(const PrinterServerPorts&)>& on_ready, std::stop_token stop) {
  Server server{peer, std::move(stop)};
  const auto taken = server.listen(ports);
  if (!taken) return tl::unexpected{taken.error()};
  on_ready(*taken);
  server.run();
  return {};
}

}  // namespace telefab::fab
