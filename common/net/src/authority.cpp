// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <openssl/ec.h>
#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>

#include <algorithm>
#include <array>
#include <boost/asio/ip/address.hpp>
#include <memory>
#include <telefab/base/file.hpp>
#include <telefab/base/person_name.hpp>
#include <telefab/base/secret.hpp>
#include <telefab/base/signature.hpp>
#include <telefab/net/authority.hpp>

namespace telefab::net {
namespace {

namespace fs = std::filesystem;

struct Free {
  void operator()(BIO* p) const { BIO_free(p); }
  void operator()(EVP_PKEY* p) const { EVP_PKEY_free(p); }
  void operator()(X509* p) const { X509_free(p); }
  void operator()(X509_CRL* p) const { X509_CRL_free(p); }
  void operator()(X509_REVOKED* p) const { X509_REVOKED_free(p); }
  void operator()(X509_EXTENSION* p) const { X509_EXTENSION_free(p); }
  void operator()(ASN1_STRING* p) const { ASN1_STRING_free(p); }  // times and integers are such
  void operator()(BIGNUM* p) const { BN_free(p); }
};
template <class T>
using Own = std::unique_ptr<T, Free>;

constexpr std::uint64_t kLargestPem = 16U << 20U;
constexpr auto kAuthorityLasts = std::chrono::hours{24 * 3650};
constexpr auto kClocksDiffer = std::chrono::minutes{1};

tl::unexpected<Error> no(std::string_view what) {
  std::array<char, 256> why{};
  ERR_error_string_n(ERR_get_error(), why.data(), why.size());
  return fail(ErrorCode::Internal, fmt::format("cannot {}: {}", what, why.data()));
}

Own<ASN1_TIME> time_at(Nanoseconds wall) {
  return Own<ASN1_TIME>{ASN1_TIME_set(nullptr, std::chrono::duration_cast<std::chrono::seconds>(wall).count())};
}

template <class Write>
Result<std::string> pem_of(Write write) {
  const Own<BIO> out{BIO_new(BIO_s_mem())};
  if (!out || write(out.get()) != 1) return no("write PEM");
  char* text = nullptr;
  const long size = BIO_get_mem_data(out.get(), &text);
  return std::string{text, static_cast<std::size_t>(size)};
}

Result<Own<BIO>> read_pem(const fs::path& path) {
  const auto bytes = read_file(path, kLargestPem);
  if (!bytes) return tl::unexpected{bytes.error()};
  Own<BIO> in{BIO_new(BIO_s_mem())};
  if (!in || BIO_write(in.get(), bytes->data(), static_cast<int>(bytes->size())) < 0) return no("read PEM");
  return in;
}

struct Authority {
  Own<X509> certificate;
  Own<EVP_PKEY> key;
};

Result<Authority> open_authority(const fs::path& folder) {
  if (!fs::exists(folder / "authority.key"))
    return fail(ErrorCode::NotFound, fmt::format("no authority in {}; make one first: telefab certs authority --dir {}",
                                                 folder.string(), folder.string()));
  if (const auto secret = check_is_secret(folder / "authority.key"); !secret) return tl::unexpected{secret.error()};
  const auto certificate = read_pem(folder / "authority.crt");
  if (!certificate) return tl::unexpected{certificate.error()};
  const auto key = read_pem(folder / "authority.key");
  if (!key) return tl::unexpected{key.error()};
  Authority authority{Own<X509>{PEM_read_bio_X509(certificate->get(), nullptr, nullptr, nullptr)},
                      Own<EVP_PKEY>{PEM_read_bio_PrivateKey(key->get(), nullptr, nullptr, nullptr)}};
  if (!authority.certificate || !authority.key ||
      X509_check_private_key(authority.certificate.get(), authority.key.get()) != 1)
    return no(fmt::format("use the authority in {}", folder.string()));
  return authority;
}

Result<void> add_extension(X509* to, X509* issuer, int nid, const std::string& value) {
  X509V3_CTX context{};
  X509V3_set_ctx(&context, issuer, to, nullptr, nullptr, 0);
  const Own<X509_EXTENSION> extension{X509V3_EXT_conf_nid(nullptr, &context, nid, value.c_str())};
  if (!extension || X509_add_ext(to, extension.get(), -1) != 1) return no("make a certificate");
  return {};
}

Result<Own<X509>> new_certificate(std::string_view unit, std::string_view name, EVP_PKEY* key, Nanoseconds from,
                                  Nanoseconds until) {
  Own<X509> made{X509_new()};
  const Own<BIGNUM> serial{BN_new()};
  constexpr int kSerialBits = 127;  // random, so that no list has to be kept
  if (!made || !serial || BN_rand(serial.get(), kSerialBits, BN_RAND_TOP_ONE, BN_RAND_BOTTOM_ANY) != 1 ||
      BN_to_ASN1_INTEGER(serial.get(), X509_get_serialNumber(made.get())) == nullptr)
    return no("make a certificate");
  X509_NAME* subject = X509_get_subject_name(made.get());
  const auto add = [&](const char* field, std::string_view text) {
    return X509_NAME_add_entry_by_txt(subject, field, MBSTRING_UTF8,
                                      reinterpret_cast<const unsigned char*>(text.data()),
                                      static_cast<int>(text.size()), -1, 0) == 1;
  };
  constexpr long kVersion3 = 2;
  if (X509_set_version(made.get(), kVersion3) != 1 || !add("OU", unit) || !add("CN", name) ||
      X509_set1_notBefore(made.get(), time_at(from).get()) != 1 ||
      X509_set1_notAfter(made.get(), time_at(until).get()) != 1 || X509_set_pubkey(made.get(), key) != 1)
    return no("make a certificate");
  return made;
}

Result<void> write_key(const fs::path& path, EVP_PKEY* key) {
  const auto pem =
      pem_of([&](BIO* out) { return PEM_write_bio_PrivateKey(out, key, nullptr, nullptr, 0, nullptr, nullptr); });
  if (!pem) return tl::unexpected{pem.error()};
  std::error_code ignored;  // write_new_secret says what is in the way
  fs::remove(path, ignored);
  return write_new_secret(path, *pem);
}

Result<void> write_certificate(const fs::path& path, X509* certificate) {
  const auto pem = pem_of([&](BIO* out) { return PEM_write_bio_X509(out, certificate); });
  if (!pem) return tl::unexpected{pem.error()};
  return write_file_atomically(path, *pem);
}

/// Signs the list for ten years from now and puts it in place, with the next number.
Result<void> write_list(const fs::path& folder, const Authority& authority, X509_CRL* list, const Clock& clock) {
  const Own<ASN1_INTEGER> before{
      static_cast<ASN1_INTEGER*>(X509_CRL_get_ext_d2i(list, NID_crl_number, nullptr, nullptr))};
  const Own<ASN1_INTEGER> number{ASN1_INTEGER_new()};
  const long next = before ? ASN1_INTEGER_get(before.get()) + 1 : 1;
  const Nanoseconds now = clock.wall();
  constexpr long kVersion2 = 1;
  if (!number || ASN1_INTEGER_set(number.get(), next) != 1 || X509_CRL_set_version(list, kVersion2) != 1 ||
      X509_CRL_set_issuer_name(list, X509_get_subject_name(authority.certificate.get())) != 1 ||
      X509_CRL_set1_lastUpdate(list, time_at(now - kClocksDiffer).get()) != 1 ||
      X509_CRL_set1_nextUpdate(list, time_at(now + kAuthorityLasts).get()) != 1 ||
      X509_CRL_add1_ext_i2d(list, NID_crl_number, number.get(), 0, X509V3_ADD_REPLACE) != 1 ||
      X509_CRL_sort(list) != 1 || X509_CRL_sign(list, authority.key.get(), EVP_sha256()) == 0)
    return no("sign the list of revoked certificates");
  const auto pem = pem_of([&](BIO* out) { return PEM_write_bio_X509_CRL(out, list); });
  if (!pem) return tl::unexpected{pem.error()};
  return write_file_atomically(folder / "revoked.crl", *pem);
}

constexpr std::size_t kLongestName = 63;

bool is_name(std::string_view name) { return is_person_name(name, "-", kLongestName); }

/// Of these alone a name may stand among the DNS names of a certificate.
bool is_ascii(std::string_view name) {
  return std::ranges::all_of(name, [](char c) { return static_cast<unsigned char>(c) < 0x80; });
}

bool is_host(std::string_view host) {
  constexpr std::size_t kLongestHost = 253;
  return !host.empty() && host.size() <= kLongestHost && std::all_of(host.begin(), host.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' || c == '.' ||
           c == ':';
  });
}

}  // namespace

