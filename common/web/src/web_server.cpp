// SPDX-License-Identifier: GPL-3.0-or-later
#include <utility>  // boost/asio/awaitable.hpp of Boost 1.74 forgets it
// Boost headers next.
#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <cctype>
#include <optional>
#include <set>
#include <telefab/web/web_server.hpp>
#include <thread>

namespace telefab {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using StreamText = std::shared_ptr<const std::string>;

constexpr std::size_t kMaxConnections = 64;
constexpr std::size_t kMaxStreams = 56;  // leaves room for the page and for an operator's click
constexpr std::uint64_t kMaxBodyBytes = 64U << 10U;
constexpr std::uint64_t kLargestBody = 1U << 30U;
constexpr std::uint32_t kMaxHeaderBytes = 16U << 10U;
constexpr std::size_t kBufferBytes = 256U << 10U;
constexpr auto kRequestTimeout = std::chrono::seconds{30};
constexpr auto kUploadTimeout = std::chrono::minutes{10};
constexpr auto kStreamTick = std::chrono::milliseconds{250};
constexpr int kTicksPerKeepAlive = 60;
constexpr auto kBreath = std::chrono::milliseconds{100};

std::string text_of(beast::string_view text) { return {text.data(), text.size()}; }

class Session;

struct Shared {
  WebSite& site;
  std::string product;
  std::set<std::string> hosts;  ///< in lower case, without ports
  std::size_t connections = 0;
  std::set<Session*> streams;
  std::function<void()> stream_opened;

  void add_common_headers(http::fields& fields) const {
    fields.set(http::field::server, product);
    fields.set("Content-Security-Policy",
               "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'; base-uri 'none'; "
               "form-action 'none'; frame-ancestors 'none'");
    fields.set("X-Content-Type-Options", "nosniff");
    fields.set("X-Frame-Options", "DENY");
    fields.set("Referrer-Policy", "no-referrer");
  }
};

/// One client. Lives as long as an operation of it is under way.
class Session : public std::enable_shared_from_this<Session> {
 public:
  Session(tcp::socket socket, Shared& shared) : stream_{std::move(socket)}, shared_{shared} { ++shared_.connections; }
  ~Session() {
    --shared_.connections;
    shared_.streams.erase(this);
  }
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  void read() {
    parser_.emplace();
    parser_->body_limit(kLargestBody);  // until the head tells which limit counts
    parser_->header_limit(kMaxHeaderBytes);
    stream_.expires_after(kRequestTimeout);
    http::async_read_header(stream_, buffer_, *parser_, [self = shared_from_this()](beast::error_code error, auto) {
      if (error) return self->refuse(error);
      self->read_body();
    });
  }

  /// The newest text for a watcher. Where the one before is still on its way, this waits, and an older one that waits
  /// is forgotten.
  void push(const StreamText& text) {
    if (writing_) {
      waiting_ = text;
      return;
    }
    writing_ = text;
    stream_.expires_after(kRequestTimeout);
    asio::async_write(stream_, asio::buffer(*writing_), [self = shared_from_this()](beast::error_code error, auto) {
      self->writing_.reset();
      if (error) return self->leave();
      if (auto next = std::exchange(self->waiting_, nullptr)) self->push(next);
    });
  }

 private:
  [[nodiscard]] WebRequest request_of(const http::request<http::string_body>& message) const {
    WebRequest request{text_of(message.method_string()),
                       text_of(message.target()),
                       text_of(message[http::field::authorization]),
                       text_of(message[http::field::content_type]),
                       {}};
    if (const auto key = message["X-Api-Key"]; request.authorization.empty() && !key.empty())
      request.authorization = "Bearer " + text_of(key);
    return request;
  }

  void read_body() {
    if (parser_->is_done()) return serve();
    const WebRequest head = request_of(parser_->get());
    const std::uint64_t most = std::max(shared_.site.most_body(head), kMaxBodyBytes);
    if (most > kMaxBodyBytes) stream_.expires_after(kUploadTimeout);
    // A length that is stated and too large is refused before a byte of it is taken; chunks are counted.
    if (const auto stated = parser_->content_length(); stated && *stated > most) return refuse(http::error::body_limit);
    parser_->body_limit(most);
    if (beast::iequals(parser_->get()[http::field::expect], "100-continue")) return go_on();
    read_rest();
  }

  void go_on() {
    static constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
    asio::async_write(stream_, asio::buffer(kContinue), [self = shared_from_this()](beast::error_code error, auto) {
      if (!error) self->read_rest();
    });
  }

