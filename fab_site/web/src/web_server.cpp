#include <utility>  // boost/asio/awaitable.hpp of Boost 1.74 forgets it
// Boost headers next.
#include <fmt/format.h>
#include <pthread.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <optional>
#include <telefab/fab/web/web_server.hpp>
#include <thread>

namespace telefab::fab {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;

constexpr std::size_t kMaxConnections = 64;
constexpr std::size_t kMaxStreams = 56;  // leaves room for the page and for an operator's click
constexpr std::uint64_t kMaxBodyBytes = 64U << 10U;
constexpr std::uint32_t kMaxHeaderBytes = 16U << 10U;
constexpr auto kRequestTimeout = std::chrono::seconds{30};
constexpr auto kStreamTick = std::chrono::milliseconds{250};
constexpr int kTicksPerKeepAlive = 60;

struct Shared {
  JobDesk& desk;
  WebOptions options;
  std::size_t connections = 0;
  std::size_t streams = 0;
};

std::string text_of(beast::string_view text) { return {text.data(), text.size()}; }

void add_common_headers(http::fields& fields, const WebOptions& options) {
  fields.set(http::field::server, "telefab-fab/" + options.version);
  fields.set("Content-Security-Policy",
             "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'");
  fields.set("X-Content-Type-Options", "nosniff");
  fields.set("X-Frame-Options", "DENY");
  fields.set("Referrer-Policy", "no-referrer");
}

/// One client. Lives as long as an operation of it is under way.
class Session : public std::enable_shared_from_this<Session> {
 public:
  Session(tcp::socket socket, Shared& shared)
      : stream_{std::move(socket)}, tick_{stream_.get_executor()}, shared_{shared} {
    ++shared_.connections;
  }
  ~Session() {
    --shared_.connections;
    if (is_stream_) --shared_.streams;
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void read() {
    parser_.emplace();
    parser_->body_limit(kMaxBodyBytes);
    parser_->header_limit(kMaxHeaderBytes);
    stream_.expires_after(kRequestTimeout);
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (!error) return self->serve();
      if (error == http::error::body_limit || error == http::error::header_limit)
        self->send({413, "application/json", R"({"error":{"code":"too-large","what":"the request is too large"}})"},
                   false);
      else if (error != http::error::end_of_stream &&
               error.category() == http::make_error_code(http::error::bad_method).category())
        self->send({400, "application/json", R"({"error":{"code":"invalid-input","what":"this is no HTTP request"}})"},
                   false);
    });
  }

 private:
  void serve() {
    const auto& message = parser_->get();
    const std::string method = text_of(message.method_string());
    const std::string target = text_of(message.target());
    keep_alive_ = message.keep_alive();
    head_only_ = method == "HEAD";
    if (target == "/v1/stream" && method == "GET") return open_stream();
    std::string authorization = text_of(message[http::field::authorization]);
    if (const auto key = message["X-Api-Key"]; authorization.empty() && !key.empty())
      authorization = "Bearer " + text_of(key);
    send(answer({method, target, authorization}, shared_.desk, shared_.options), true);
  }