Result<void> make_authority(const fs::path& folder, const Clock& clock) {
  if (fs::exists(folder / "authority.key"))
    return fail(ErrorCode::Conflict, fmt::format("{} holds an authority already", folder.string()));
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return fail(ErrorCode::StorageFailed,
                fmt::format("cannot make the folder {}: {}", folder.string(), error.message()));
  Authority authority;
  authority.key = Own<EVP_PKEY>{EVP_EC_gen("P-256")};
  if (!authority.key) return no("make a key");
  const Nanoseconds now = clock.wall();
  auto made = new_certificate("authority", "Telefab authority", authority.key.get(), now - kClocksDiffer,
                              now + kAuthorityLasts);
  if (!made) return tl::unexpected{made.error()};
  authority.certificate = std::move(*made);
  X509* self = authority.certificate.get();
  X509_set_issuer_name(self, X509_get_subject_name(self));
  for (const auto& [nid, value] :
       {std::pair{NID_basic_constraints, "critical,CA:TRUE"}, std::pair{NID_key_usage, "critical,keyCertSign,cRLSign"},
        std::pair{NID_subject_key_identifier, "hash"}})
    if (auto added = add_extension(self, self, nid, value); !added) return added;
  if (X509_sign(self, authority.key.get(), EVP_sha256()) == 0) return no("sign the authority");
  if (auto kept = write_certificate(folder / "authority.crt", self); !kept) return kept;
  const Own<X509_CRL> list{X509_CRL_new()};
  if (!list) return no("make the list of revoked certificates");
  if (auto kept = write_list(folder, authority, list.get(), clock); !kept) return kept;
  // Last, so that an authority that broke off in the making can be made again.
  return write_key(folder / "authority.key", authority.key.get());
}

