// SPDX-License-Identifier: GPL-3.0-or-later
#include <utility>  // boost/asio/awaitable.hpp of Boost 1.74 forgets it
// Boost headers next.
#include <fmt/format.h>
#include <pthread.h>

#include <algorithm>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/ssl.hpp>
#include <cctype>
#include <map>
#include <optional>
#include <set>
#include <telefab/net/port_holder.hpp>
#include <telefab/web/web_server.hpp>
#include <thread>

#include "lower_case.hpp"

namespace telefab {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
using asio::ip::tcp;
using StreamText = std::shared_ptr<const std::string>;
using PlainStream = beast::tcp_stream;
using TlsStream = beast::ssl_stream<beast::tcp_stream>;

constexpr std::uint64_t kMaxBodyBytes = 64U << 10U;
constexpr std::uint64_t kLargestBody = 1U << 30U;
constexpr std::uint32_t kMaxHeaderBytes = 16U << 10U;
constexpr std::size_t kBufferBytes = 256U << 10U;
constexpr std::size_t kDiscardBytes = 64U << 10U;
constexpr auto kHandshakeTimeout = std::chrono::seconds{10};
constexpr auto kGoodbyeTimeout = std::chrono::seconds{2};
/// For what a client still sends that was refused by its head: closed at once, its answer could be lost to it.
constexpr auto kLingerTimeout = std::chrono::seconds{5};
constexpr auto kRequestTimeout = std::chrono::seconds{30};
constexpr auto kUploadTimeout = std::chrono::minutes{10};
constexpr auto kKeepAliveEvery = std::chrono::seconds{15};
constexpr auto kBreath = std::chrono::milliseconds{100};

std::string text_of(beast::string_view text) { return {text.data(), text.size()}; }

/// One client, whatever it speaks.
class Session {
 public:
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  virtual ~Session() = default;

  /// The newest text for a watcher. Where the one before is still on its way, this waits, and an older one that waits
  /// is forgotten.
  virtual void push(const StreamText& text) = 0;
  /// Whether it has not taken the text that is on its way in the time for it.
  [[nodiscard]] virtual bool is_stuck() const = 0;
  /// Whether who opened a stream may still watch.
  [[nodiscard]] virtual bool may_watch() = 0;
  virtual void leave() = 0;
  /// Where it comes from, without the port.
  [[nodiscard]] const std::string& host() const { return host_; }
  /// Its last request said who it is.
  [[nodiscard]] bool is_known() const { return is_known_; }

 protected:
  explicit Session(std::string host) : host_{std::move(host)} {}
  void set_known(bool is_known) { is_known_ = is_known; }

 private:
  std::string host_;
  bool is_known_ = false;
};

struct Shared {
  WebSite& site;
  std::string product;
  const Clock& clock;
  std::shared_ptr<net::Trust> trust;  ///< null: plain HTTP
  std::set<std::string> hosts;        ///< in lower case, without ports
  std::size_t max_connections;
  std::size_t max_streams;
  std::vector<Session*> sessions;  ///< oldest first
  std::set<Session*> streams;
  std::function<void()> stream_opened;

  void forget(Session* session) {
    std::erase(sessions, session);
    streams.erase(session);
  }

  /// Room for one more: of those who have not said who they are, the oldest of the host that holds the most goes.
  [[nodiscard]] bool make_room() {
    if (sessions.size() < max_connections) return true;
    std::map<std::string_view, std::size_t> counts;
    for (const Session* each : sessions)
      if (!each->is_known()) ++counts[each->host()];
    if (counts.empty()) return false;
    const auto most = std::ranges::max_element(counts, {}, [](const auto& each) { return each.second; })->first;
    (*std::ranges::find_if(sessions, [&](const Session* each) {
      return !each->is_known() && each->host() == most;
    }))->leave();
    return true;
  }

  void add_common_headers(http::fields& fields) const {
    fields.set(http::field::server, product);
    fields.set("Content-Security-Policy",
               "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'; base-uri 'none'; "
               "form-action 'none'; frame-ancestors 'none'");
    fields.set("X-Content-Type-Options", "nosniff");
    fields.set("X-Frame-Options", "DENY");
    fields.set("Referrer-Policy", "no-referrer");
    fields.set("Cross-Origin-Resource-Policy", "same-origin");
  }
};

/// Lives as long as an operation of it is under way.
template <class Stream>
class StreamSession final : public Session, public std::enable_shared_from_this<StreamSession<Stream>> {
  static constexpr bool kIsTls = std::is_same_v<Stream, TlsStream>;

