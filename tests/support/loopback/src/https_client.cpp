// SPDX-License-Identifier: GPL-3.0-or-later
#include <openssl/ssl.h>

#include <telefab/test/http_client.hpp>
#include <telefab/test/https_client.hpp>

namespace telefab::test {
namespace {

struct Free {
  void operator()(SSL_CTX* context) const { SSL_CTX_free(context); }
  void operator()(SSL* stream) const { SSL_free(stream); }
};

}  // namespace

struct HttpsClient::Impl {
  explicit Impl(std::uint16_t port) : socket{port}, context{SSL_CTX_new(TLS_client_method())} {}
  HttpClient socket;
  std::unique_ptr<SSL_CTX, Free> context;
  std::unique_ptr<SSL, Free> stream;
  bool connected = false;
};

HttpsClient::HttpsClient(std::uint16_t port, const std::filesystem::path& folder, const std::string& name)
    : impl_{std::make_unique<Impl>(port)} {
  if (!name.empty()) {
    SSL_CTX_use_certificate_chain_file(impl_->context.get(), (folder / (name + ".crt")).c_str());
    SSL_CTX_use_PrivateKey_file(impl_->context.get(), (folder / (name + ".key")).c_str(), SSL_FILETYPE_PEM);
  }
  impl_->stream.reset(SSL_new(impl_->context.get()));
  SSL_set_fd(impl_->stream.get(), impl_->socket.descriptor());
  impl_->connected = SSL_connect(impl_->stream.get()) == 1;
}

HttpsClient::~HttpsClient() = default;

bool HttpsClient::connected() const { return impl_->connected; }

void HttpsClient::send(std::string_view text) const {
  if (impl_->connected) (void)SSL_write(impl_->stream.get(), text.data(), static_cast<int>(text.size()));
}

std::string HttpsClient::read_until(std::string_view mark) const {
  std::string text;
  char buffer[4096];
  while (impl_->connected && (mark.empty() || text.find(mark) == std::string::npos)) {
    const int got = SSL_read(impl_->stream.get(), buffer, sizeof buffer);
    if (got <= 0) break;
    text.append(buffer, static_cast<std::size_t>(got));
  }
  return text;
}

std::string https_ask(const HttpsClient& client, const std::string& method, const std::string& target,
                      const std::string& head, const std::string& body) {
  client.send(http_request(method, target, head, body));
  return client.read_until("");
}

}  // namespace telefab::test