Result<void> issue_certificate(const fs::path& folder, const CertificateRequest& request, const Clock& clock) {
  if (!is_name(request.name) || request.name == "authority")
    return fail(ErrorCode::InvalidInput,
                fmt::format("\"{}\" cannot name a certificate: letters, digits and -, at most {} bytes", request.name,
                            kLongestName));
  std::string names = is_ascii(request.name) ? "DNS:" + request.name : std::string{};
  for (const std::string& host : request.hosts) {
    boost::system::error_code is_a_name;
    boost::asio::ip::make_address(host, is_a_name);
    if (!is_host(host)) return fail(ErrorCode::InvalidInput, fmt::format("\"{}\" is not a host", host));
    names += (names.empty() ? "" : ",") + std::string{is_a_name ? "DNS:" : "IP:"} + host;
  }
  const auto authority = open_authority(folder);
  if (!authority) return tl::unexpected{authority.error()};
  const Own<EVP_PKEY> key{EVP_EC_gen("P-256")};
  if (!key) return no("make a key");
  const Nanoseconds now = clock.wall();
  const Nanoseconds until = now + request.valid_for;
  const auto made = new_certificate(name_of(request.role), request.name, key.get(),
                                    std::min(now - kClocksDiffer, until - std::chrono::hours{48}), until);
  if (!made) return tl::unexpected{made.error()};
  X509* issuer = authority->certificate.get();
  X509_set_issuer_name(made->get(), X509_get_subject_name(issuer));
  for (const auto& [nid, value] :
       {std::pair{NID_basic_constraints, std::string{"critical,CA:FALSE"}},
        std::pair{NID_key_usage, std::string{"critical,digitalSignature"}},
        std::pair{NID_ext_key_usage, std::string{"serverAuth,clientAuth"}}, std::pair{NID_subject_alt_name, names},
        std::pair{NID_subject_key_identifier, std::string{"hash"}}})
    if (!value.empty())  // but for alternative names of somebody whom no DNS name can name
      if (auto added = add_extension(made->get(), issuer, nid, value); !added) return added;
  if (X509_sign(made->get(), authority->key.get(), EVP_sha256()) == 0) return no("sign the certificate");
  if (auto kept = write_key(folder / (request.name + ".key"), key.get()); !kept) return kept;
  if (request.role == Role::ScanSite) {
    const auto pair = new_ed25519_key();
    if (!pair) return tl::unexpected{pair.error()};
    std::error_code ignored;  // write_new_secret says what is in the way
    fs::remove(folder / (request.name + ".sign.key"), ignored);
    if (auto kept = write_new_secret(folder / (request.name + ".sign.key"), pair->private_pem); !kept) return kept;
    if (auto kept = write_file_atomically(folder / (request.name + ".sign.pub"), pair->public_pem); !kept) return kept;
  }
  return write_certificate(folder / (request.name + ".crt"), made->get());
}

Result<void> revoke_certificate(const fs::path& folder, const std::string& name, const Clock& clock) {
  if (!is_name(name)) return fail(ErrorCode::InvalidInput, fmt::format("\"{}\" is not a name of a certificate", name));
  const auto authority = open_authority(folder);
  if (!authority) return tl::unexpected{authority.error()};
  const auto pem = read_pem(folder / (name + ".crt"));
  if (!pem) return tl::unexpected{pem.error()};
  const Own<X509> certificate{PEM_read_bio_X509(pem->get(), nullptr, nullptr, nullptr)};
  if (!certificate) return no(fmt::format("read {}.crt", name));
  const auto list_pem = read_pem(folder / "revoked.crl");
  if (!list_pem) return tl::unexpected{list_pem.error()};
  const Own<X509_CRL> list{PEM_read_bio_X509_CRL(list_pem->get(), nullptr, nullptr, nullptr)};
  if (!list) return no("read the list of revoked certificates");
  X509_REVOKED* known = nullptr;
  if (X509_CRL_get0_by_cert(list.get(), &known, certificate.get()) == 1) return {};
  Own<X509_REVOKED> entry{X509_REVOKED_new()};
  if (!entry || X509_REVOKED_set_serialNumber(entry.get(), X509_get_serialNumber(certificate.get())) != 1 ||
      X509_REVOKED_set_revocationDate(entry.get(), time_at(clock.wall() - kClocksDiffer).get()) != 1 ||
      X509_CRL_add0_revoked(list.get(), entry.get()) != 1)
    return no("add to the list of revoked certificates");
  (void)entry.release();  // the list's now
  return write_list(folder, *authority, list.get(), clock);
}

}  // namespace telefab::net
