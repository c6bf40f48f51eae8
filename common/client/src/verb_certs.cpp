// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include <telefab/command_line/output.hpp>
#include <telefab/net/authority.hpp>

#include "verbs.hpp"

namespace telefab::client {
namespace {

struct CertsOptions {
  std::string action, name, role, folder;
  std::vector<std::string> hosts;
  double days = 365;
};

Result<ExitCode> run(const CertsOptions& o) {
  const SystemClock clock;
  const std::filesystem::path folder{o.folder};
  const auto wants = [&](bool name, bool role) -> Result<void> {
    if (o.name.empty() == !name && o.role.empty() == !role) return {};
    return fail(ErrorCode::InvalidInput, fmt::format("certs {} takes {}", o.action,
                                                     role   ? "a NAME and a ROLE"
                                                     : name ? "a NAME and nothing else"
                                                            : "no NAME"));
  };
  if (o.action == "authority") {
    if (auto fine = wants(false, false); !fine) return tl::unexpected{fine.error()};
    if (auto made = net::make_authority(folder, clock); !made) return tl::unexpected{made.error()};
    write_output(fmt::format("made the authority in {}; keep authority.key there, off the sites\n", o.folder));
    return ExitCode::Ok;
  }
  if (o.action == "issue") {
    if (auto fine = wants(true, true); !fine) return tl::unexpected{fine.error()};
    const auto role = net::role_from_name(o.role);
    if (!role)
      return fail(ErrorCode::InvalidInput,
                  fmt::format("no role {}; there are: operator, scan-site, fab-site, read-only", o.role));
    net::CertificateRequest request{
        o.name, *role, o.hosts,
        std::chrono::duration_cast<Nanoseconds>(std::chrono::duration<double, std::ratio<86400>>{o.days})};
    if (auto made = net::issue_certificate(folder, request, clock); !made) return tl::unexpected{made.error()};
    write_output(fmt::format("issued {0}/{1}.crt for a {2}; copy it with {1}.key, authority.crt and revoked.crl\n",
                             o.folder, o.name, o.role));
    return ExitCode::Ok;
  }
  if (auto fine = wants(true, false); !fine) return tl::unexpected{fine.error()};
  if (auto done = net::revoke_certificate(folder, o.name, clock); !done) return tl::unexpected{done.error()};
  write_output(fmt::format("revoked {}; copy {}/revoked.crl to every site\n", o.name, o.folder));
  return ExitCode::Ok;
}

}  // namespace

VerbBody declare_certs(VerbOptions& options) {
  auto o = std::make_shared<CertsOptions>();
  options.add("ACTION", o->action, "authority: make it, once; issue NAME ROLE: a certificate with its key; revoke NAME")
      .required()
      .one_of({"authority", "issue", "revoke"});
  options.add("NAME", o->name, "whom the certificate names: letters, digits and -");
  options.add("ROLE", o->role, "operator, scan-site, fab-site or read-only");
  options.add("--dir", o->folder, "folder of the authority").required();
  options.add("--host", o->hosts,
              "a name or address under which this site is connected to; may be given again. Who connects checks it, or "
              "NAME where NAME is what they were told to expect");
  options.add("--days", o->days, "days until it expires; negative: expired already, for tests")
      .within(-3650.0, 3650.0)
      .shows_default();
  options.footer(
      "Certificates are PEM, ECDSA on P-256. Keep DIR/authority.key off the sites: copy to each of them authority.crt, "
      "revoked.crl and its own NAME.crt and NAME.key, to a scan site also its NAME.sign.key, to the fab the "
      "NAME.sign.pub of every scan site whose jobs it is to take, and start the daemons with --tls THAT_FOLDER "
      "--tls-name NAME. A new revoked.crl holds within seconds, for open connections too; no restart is needed.");
  return [o](std::stop_token) { return run(*o); };
}

}  // namespace telefab::client
