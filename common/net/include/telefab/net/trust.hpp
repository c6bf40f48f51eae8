// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/base/result.hpp>
#include <vector>

struct ssl_ctx_st;  // of OpenSSL: SSL_CTX and SSL
struct ssl_st;

namespace telefab::net {

/// What a certificate's holder may be; it stands in the subject's organizational unit.
enum class Role : std::uint8_t { Operator, ScanSite, FabSite, ReadOnly };
/// "operator", "scan-site", "fab-site", "read-only".
[[nodiscard]] std::string_view name_of(Role role);
[[nodiscard]] std::optional<Role> role_from_name(std::string_view name);

/// Who is at the other end.
struct Peer {
  std::string address;             ///< HOST:PORT as the socket says
  std::string name;                ///< common name of the certificate; "local" without TLS
  std::optional<Role> role;        ///< empty: plain TCP from loopback, trusted with everything
  std::vector<std::string> names;  ///< names and addresses its certificate vouches for (subjectAltName)
  std::string certificate_pem;     ///< what it showed; empty without TLS
};

/// PEM files, as `telefab certs` makes them.
struct TlsFiles {
  std::filesystem::path certificate;
  std::filesystem::path key;
  std::filesystem::path authority;
  std::filesystem::path revoked;  ///< list of revoked certificates; empty: stated that there is none
};

/// authority.crt, NAME.crt, NAME.key and revoked.crl of a folder. There is no list only where an empty file
/// no-revocation-list states so: one that was forgotten would let everybody in who was ever let in.
[[nodiscard]] TlsFiles tls_files_in(const std::filesystem::path& folder, const std::string& name);

/// One side's certificate and whom it believes: TLS 1.3 only, both sides show certificates of one private authority.
/// Threads: those of one, the loop's or the page's.
class Trust {
 public:
  /// Fails with NotFound, InvalidInput or NotTrusted (key of another certificate, one that others can read); names the
  /// file.
  [[nodiscard]] static Result<std::shared_ptr<Trust>> load(const TlsFiles& files);
  ~Trust();
  Trust(const Trust&) = delete;
  Trust& operator=(const Trust&) = delete;
  /// Reads the files again where one of them has changed; on failure the old ones stay in force.
  [[nodiscard]] Result<void> refresh();
  /// Whether a peer's certificate would be believed at that time, by the files as they are now. NotTrusted: why not.
  [[nodiscard]] Result<void> judge(const std::string& certificate_pem, Nanoseconds wall);

  /// For who accepts connections by OpenSSL without Asio's context; in force until refresh().
  [[nodiscard]] ssl_ctx_st* context();

  struct Impl;
  [[nodiscard]] Impl& impl() { return *impl_; }

 private:
  explicit Trust(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// Name and role of the certificate the other side showed; NotTrusted where it showed none, or one without a role of
/// ours.
[[nodiscard]] Result<Peer> peer_of(const ssl_st* stream, std::string address);

}  // namespace telefab::net
