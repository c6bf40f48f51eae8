// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <telefab/base/secret.hpp>

#include "tls_words.hpp"

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
  if (!file)
    return fail(ErrorCode::NotFound,
                fmt::format("cannot read the revocation list {}: copy it from the authority's folder, or state with an "
                            "empty file no-revocation-list beside it that there is none",
                            path.string()));
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
                  fmt::format("the {} {} does not exist; `telefab certs` makes it", what, path.string()));
    return fail(ErrorCode::NotTrusted, fmt::format("cannot use the {} {}: {}", what, path.string(), error.message()));
  };
  context->use_certificate_chain_file(files.certificate.string(), error);
  if (auto good = check(files.certificate, "certificate"); !good) return tl::unexpected{good.error()};
  if (std::filesystem::exists(files.key))
    if (auto secret = check_is_secret(files.key); !secret) return tl::unexpected{secret.error()};
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
struct FreeJudgement {
  void operator()(X509_STORE_CTX* judgement) const { X509_STORE_CTX_free(judgement); }
};
struct FreeNames {
  void operator()(GENERAL_NAMES* names) const { GENERAL_NAMES_free(names); }
};

/// DNS names and IP addresses of its subjectAltName.
std::vector<std::string> names_of(X509* certificate) {
  const std::unique_ptr<GENERAL_NAMES, FreeNames> all{
      static_cast<GENERAL_NAMES*>(X509_get_ext_d2i(certificate, NID_subject_alt_name, nullptr, nullptr))};
  std::vector<std::string> names;
  for (int i = 0; all && i < sk_GENERAL_NAME_num(all.get()); ++i) {
    const GENERAL_NAME* each = sk_GENERAL_NAME_value(all.get(), i);
    if (each->type == GEN_DNS) {
      names.emplace_back(reinterpret_cast<const char*>(ASN1_STRING_get0_data(each->d.dNSName)),
                         static_cast<std::size_t>(ASN1_STRING_length(each->d.dNSName)));
    } else if (each->type == GEN_IPADD) {
      const unsigned char* bytes = ASN1_STRING_get0_data(each->d.iPAddress);
      const auto size = static_cast<std::size_t>(ASN1_STRING_length(each->d.iPAddress));
      if (boost::asio::ip::address_v4::bytes_type v4; size == v4.size()) {
        std::copy_n(bytes, size, v4.begin());
        names.push_back(boost::asio::ip::address_v4{v4}.to_string());
      } else if (boost::asio::ip::address_v6::bytes_type v6; size == v6.size()) {
        std::copy_n(bytes, size, v6.begin());
        names.push_back(boost::asio::ip::address_v6{v6}.to_string());
      }
    }
  }
  return names;
}

std::string pem_of(X509* certificate) {
  const std::unique_ptr<BIO, FreeBio> out{BIO_new(BIO_s_mem())};
  if (!out || PEM_write_bio_X509(out.get(), certificate) != 1) return {};
  char* text = nullptr;
  const long size = BIO_get_mem_data(out.get(), &text);
  return {text, static_cast<std::size_t>(size)};
}

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
  if (!std::filesystem::exists(files.revoked) && std::filesystem::exists(folder / "no-revocation-list"))
    files.revoked.clear();
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

Result<void> Trust::judge(const std::string& certificate_pem, Nanoseconds wall) {
  // Files that cannot be read now leave the old ones in force; who may listen says so at the next connection.
  (void)refresh();
  const std::unique_ptr<BIO, FreeBio> pem{
      BIO_new_mem_buf(certificate_pem.data(), static_cast<int>(certificate_pem.size()))};
  const std::unique_ptr<X509, FreeCertificate> certificate{pem ? PEM_read_bio_X509(pem.get(), nullptr, nullptr, nullptr)
                                                               : nullptr};
  const std::unique_ptr<X509_STORE_CTX, FreeJudgement> judgement{X509_STORE_CTX_new()};
  X509_STORE* store = SSL_CTX_get_cert_store(impl_->context->native_handle());
  if (!certificate || !judgement || X509_STORE_CTX_init(judgement.get(), store, certificate.get(), nullptr) != 1)
    return fail(ErrorCode::NotTrusted, "its certificate cannot be read");
  X509_STORE_CTX_set_time(judgement.get(), 0, std::chrono::duration_cast<std::chrono::seconds>(wall).count());
  if (X509_verify_cert(judgement.get()) == 1) return {};
  return fail(ErrorCode::NotTrusted,
              sentence_of(X509_STORE_CTX_get_error(judgement.get()), certificate.get(), End::Caller));
}

ssl_ctx_st* Trust::context() { return impl_->context->native_handle(); }

Result<Peer> peer_of(const ssl_st* stream, std::string address) {
  const std::unique_ptr<X509, FreeCertificate> certificate{SSL_get_peer_certificate(stream)};
  if (!certificate) return fail(ErrorCode::NotTrusted, "the other side showed no certificate");
  X509_NAME* subject = X509_get_subject_name(certificate.get());
  const std::string unit = entry_of(subject, NID_organizationalUnitName);
  const std::string name = entry_of(subject, NID_commonName);
  const auto role = role_from_name(unit);
  if (!role)
    return fail(ErrorCode::NotTrusted,
                fmt::format("the certificate of \"{}\" carries no role of Telefab, but \"{}\"", name, unit));
  return Peer{std::move(address), name, role, names_of(certificate.get()), pem_of(certificate.get())};
}

}  // namespace telefab::net
