// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/x509v3.h>

#include "trust_impl.hpp"

namespace telefab::net {
namespace {

namespace ssl = boost::asio::ssl;

std::array<std::filesystem::file_time_type, 4> times_of(const TlsFiles& files) {
  std::array<std::filesystem::file_time_type, 4> times{};
  std::size_t at = 0;
  for (const auto* path : {&files.certificate, &files.key, &files.authority, &files.revoked}) {
    std::error_code ignored;  // a missing file keeps the zero time; loading it names it
    times[at++] = path->empty() ? std::filesystem::file_time_type{} : std::filesystem::last_write_time(*path, ignored);
  }
  return times;
}

struct FreeBio {
  void operator()(BIO* bio) const { BIO_free(bio); }
};
struct FreeCrl {
  void operator()(X509_CRL* crl) const { X509_CRL_free(crl); }
};

Result<void> add_revoked(ssl::context& context, const std::filesystem::path& path) {
  const std::unique_ptr<BIO, FreeBio> file{BIO_new_file(path.c_str(), "r")};
  if (!file) return fail(ErrorCode::NotFound, fmt::format("cannot read the revocation list {}", path.string()));
  const std::unique_ptr<X509_CRL, FreeCrl> list{PEM_read_bio_X509_CRL(file.get(), nullptr, nullptr, nullptr)};
  if (!list) return fail(ErrorCode::InvalidInput, fmt::format("{} is not a revocation list in PEM", path.string()));
  X509_STORE* store = SSL_CTX_get_cert_store(context.native_handle());
  X509_STORE_add_crl(store, list.get());
  X509_STORE_set_flags(store, X509_V_FLAG_CRL_CHECK | X509_V_FLAG_CRL_CHECK_ALL);
  return {};
}

Result<std::shared_ptr<ssl::context>> make_context(const TlsFiles& files) {
  auto context = std::make_shared<ssl::context>(ssl::context::tls);
  SSL_CTX* native = context->native_handle();
  SSL_CTX_set_min_proto_version(native, TLS1_3_VERSION);
  SSL_CTX_set_max_proto_version(native, TLS1_3_VERSION);
  // Every handshake shows and checks the certificate again; a revoked peer cannot come back on a ticket.
  SSL_CTX_set_session_cache_mode(native, SSL_SESS_CACHE_OFF);
  SSL_CTX_set_num_tickets(native, 0);
  context->set_verify_mode(ssl::verify_peer | ssl::verify_fail_if_no_peer_cert);
  boost::system::error_code error;
  const auto check = [&](const std::filesystem::path& path, std::string_view what) -> Result<void> {
    if (!error) return {};
    if (!std::filesystem::exists(path))
      return fail(ErrorCode::NotFound,
                  fmt::format("the {} {} does not exist; deploy/certs makes it", what, path.string()));
    return fail(ErrorCode::NotTrusted, fmt::format("cannot use the {} {}: {}", what, path.string(), error.message()));
  };
  context->use_certificate_chain_file(files.certificate.string(), error);
  if (auto good = check(files.certificate, "certificate"); !good) return tl::unexpected{good.error()};
  context->use_private_key_file(files.key.string(), ssl::context::pem, error);
  if (auto good = check(files.key, "private key"); !good) return tl::unexpected{good.error()};
  context->load_verify_file(files.authority.string(), error);
  if (auto good = check(files.authority, "authority"); !good) return tl::unexpected{good.error()};
  if (!files.revoked.empty())
    if (auto added = add_revoked(*context, files.revoked); !added) return tl::unexpected{added.error()};
  return context;
}

std::string entry_of(X509_NAME* name, int nid) {
  const int at = X509_NAME_get_index_by_NID(name, nid, -1);
  if (at < 0) return {};
  unsigned char* text = nullptr;
  const int size = ASN1_STRING_to_UTF8(&text, X509_NAME_ENTRY_get_data(X509_NAME_get_entry(name, at)));
  if (size < 0) return {};
  std::string entry{reinterpret_cast<const char*>(text), static_cast<std::size_t>(size)};
  OPENSSL_free(text);
  return entry;
}

struct FreeCertificate {
  void operator()(X509* certificate) const { X509_free(certificate); }
};

}  // namespace

std::string_view name_of(Role role) {
  switch (role) {
    case Role::Operator:
      return "operator";
    case Role::ScanSite:
      return "scan-site";
    case Role::FabSite:
      return "fab-site";
    case Role::ReadOnly:
      return "read-only";
  }
  return "read-only";
}

std::optional<Role> role_from_name(std::string_view name) {
  for (const Role role : {Role::Operator, Role::ScanSite, Role::FabSite, Role::ReadOnly})
    if (name_of(role) == name) return role;
  return {};
}

TlsFiles tls_files_in(const std::filesystem::path& folder, const std::string& name) {
  TlsFiles files{folder / (name + ".crt"), folder / (name + ".key"), folder / "authority.crt", folder / "revoked.crl"};
  if (!std::filesystem::exists(files.revoked)) files.revoked.clear();
  return files;
}

Trust::Trust(std::unique_ptr<Impl> impl) : impl_{std::move(impl)} {}
Trust::~Trust() = default;

Result<std::shared_ptr<Trust>> Trust::load(const TlsFiles& files) {
  auto impl = std::make_unique<Impl>();
  impl->files = files;
  impl->read_at = times_of(files);
  auto context = make_context(files);
  if (!context) return tl::unexpected{context.error()};
  impl->context = std::move(*context);
  return std::shared_ptr<Trust>{new Trust{std::move(impl)}};
}

Result<void> Trust::refresh() {
  const auto times = times_of(impl_->files);
  if (times == impl_->read_at) return {};
  auto context = make_context(impl_->files);
  if (!context) return tl::unexpected{context.error()};
  impl_->context = std::move(*context);
  impl_->read_at = times;
  return {};
}

Result<Peer> peer_of(Tls& stream, std::string address) {
  const std::unique_ptr<X509, FreeCertificate> certificate{SSL_get_peer_certificate(stream.native_handle())};
  if (!certificate) return fail(ErrorCode::NotTrusted, "the other side showed no certificate");
  X509_NAME* subject = X509_get_subject_name(certificate.get());
  const std::string unit = entry_of(subject, NID_organizationalUnitName);
  const std::string name = entry_of(subject, NID_commonName);
  const auto role = role_from_name(unit);
  if (!role)
    return fail(ErrorCode::NotTrusted,
                fmt::format("the certificate of \"{}\" carries no role of Telefab, but \"{}\"", name, unit));
  return Peer{std::move(address), name, role};
}

}  // namespace telefab::net