 public:
  template <class... Arguments>
  StreamSession(const tcp::endpoint& peer, Shared& shared, Arguments&&... arguments)
      : Session{peer.address().to_string()},
        stream_{std::forward<Arguments>(arguments)...},
        shared_{shared},
        address_{fmt::format("{}:{}", host(), peer.port())} {
    shared_.sessions.push_back(this);
  }
  ~StreamSession() override { shared_.forget(this); }

  void begin() {
    if constexpr (kIsTls) {
      lowest().expires_after(kHandshakeTimeout);
      stream_.set_verify_mode(asio::ssl::verify_peer);  // a token lets in as well as a certificate
      stream_.async_handshake(asio::ssl::stream_base::server, [self = own()](beast::error_code error) {
        if (error) return;
        if (auto peer = net::peer_of(self->stream_.native_handle(), self->address_)) self->peer_ = std::move(*peer);
        self->read();
      });
    } else {
      read();
    }
  }

  void read() {
    parser_.emplace();
    parser_->body_limit(kLargestBody);  // until the head tells which limit counts
    parser_->header_limit(kMaxHeaderBytes);
    lowest().expires_after(kRequestTimeout);
    http::async_read_header(stream_, buffer_, *parser_, [self = own()](beast::error_code error, auto) {
      if (error) return self->refuse(error);
      self->read_body();
    });
  }

  void push(const StreamText& text) override {
    if (writing_) {
      waiting_ = text;
      return;
    }
    writing_ = text;
    writing_since_ = shared_.clock.now();
    lowest().expires_never();  // by the server's clock, see is_stuck()
    asio::async_write(stream_, asio::buffer(*writing_), [self = own()](beast::error_code error, auto) {
      self->writing_.reset();
      if (error) return self->leave();
      if (auto next = std::exchange(self->waiting_, nullptr)) self->push(next);
    });
  }

  bool is_stuck() const override { return writing_ && shared_.clock.now() - writing_since_ > kRequestTimeout; }
  bool may_watch() override { return certificate_holds() && shared_.site.admit(head_).has_value(); }

  void leave() override {
    shared_.forget(this);
    beast::error_code ignored;  // the peer may have gone first
    lowest().socket().close(ignored);
  }

 private:
  using Pointer = std::shared_ptr<StreamSession>;
  [[nodiscard]] Pointer own() { return this->shared_from_this(); }
  [[nodiscard]] beast::tcp_stream& lowest() { return beast::get_lowest_layer(stream_); }

  [[nodiscard]] bool certificate_holds() {
    return !peer_ || shared_.trust->judge(peer_->certificate_pem, shared_.clock.wall()).has_value();
  }

  [[nodiscard]] WebRequest request_of(const http::request<http::string_body>& message) const {
    WebRequest request;
    request.method = text_of(message.method_string());
    request.target = text_of(message.target());
    request.authorization = text_of(message[http::field::authorization]);
    request.content_type = text_of(message[http::field::content_type]);
    request.host = text_of(message[http::field::host]);
    request.origin = text_of(message[http::field::origin]);
    request.cookie = text_of(message[http::field::cookie]);
    request.overwrite = text_of(message["Overwrite"]);
    request.print_after_upload = text_of(message["Print-After-Upload"]);
    request.address = address_;
    request.is_encrypted = kIsTls;
    request.is_whole = false;
    if (const auto key = message["X-Api-Key"]; request.authorization.empty() && !key.empty())
      request.authorization = "Bearer " + text_of(key);
    // A site's certificate lets in a site, over the wire; at the page it opens nothing.
    if (peer_)
      request.certified = Visitor{peer_->name, peer_->role == net::Role::Operator   ? Access::Operators
                                               : peer_->role == net::Role::ReadOnly ? Access::Readers
                                                                                    : Access::Anybody};
    return request;
  }

