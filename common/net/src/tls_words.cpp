// SPDX-License-Identifier: GPL-3.0-or-later
#include "tls_words.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>

#include <array>
#include <ctime>
#include <telefab/base/person_name.hpp>
#include <telefab/base/text.hpp>

namespace telefab::net {
namespace {

using Code = boost::system::error_code;

constexpr std::string_view kIssueAgain = "telefab certs issue";

/// Printable: it comes from a peer.
std::string entry_of(X509_NAME* name, int nid) {
  std::array<char, 256> text{};
  if (name == nullptr || X509_NAME_get_text_by_NID(name, nid, text.data(), static_cast<int>(text.size())) < 0)
    return "?";
  return to_printable(text.data());
}

std::string day_of(const ASN1_TIME* time) {
  std::tm parts{};
  return time != nullptr && ASN1_TIME_to_tm(time, &parts) == 1 ? fmt::format("{:%Y-%m-%d}", parts) : "an unknown day";
}

std::string name_of(X509* certificate) {
  return certificate == nullptr ? "?" : entry_of(X509_get_subject_name(certificate), NID_commonName);
}

/// The command that issues a certificate again; without names that are none of ours, for somebody may copy it.
std::string issue_words(X509* certificate) {
  constexpr std::size_t kLongestName = 63;
  const std::string name = name_of(certificate);
  const std::string role =
      certificate == nullptr ? "" : entry_of(X509_get_subject_name(certificate), NID_organizationalUnitName);
  if (!is_person_name(name, "-", kLongestName) || !role_from_name(role)) return std::string{kIssueAgain};
  return fmt::format("{} {} {}", kIssueAgain, name, role);
}

bool is_of_tls(const Code& error) { return error.category() == boost::asio::error::get_ssl_category(); }
int reason_of(const Code& error) { return ERR_GET_REASON(static_cast<unsigned long>(error.value())); }

/// What no TLS record begins with was read.
bool is_no_tls(const Code& error) {
  if (!is_of_tls(error)) return false;
  switch (reason_of(error)) {
    case SSL_R_WRONG_VERSION_NUMBER:
    case SSL_R_HTTP_REQUEST:
    case SSL_R_HTTPS_PROXY_REQUEST:
    case SSL_R_PACKET_LENGTH_TOO_LONG:
    case SSL_R_RECORD_LENGTH_MISMATCH:
      return true;
    default:
      return false;
  }
}

/// What the other side's alert says of our own certificate; empty for other alerts.
std::string refusal_of_ours(const Code& error, X509* own) {
  if (!is_of_tls(error)) return {};
  switch (reason_of(error)) {
    case SSL_R_TLSV1_ALERT_UNKNOWN_CA:
    case SSL_R_TLSV1_ALERT_DECRYPT_ERROR:
      return fmt::format(
          "it does not believe our certificate \"{}\", which is of another authority than its own; take "
          "the folder that came with the site, or have one issued by its authority: {}",
          name_of(own), issue_words(own));
    case SSL_R_SSLV3_ALERT_CERTIFICATE_EXPIRED:
      return fmt::format("our certificate \"{}\" expired on {}; have it issued again: {}", name_of(own),
                         own == nullptr ? "an unknown day" : day_of(X509_get0_notAfter(own)), issue_words(own));
    case SSL_R_SSLV3_ALERT_CERTIFICATE_REVOKED:
      return fmt::format("our certificate \"{}\" was revoked; ask whoever keeps the authority for another: {}",
                         name_of(own), issue_words(own));
    case SSL_R_SSLV3_ALERT_BAD_CERTIFICATE:
    case SSL_R_SSLV3_ALERT_CERTIFICATE_UNKNOWN:
    case SSL_R_SSLV3_ALERT_UNSUPPORTED_CERTIFICATE:
    case SSL_R_TLSV13_ALERT_CERTIFICATE_REQUIRED:
      return fmt::format("it does not take our certificate \"{}\"; its log says why. A new one: {}", name_of(own),
                         issue_words(own));
    default:
      return {};
  }
}

}  // namespace

std::string sentence_of(int verdict, X509* certificate, End own_end) {
  const std::string whose = fmt::format("its certificate \"{}\"", name_of(certificate));
  switch (verdict) {
    case X509_V_ERR_CERT_HAS_EXPIRED:
      return fmt::format("{} expired on {}; have it issued again: {}", whose, day_of(X509_get0_notAfter(certificate)),
                         issue_words(certificate));
    case X509_V_ERR_CERT_NOT_YET_VALID:
      return fmt::format("{} is valid from {} on; are the clocks of both machines right?", whose,
                         day_of(X509_get0_notBefore(certificate)));
    case X509_V_ERR_CERT_REVOKED:
      return fmt::format("{} was revoked; ask whoever keeps the authority for another: {}", whose,
                         issue_words(certificate));
    case X509_V_ERR_CERT_SIGNATURE_FAILURE:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT:
    case X509_V_ERR_UNABLE_TO_GET_ISSUER_CERT_LOCALLY:
    case X509_V_ERR_UNABLE_TO_VERIFY_LEAF_SIGNATURE:
    case X509_V_ERR_DEPTH_ZERO_SELF_SIGNED_CERT:
    case X509_V_ERR_SELF_SIGNED_CERT_IN_CHAIN:
    case X509_V_ERR_AKID_SKID_MISMATCH:
      if (own_end == End::Called) return "its certificate is of another authority than ours";
      return fmt::format(
          "{} is of another authority (\"{}\") than ours; both sides need certificates of one: take the "
          "folder that came with it, or have it issued by ours: {}",
          whose, certificate == nullptr ? "?" : entry_of(X509_get_issuer_name(certificate), NID_commonName),
          issue_words(certificate));
    case X509_V_ERR_UNABLE_TO_GET_CRL:
    case X509_V_ERR_CRL_SIGNATURE_FAILURE:
    case X509_V_ERR_CRL_HAS_EXPIRED:
    case X509_V_ERR_CRL_NOT_YET_VALID:
      return fmt::format(
          "{} cannot be checked: revoked.crl here is not a list of its authority that holds today; copy "
          "it from the authority's folder",
          own_end == End::Called ? "its certificate" : whose);
    default:
      return fmt::format("{} is not believed: {}", own_end == End::Called ? "its certificate" : whose,
                         X509_verify_cert_error_string(verdict));
  }
}

std::shared_ptr<CertificateCheck> watch_check(Tls& stream, End own_end) {
  auto check = std::make_shared<CertificateCheck>();
  stream.set_verify_callback([check, own_end](bool holds, boost::asio::ssl::verify_context& context) {
    if (!holds && check->verdict == X509_V_OK) {
      check->verdict = X509_STORE_CTX_get_error(context.native_handle());
      check->sentence = sentence_of(check->verdict, X509_STORE_CTX_get_current_cert(context.native_handle()), own_end);
    }
    return holds;
  });
  return check;
}

std::string why_no_handshake(const Code& error, const CertificateCheck& check, End own_end) {
  if (!check.sentence.empty()) return check.sentence;
  if (error == boost::asio::error::bad_descriptor || error == boost::asio::error::operation_aborted)
    return "the TLS handshake took too long";
  if (is_no_tls(error) && own_end == End::Caller)
    return "it speaks no TLS; a site without certificates is called without --tls, and the port of a page is not that "
           "of the site";
  if (is_no_tls(error)) return "the caller spoke no TLS; this site is called with --tls FOLDER";
  if (std::string refusal = refusal_of_ours(error, nullptr); !refusal.empty()) return refusal;
  if (error == boost::asio::error::eof || error == boost::asio::error::connection_reset ||
      error == boost::asio::ssl::error::stream_truncated)
    return "the other side hung up during the TLS handshake";
  return "no TLS: " + error.message();
}

std::string why_ended(Tls& stream, const Code& error, End /*own_end*/, bool /*was_silent*/) {
  return refusal_of_ours(error, SSL_get_certificate(stream.native_handle()));
}

std::string why_ended(const boost::asio::ip::tcp::socket& /*socket*/, const Code& /*error*/, End own_end,
                      bool was_silent) {
  if (own_end == End::Called || !was_silent) return {};
  return "the other side hung up without a word, as a site with certificates does to who comes without: give --tls "
         "FOLDER; or is it another program's port?";
}

}  // namespace telefab::net
