// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <telefab/base/clock.hpp>
#include <telefab/net/trust.hpp>
#include <vector>

namespace telefab::net {

// The private authority of one pair of sites and their operators: a folder with authority.key, authority.crt and
// revoked.crl, and what it issued. Certificates are PEM, ECDSA on P-256. All of it fails with StorageFailed,
// NotPermitted, NotTrusted (a key that others can read) and Internal (OpenSSL says no; the message says why).

/// Makes the authority and an empty list of revoked certificates. Conflict where there is one already.
[[nodiscard]] Result<void> make_authority(const std::filesystem::path& folder, const Clock& clock);

struct CertificateRequest {
  std::string name;  ///< letters, digits and "-"; stands in the certificate, pinned by who connects to it
  Role role = Role::Operator;
  std::vector<std::string> hosts;                        ///< names and addresses under which it may be reached besides
  Nanoseconds valid_for = std::chrono::hours{24 * 365};  ///< negative: expired already, for tests
};
/// Makes NAME.key, for its owner alone, and NAME.crt; for a scan site also NAME.sign.key and NAME.sign.pub (Ed25519),
/// which its jobs are signed with. What was issued under that name is replaced. InvalidInput (name, host); NotFound
/// (no authority).
[[nodiscard]] Result<void> issue_certificate(const std::filesystem::path& folder, const CertificateRequest& request,
                                             const Clock& clock);

/// Puts NAME.crt on the list. NotFound where there is none; one that is on it already stays there once.
[[nodiscard]] Result<void> revoke_certificate(const std::filesystem::path& folder, const std::string& name,
                                              const Clock& clock);

}  // namespace telefab::net