  /// The head of a request has come: who sends it, and how much of a body is it to have?
  void read_body() {
    head_ = request_of(parser_->get());
    if (!certificate_holds())
      return send(web_problem(401, "not-trusted", "the certificate that was shown no longer holds"), false);
    const auto visitor = shared_.site.admit(head_);
    set_known(visitor && !visitor->name.empty());
    if (parser_->is_done()) return serve();
    const std::uint64_t most = std::max(shared_.site.most_body(head_), kMaxBodyBytes);
    if (most > kMaxBodyBytes) lowest().expires_after(kUploadTimeout);
    // A length that is stated and too large is refused before a byte of it is taken; chunks are counted.
    if (const auto stated = parser_->content_length(); stated && *stated > most) {
      // Who can still log in is told so, else the old login of a large upload would look like a large request.
      if (!visitor && !visitor.error().challenges.empty()) return send(visitor.error(), false);
      return refuse(http::error::body_limit);
    }
    parser_->body_limit(most);
    if (beast::iequals(parser_->get()[http::field::expect], "100-continue")) return go_on();
    read_rest();
  }

  void go_on() {
    static constexpr std::string_view kContinue = "HTTP/1.1 100 Continue\r\n\r\n";
    asio::async_write(stream_, asio::buffer(kContinue), [self = own()](beast::error_code error, auto) {
      if (!error) self->read_rest();
    });
  }