  void read_rest() {
    http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](beast::error_code error, auto) {
      if (error) return self->refuse(error);
      self->serve();
    });
  }

  void refuse(beast::error_code error) {
    if (error == http::error::body_limit || error == http::error::header_limit)
      send(web_problem(413, "too-large", "the request is too large"), false);
    else if (error != http::error::end_of_stream &&
             error.category() == http::make_error_code(http::error::bad_method).category())
      send(web_problem(400, "invalid-input", "this is not an HTTP request"), false);
  }

  /// The Host of the request in lower case, without its port.
  [[nodiscard]] std::string host() const {
    std::string text = text_of(parser_->get()[http::field::host]);
    const auto colon = text.rfind(':');
    if (colon != std::string::npos && text.find(']', colon) == std::string::npos) text.resize(colon);
    std::ranges::transform(text, text.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    return text;
  }

  void serve() {
    if (!shared_.hosts.contains(host()))
      return send(web_problem(421, "not-permitted",
                              "this page is not known under that name; --web-host NAME of the daemon adds one"),
                  false);
    WebRequest request = request_of(parser_->get());
    request.body = std::move(parser_->get().body());
    keep_alive_ = parser_->get().keep_alive();
    head_only_ = request.method == "HEAD";
    if (request.target == "/v1/stream" && request.method == "GET") return open_stream();
    send(shared_.site.answer(request), true);
  }

  void send(WebResponse response, bool may_keep) {
    response_ = {};
    response_.result(response.status);
    response_.version(11);
    shared_.add_common_headers(response_);
    response_.set(http::field::content_type, response.content_type);
    response_.set(http::field::cache_control, response.cacheable ? "max-age=3600" : "no-store");
    if (!response.location.empty()) response_.set(http::field::location, response.location);
    const std::size_t length = response.body.size();
    if (!head_only_) response_.body() = std::move(response.body);
    // No body, no length: RFC 9110, 8.6.
    if (response.status != 204) response_.content_length(length);
    response_.keep_alive(may_keep && keep_alive_);
    serializer_.emplace(response_);
    stream_.expires_after(kRequestTimeout);
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
    if (shared_.streams.size() >= kMaxStreams)
      return send(web_problem(503, "too-large", "too many watchers; try again later"), false);
    shared_.streams.insert(this);
    http::fields fields;
    shared_.add_common_headers(fields);
    std::string text =
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n";
    for (const auto& field : fields)
      text += fmt::format("{}: {}\r\n", text_of(field.name_string()), text_of(field.value()));
    text += "\r\nretry: 2000\n\ndata: " + shared_.site.event_data() + "\n\n";
    push(std::make_shared<const std::string>(std::move(text)));
    await_end();
    shared_.stream_opened();
  }

  /// A watcher says nothing more; whatever comes, the end most of all, ends the stream.
  void await_end() {
    stream_.socket().async_wait(tcp::socket::wait_read,
                                [self = shared_from_this()](beast::error_code) { self->leave(); });
  }

  void leave() {
    shared_.streams.erase(this);
    beast::error_code ignored;  // the peer may have gone first
    stream_.socket().close(ignored);
  }

  void close() {
    beast::error_code ignored;  // the peer may have gone first
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
  }

  beast::tcp_stream stream_;
  Shared& shared_;
  beast::flat_buffer buffer_{kBufferBytes};
  std::optional<http::request_parser<http::string_body>> parser_;
  http::response<http::string_body> response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;
  StreamText writing_;
  StreamText waiting_;
  bool keep_alive_ = false;
  bool head_only_ = false;
};

}  // namespace

struct WebServer::Impl {
  Shared shared;
  asio::io_context loop{1};
  tcp::acceptor acceptor{loop};
  asio::steady_timer tick{loop};
  asio::steady_timer breath{loop};
  bool is_ticking = false;
  std::uint64_t last_sent = 0;
  int idle_ticks = 0;
  std::jthread thread;

  Impl(WebSite& site, std::string product) : shared{site, std::move(product), {}, 0, {}, {}} {
    shared.stream_opened = [this] {
      if (std::exchange(is_ticking, true)) return;
      last_sent = shared.site.revision();
      wait();
    };
  }

  void accept() {
    acceptor.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) return rest();
      // Above the limit the socket is closed unheard.
      if (shared.connections < kMaxConnections) std::make_shared<Session>(std::move(socket), shared)->read();
      accept();
    });
  }

  /// Out of file descriptors or memory: the next accept fails at once, so wait a little instead of spinning.
  void rest() {
    breath.expires_after(kBreath);
    breath.async_wait([this](beast::error_code error) {
      if (!error) accept();
    });
  }

  /// Looks for news as long as anybody watches.
  void wait() {
    tick.expires_after(kStreamTick);
    tick.async_wait([this](beast::error_code error) {
      if (error) return;
      is_ticking = !shared.streams.empty();
      if (!is_ticking) return;
      // Read first: what changes while the text is made is told next time.
      const std::uint64_t now = shared.site.revision();
      if (now != last_sent)
        send("data: " + shared.site.event_data() + "\n\n");
      else if (++idle_ticks >= kTicksPerKeepAlive)
        send(": still here\n\n");
      last_sent = now;
      wait();
    });
  }

  void send(std::string text) {
    idle_ticks = 0;
    const auto shared_text = std::make_shared<const std::string>(std::move(text));
    const auto watchers = shared.streams;  // a push may end one
    for (Session* session : watchers) session->push(shared_text);
  }
};

Result<std::unique_ptr<WebServer>> WebServer::listen(const std::string& host, std::uint16_t port, WebSite& site,
                                                     const std::string& product,
                                                     const std::vector<std::string>& names) {
  auto impl = std::make_unique<Impl>(site, product);
  impl->shared.hosts = {"localhost", "127.0.0.1", "[::1]",
                        host.find(':') == std::string::npos ? host : '[' + host + ']'};
  for (std::string name : names) {
    std::ranges::transform(name, name.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    impl->shared.hosts.insert(std::move(name));
  }
  beast::error_code error;
  const auto address = asio::ip::make_address(host, error);
  if (error)
    return fail(ErrorCode::InvalidInput,
                fmt::format("web page: {} is not an address; use 127.0.0.1 or the address of one interface", host));
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

}  // namespace telefab
