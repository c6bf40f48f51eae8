#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>

#include "two_sites.hpp"

namespace telefab::test {
namespace {

using testing::HasSubstr;

/// Both sites with certificates of one authority, made by deploy/certs.
class Strangers : public TwoSites {
 protected:
  Strangers() {
    certs(own(), {"authority"});
    certs(own(), {"issue", "fab-site", "fab-site"});
    certs(own(), {"issue", "scan-site", "scan-site"});
    certs(own(), {"issue", "operator", "operator"});
  }
  void certs(const std::filesystem::path& folder, std::vector<std::string> words) const {
    std::vector<std::string> command{std::string{::getenv("TELEFAB_SOURCE")} + "/deploy/certs", "--dir",
                                     folder.string()};
    command.insert(command.end(), words.begin(), words.end());
    const Outcome made = run(command);
    ASSERT_EQ(made.code, 0) << made.errors;
  }
  void start_with_tls() {
    start_fab({"--tls", own().string()});
    start_scan({"--tls", own().string()});
  }
  [[nodiscard]] std::filesystem::path own() const { return folder() / "certs"; }
  [[nodiscard]] Outcome jobs_as(const std::string& name, const std::filesystem::path& from) const {
    return telefab({"jobs", "--tls", from.string(), "--tls-name", name});
  }
};

TEST_F(Strangers, AreRefusedByNameAndLoggedWhileFriendsArePrinted) {
  const auto other = folder() / "other-certs";
  certs(other, {"authority"});
  certs(other, {"issue", "operator", "operator"});
  // What a stranger holds: a certificate of another authority; to be let as far as the site, it believes in ours.
  std::filesystem::copy_file(own() / "authority.crt", other / "authority.crt",
                             std::filesystem::copy_options::overwrite_existing);
  std::filesystem::remove(other / "revoked.crl");
  certs(own(), {"issue", "expired", "operator", "--days", "-1"});
  certs(own(), {"issue", "fired", "operator"});
  certs(own(), {"issue", "viewer", "read-only"});
  start_with_tls();

  EXPECT_EQ(jobs_as("operator", own()).code, 0);
  EXPECT_EQ(jobs_as("fired", own()).code, 0);
  certs(own(), {"revoke", "fired"});

  EXPECT_EQ(jobs_as("fired", own()).code, 4) << "revoked while the daemons run";
  EXPECT_EQ(jobs_as("operator", other).code, 4) << "wrong authority";
  EXPECT_EQ(jobs_as("expired", own()).code, 4);
  EXPECT_EQ(jobs_as("scan-site", own()).code, 4) << "wrong role";
  EXPECT_EQ(telefab({"jobs"}).code, 3) << "no TLS at all";
  const Outcome old_tls = run({"/usr/bin/openssl", "s_client", "-connect", scan_site(), "-tls1_2", "-cert",
                               (own() / "operator.crt").string(), "-key", (own() / "operator.key").string(), "-CAfile",
                               (own() / "authority.crt").string()});
  EXPECT_NE(old_tls.code, 0) << "TLS 1.2";
  const Outcome nobody = run({"/usr/bin/openssl", "s_client", "-connect", scan_site(), "-tls1_3", "-quiet", "-CAfile",
                              (own() / "authority.crt").string()});
  EXPECT_THAT(nobody.errors, HasSubstr("certificate required"));

  EXPECT_EQ(jobs_as("viewer", own()).code, 0);
  const Outcome submit =
      telefab({"submit", torus().string(), "--machine", "toy", "--tls", own().string(), "--tls-name", "viewer"});
  EXPECT_NE(submit.code, 0);
  EXPECT_THAT(submit.errors, HasSubstr("read-only"));

  const Outcome friendly =
      telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--tls", own().string(), "--watch"});
  EXPECT_EQ(friendly.code, 0) << friendly.errors;

  const std::string log = text_of(folder() / "scan" / "audit.log");
  for (const char* reason : {"certificate revoked", "certificate has expired", "wrong-role", "wrong version number",
                             "unsupported protocol", "peer did not return a certificate", "viewer"})
    EXPECT_THAT(log, HasSubstr(reason));
  EXPECT_THAT(log, testing::AnyOf(HasSubstr("unable to get local issuer"), HasSubstr("signature failure"),
                                  HasSubstr("self-signed")));
}

TEST_F(Strangers, AFabThatShowsAnotherRoleGetsNoJob) {
  start_fab({"--tls", own().string(), "--tls-name", "operator"});
  start_scan({"--tls", own().string()});
  EXPECT_THAT(scan().wait_for_error_line("expected"), HasSubstr("a fab-site was expected"));
}

TEST_F(Strangers, PlainTcpIsRefusedOffLoopback) {
  const std::string bin = ::getenv("TELEFAB_BIN");
  const Outcome outcome = run({bin + "/telefab-fab", "serve", "--listen", "0.0.0.0:0", "--data",
                               (folder() / "off").string(), "--machines", (folder() / "machines").string()});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_THAT(outcome.errors, HasSubstr("--tls"));
  const Outcome client = telefab({"jobs", "--site", "192.0.2.1:7410", "--timeout-s", "2"});
  EXPECT_EQ(client.code, 4);
}

}  // namespace
}  // namespace telefab::test