  void read_rest() {
    http::async_read(stream_, buffer_, *parser_, [self = own()](beast::error_code error, auto) {
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

  void serve() {
    if (!shared_.hosts.contains(host_name_of(head_.host)))
      return send(web_problem(421, "not-permitted",
                              "this page is not known under that name; --web-host NAME of the daemon adds one"),
                  false);
    WebRequest request = head_;
    request.is_whole = true;
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
    response_.set(http::field::cache_control, response.is_immutable ? "private, max-age=31536000, immutable"
                                              : response.cacheable  ? "private, max-age=3600"
                                                                    : "no-store");
    if (!response.location.empty()) response_.set(http::field::location, response.location);
    if (!response.cookie.empty()) response_.set(http::field::set_cookie, response.cookie);
    for (const std::string& challenge : response.challenges) response_.insert(http::field::www_authenticate, challenge);
    for (const auto& [name, value] : response.headers) response_.set(name, value);
    const std::size_t length = response.body.size();
    if (!head_only_) response_.body() = std::move(response.body);
    // No body, no length: RFC 9110, 8.6.
    if (response.status != 204) response_.content_length(length);
    response_.keep_alive(may_keep && keep_alive_);
    serializer_.emplace(response_);
    lowest().expires_after(kRequestTimeout);
    const auto written = [self = own()](beast::error_code error, std::size_t) {
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
    head_.is_whole = true;
    if (auto visitor = shared_.site.admit(head_); !visitor) return send(std::move(visitor.error()), true);
    head_.goes_on = true;
    if (shared_.streams.size() >= shared_.max_streams)
      return send(web_problem(503, "too-large", "too many watchers; try again later"), false);
    shared_.streams.insert(this);
    shared_.stream_opened();  // before the text is made: what changes from here on is told
    http::fields fields;
    shared_.add_common_headers(fields);
    std::string text =
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n";
    for (const auto& field : fields)
      text += fmt::format("{}: {}\r\n", text_of(field.name_string()), text_of(field.value()));
    text += "\r\nretry: 2000\n\ndata: " + shared_.site.event_data() + "\n\n";
    push(std::make_shared<const std::string>(std::move(text)));
    await_end();
  }

  /// A watcher says nothing more; whatever comes, the end most of all, ends the stream.
  void await_end() {
    lowest().socket().async_wait(tcp::socket::wait_read, [self = own()](beast::error_code) { self->leave(); });
  }

  void close() {
    if constexpr (kIsTls) {
      lowest().expires_after(kGoodbyeTimeout);
      stream_.async_shutdown([self = own()](beast::error_code) {});  // the peer may have gone first
    } else {
      beast::error_code ignored;  // likewise
      stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
      if (parser_ && !parser_->is_done()) {
        lowest().expires_after(kLingerTimeout);
        discard();
      }
    }
  }

  void discard() {
    buffer_.clear();
    stream_.async_read_some(buffer_.prepare(kDiscardBytes), [self = own()](beast::error_code error, std::size_t) {
      if (!error) self->discard();
    });
  }

  Stream stream_;
  Shared& shared_;
  std::string address_;
  std::optional<net::Peer> peer_;  ///< by its certificate
  WebRequest head_;                ///< of the request under way, without its body
  beast::flat_buffer buffer_{kBufferBytes};
  std::optional<http::request_parser<http::string_body>> parser_;
  http::response<http::string_body> response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;
  StreamText writing_;
  Nanoseconds writing_since_{};
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
  Nanoseconds sent_at{};
  Nanoseconds judged_at{};
  Nanoseconds look_every;
  Nanoseconds judge_every;
  std::jthread thread;

  Impl(const WebAddress& address, WebSite& site, std::string product, const Clock& clock)
      : shared{site, std::move(product), clock, address.trust, {}, address.max_connections, address.max_streams, {}, {},
               {}},
        look_every{address.look_every},
        judge_every{address.judge_every} {
    shared.hosts = {"localhost", "127.0.0.1", "[::1]",
                    address.host.find(':') == std::string::npos ? address.host : '[' + address.host + ']'};
    for (const std::string& name : address.names) shared.hosts.insert(lower(name));
    shared.stream_opened = [this] {
      if (std::exchange(is_ticking, true)) return;
      last_sent = shared.site.revision();
      sent_at = judged_at = shared.clock.now();
      wait();
    };
  }

  void accept() {
    acceptor.async_accept([this](beast::error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) return rest();
      // Above the limit the socket is closed unheard.
      if (shared.make_room()) take_in(std::move(socket));
      accept();
    });
  }

  void take_in(tcp::socket socket) {
    beast::error_code error;
    const tcp::endpoint peer = socket.remote_endpoint(error);
    if (error) return;  // it has gone already
    if (!shared.trust) return std::make_shared<StreamSession<PlainStream>>(peer, shared, std::move(socket))->begin();
    // Files that cannot be read now leave the old ones in force, as everywhere.
    (void)shared.trust->refresh();
    SSL_CTX_up_ref(shared.trust->context());
    asio::ssl::context context{shared.trust->context()};
    const auto session = std::make_shared<StreamSession<TlsStream>>(peer, shared, std::move(socket), context);
    session->begin();
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
    tick.expires_after(look_every);
    tick.async_wait([this](beast::error_code error) {
      if (error) return;
      let_go();
      is_ticking = !shared.streams.empty();
      if (!is_ticking) return;
      // Read first: what changes while the text is made is told next time.
      const std::uint64_t now = shared.site.revision();
      if (now != last_sent)
        send("data: " + shared.site.event_data() + "\n\n");
      else if (shared.clock.now() - sent_at >= kKeepAliveEvery)
        send(": still here\n\n");
      last_sent = now;
      wait();
    });
  }

  /// Ends the streams of those who take nothing, and of those whose token or certificate holds no longer.
  void let_go() {
    const bool is_judging = shared.clock.now() - judged_at >= judge_every;
    if (is_judging) judged_at = shared.clock.now();
    const auto watchers = shared.streams;
    for (Session* session : watchers)
      if (session->is_stuck() || (is_judging && !session->may_watch())) session->leave();
  }

  void send(std::string text) {
    sent_at = shared.clock.now();
    const auto shared_text = std::make_shared<const std::string>(std::move(text));
    const auto watchers = shared.streams;  // a push may end one
    for (Session* session : watchers) session->push(shared_text);
  }
};

Result<std::unique_ptr<WebServer>> WebServer::listen(const WebAddress& where, WebSite& site, const std::string& product,
                                                     const Clock& clock) {
  auto impl = std::make_unique<Impl>(where, site, product, clock);
  beast::error_code error;
  const auto address = asio::ip::make_address(where.host, error);
  if (error)
    return fail(
        ErrorCode::InvalidInput,
        fmt::format("web page: {} is not an address; use 127.0.0.1 or the address of one interface", where.host));
  const tcp::endpoint endpoint{address, where.port};
  impl->acceptor.open(endpoint.protocol(), error);
  if (!error) impl->acceptor.set_option(asio::socket_base::reuse_address{true}, error);
  if (!error) impl->acceptor.bind(endpoint, error);
  if (!error) impl->acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error)
    return fail(
        ErrorCode::Conflict,
        fmt::format("web page: cannot listen on {} port {}: {}", where.host, where.port,
                    error == asio::error::address_in_use ? net::why_port_is_taken(where.port) : error.message()));
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
