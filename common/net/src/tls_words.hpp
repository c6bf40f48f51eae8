// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>

#include "trust_impl.hpp"

// What people are told where TLS fails: which certificate, of whom, until when, and what to do.
namespace telefab::net {

/// Which end of a connection this program is.
enum class End : std::uint8_t { Caller = 1, Called = 2 };

/// What the check of the other side's certificate found, filled while hands are shaken.
struct CertificateCheck {
  int verdict = X509_V_OK;
  std::string sentence;  ///< empty: nothing was found wrong
};
/// Keeps the first thing that is wrong with the other side's certificate; the check itself stays as strict as it is.
[[nodiscard]] std::shared_ptr<CertificateCheck> watch_check(Tls& stream, End own_end);

/// What is wrong with a certificate, by OpenSSL's verdict: "its certificate "fab" expired on 2026-03-01; ...". Who is
/// called repeats nothing that a certificate of another authority says of itself: anybody can make one, and what
/// differs from one to the next would fill the log.
[[nodiscard]] std::string sentence_of(int verdict, X509* certificate, End own_end);

/// Why hands could not be shaken.
[[nodiscard]] std::string why_no_handshake(const boost::system::error_code& error, const CertificateCheck& check,
                                           End own_end);

/// Why a connection ended that was not ready yet: a TLS peer may refuse our certificate after its own was taken
/// (TLS 1.3), and one that wants TLS hangs up on who comes without. Empty: nothing more than the error says.
[[nodiscard]] std::string why_ended(Tls& stream, const boost::system::error_code& error, End own_end, bool was_silent);
[[nodiscard]] std::string why_ended(const boost::asio::ip::tcp::socket& socket, const boost::system::error_code& error,
                                    End own_end, bool was_silent);

}  // namespace telefab::net