  void send(WebResponse response, bool may_keep) {
    response_ = {};
    response_.result(response.status);
    response_.version(11);
    add_common_headers(response_, shared_.options);
    response_.set(http::field::content_type, response.content_type);
    response_.set(http::field::cache_control, response.cacheable ? "max-age=3600" : "no-store");
    const std::size_t length = response.body.size();
    if (!head_only_) response_.body() = std::move(response.body);
    response_.content_length(length);
    response_.keep_alive(may_keep && keep_alive_);
    serializer_.emplace(response_);
    const auto written = [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error || !self->response_.keep_alive()) return self->close();
      self->read();
    };
    // A HEAD answer has the length of the body it does not carry.
    if (head_only_)
      http::async_write_header(stream_, *serializer_, written);
    else
      http::async_write(stream_, *serializer_, written);
  }

  void open_stream() {
    if (shared_.streams >= kMaxStreams)
      return send(
          {503, "application/json", R"({"error":{"code":"too-large","what":"too many watchers; try again later"}})"},
          false);
    is_stream_ = true;
    ++shared_.streams;
    http::fields fields;
    add_common_headers(fields, shared_.options);
    text_ = "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n";
    for (const auto& field : fields)
      text_ += fmt::format("{}: {}\r\n", text_of(field.name_string()), text_of(field.value()));
    text_ += "\r\nretry: 2000\n\n";
    push_state();
  }

  void push_state() {
    revision_ = shared_.desk.revision();
    text_ += "data: " + event_data(shared_.desk) + "\n\n";
    write_text();
  }

  void write_text() {
    stream_.expires_after(kRequestTimeout);
    asio::async_write(stream_, asio::buffer(text_), [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return;
      self->text_.clear();
      self->wait();
    });
  }

  void wait() {
    stream_.expires_never();
    tick_.expires_after(kStreamTick);
    tick_.async_wait([self = shared_from_this()](beast::error_code error) {
      if (error) return;
      if (self->shared_.desk.revision() != self->revision_) {
        self->idle_ticks_ = 0;
        return self->push_state();
      }
      if (++self->idle_ticks_ < kTicksPerKeepAlive) return self->wait();
      self->idle_ticks_ = 0;
      self->text_ = ": still here\n\n";
      self->write_text();
    });
  }

  void close() {
    beast::error_code ignored;  // the peer may have gone first
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
  }

  beast::tcp_stream stream_;
  asio::steady_timer tick_;
  Shared& shared_;
  beast::flat_buffer buffer_{kMaxHeaderBytes + kMaxBodyBytes};
  std::optional<http::request_parser<http::string_body>> parser_;
  http::response<http::string_body> response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;
  std::string text_;
  std::uint64_t revision_ = 0;
  int idle_ticks_ = 0;
  bool keep_alive_ = false;
  bool head_only_ = false;
  bool is_stream_ = false;
};

}  // namespace

struct WebServer::Impl {
  Shared shared;
  asio::io_context loop{1};
  tcp::acceptor acceptor{loop};
  std::jthread thread;

  Impl(JobDesk& desk, WebOptions options) : shared{desk, std::move(options)} {}

  void accept() {
    acceptor.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      // Above the limit the socket is closed unheard; out of descriptors, the next accept waits for one.
      if (!error && shared.connections < kMaxConnections) std::make_shared<Session>(std::move(socket), shared)->read();
      accept();
    });
  }
};

Result<std::unique_ptr<WebServer>> WebServer::listen(const std::string& host, std::uint16_t port, JobDesk& desk,
                                                     WebOptions options) {
  auto impl = std::make_unique<Impl>(desk, std::move(options));
  beast::error_code error;
  const auto address = asio::ip::make_address(host, error);
  if (error)
    return fail(ErrorCode::InvalidInput,
                fmt::format("web page: {} is no address; use 127.0.0.1 or the address of one interface", host));
  const tcp::endpoint endpoint{address, port};
  impl->acceptor.open(endpoint.protocol(), error);
  if (!error) impl->acceptor.set_option(asio::socket_base::reuse_address{true}, error);
  if (!error) impl->acceptor.bind(endpoint, error);
  if (!error) impl->acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error)
    return fail(ErrorCode::Conflict,
                fmt::format("web page: cannot listen on {} port {}: {}", host, port, error.message()));
  impl->accept();
  impl->thread = std::jthread{[loop = &impl->loop] {
    pthread_setname_np(pthread_self(), "web");
    loop->run();
  }};
  return std::unique_ptr<WebServer>{new WebServer{std::move(impl)}};
}

WebServer::WebServer(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}

WebServer::~WebServer() {
  impl_->loop.stop();
  impl_->thread.join();
}

std::uint16_t WebServer::port() const {
  beast::error_code error;
  return impl_->acceptor.local_endpoint(error).port();
}

}  // namespace telefab::fab
