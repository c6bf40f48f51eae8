// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <fstream>
#include <telefab/test/https_client.hpp>
#include <telefab/test/two_sites.hpp>
#include <telefab/wire/job_signature.hpp>

namespace telefab::test {
namespace {

using testing::HasSubstr;

/// Both sites with certificates of one authority, made by `telefab certs`.
class Unauthenticated : public TwoSites {
 protected:
  Unauthenticated() {
    certs(own(), {"authority"});
    certs(own(), {"issue", "fab-site", "fab-site", "--host", "127.0.0.1"});
    certs(own(), {"issue", "scan-site", "scan-site", "--host", "127.0.0.1"});
    certs(own(), {"issue", "operator", "operator"});
  }
  void certs(const std::filesystem::path& folder, std::vector<std::string> words) const {
    std::vector<std::string> command{std::string{::getenv("TELEFAB_BIN")} + "/telefab", "certs", "--dir",
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

TEST_F(Unauthenticated, AreRefusedByNameAndLoggedWhileFriendsArePrinted) {
  const auto other = folder() / "other-certs";
  certs(other, {"authority"});
  certs(other, {"issue", "operator", "operator"});
  // What an unauthenticated peer holds: a certificate of another authority; to be let as far as the site, it believes
  // in ours.
  std::filesystem::copy_file(own() / "authority.crt", other / "authority.crt",
                             std::filesystem::copy_options::overwrite_existing);
  std::filesystem::remove(other / "revoked.crl");
  EXPECT_EQ(jobs_as("operator", other).code, 7) << "a list that was forgotten";
  std::ofstream{other / "no-revocation-list"};
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
  for (const char* reason :
       {"certificate \\\"fired\\\" was revoked", "certificate \\\"expired\\\" expired on ", "wrong-role",
        "the caller spoke no TLS", "unsupported protocol", "peer did not return a certificate", "viewer"})
    EXPECT_THAT(log, HasSubstr(reason));
  EXPECT_THAT(log, HasSubstr("its certificate is of another authority than ours\""))
      << "and nothing that such a certificate says of itself";
}

TEST_F(Unauthenticated, JobsOfASiteWhoseKeyTheFabDoesNotKnowAreRefusedAndLogged) {
  start_with_tls();
  const auto submit = [&] {
    return telefab(
        {"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--tls", own().string(), "--watch"});
  };
  EXPECT_EQ(submit().code, 0);
  EXPECT_THAT(text_of(folder() / "fab" / "audit.log"), HasSubstr("signed with"));
  // The key is taken from the list: the next job is refused, without a restart.
  std::filesystem::rename(own() / "scan-site.sign.pub", own() / "withdrawn");
  const Outcome refused = submit();
  EXPECT_NE(refused.code, 0);
  EXPECT_THAT(refused.errors + refused.output, HasSubstr("job-signature"));
  EXPECT_THAT(text_of(folder() / "fab" / "audit.log"), HasSubstr("refused: offer"));
  std::filesystem::rename(own() / "withdrawn", own() / "scan-site.sign.pub");
  EXPECT_EQ(submit().code, 0);
}

TEST_F(Unauthenticated, JobsReplayedOverTlsAreRefusedAndLogged) {
  certs(own(), {"issue", "scan-two", "scan-site"});
  start_with_tls();
  const Outcome submitted =
      telefab({"submit", torus().string(), "--machine", "toy", "--height-mm", "4", "--tls", own().string()});
  ASSERT_EQ(submitted.code, 0) << submitted.errors;
  const std::string job = submitted.output.substr(0, submitted.output.find('\n'));
  ASSERT_EQ(telefab({"watch", job, "--tls", own().string()}).code, 0);
  const auto recorded = folder() / "fab" / "jobs" / job / "offer";
  ASSERT_TRUE(std::filesystem::exists(recorded));
  const auto bytes_in = [&](const std::filesystem::path& path) { return text_of(path); };
  const auto frame_of = [](const Message& message) {
    const auto bytes = to_bytes(to_frame(message)).value();
    return std::string{reinterpret_cast<const char*>(bytes.data()), bytes.size()};
  };
  const auto play = [&](const std::string& as, const std::string& offer) {
    std::ofstream{folder() / "played", std::ios::binary}
        << frame_of(Hello{kProtocolVersion, Side::ScanSite, "replay", {}, {}}) << offer
        << frame_of(StackStored{job});  // no scan site says that: the fab ends the connection
    return run({"/bin/sh", "-c",
                fmt::format(
                    "openssl s_client -quiet -connect {} -cert {}/{}.crt -key {}/{}.key -CAfile {}/authority.crt "
                    "<{}/played",
                    fab_site(), own().string(), as, own().string(), as, own().string(), folder().string())})
        .output;
  };
  // The job of one site, offered by another one.
  EXPECT_THAT(play("scan-two", bytes_in(recorded)), HasSubstr("job-signature"));
  // The same with that site's own key under the job's id, and by the site itself with another content.
  FrameReader reader;
  const std::string text = bytes_in(recorded);
  reader.feed(std::as_bytes(std::span{text}));
  Offer offer = std::get<Offer>(from_frame(reader.take().value().value()).value());
  ASSERT_TRUE(sign_offer(offer, bytes_in(own() / "scan-two.sign.key")));
  EXPECT_THAT(play("scan-two", frame_of(offer)), HasSubstr("replayed-job"));
  offer.parameters = "{\"height_mm\":5}";
  EXPECT_THAT(play("scan-site", frame_of(offer)), HasSubstr("job-signature"));
  ASSERT_TRUE(sign_offer(offer, bytes_in(own() / "scan-site.sign.key")));
  EXPECT_THAT(play("scan-site", frame_of(offer)), HasSubstr("replayed-job"));
  const std::string log = bytes_in(folder() / "fab" / "audit.log");
  EXPECT_THAT(log, HasSubstr("job-signature"));
  EXPECT_THAT(log, HasSubstr("replayed-job"));
}

TEST_F(Unauthenticated, WithTheKeysOfSitesALoopbackFabRefusesOtherJobs) {
  std::filesystem::create_directories(folder() / "keys");
  start_fab({"--site-keys", (folder() / "keys").string()});
  start_scan();
  const std::string refused = submit_torus();
  EXPECT_NE(telefab({"watch", refused}).code, 0);
  EXPECT_THAT(text_of(folder() / "fab" / "audit.log"), HasSubstr("job-signature"));
  std::filesystem::copy_file(folder() / "scan" / "sign.pub", folder() / "keys" / "chicago.sign.pub");
  EXPECT_EQ(telefab({"watch", submit_torus()}).code, 0);
}

TEST_F(Unauthenticated, AFabThatShowsAnotherRoleGetsNoJob) {
  start_fab({"--tls", own().string(), "--tls-name", "operator"});
  start_scan({"--tls", own().string()});
  EXPECT_THAT(scan().wait_for_error_line("expected"), HasSubstr("a fab-site was expected"));
}

TEST_F(Unauthenticated, PlainTcpIsRefusedOffLoopback) {
  const std::string bin = ::getenv("TELEFAB_BIN");
  const Outcome outcome = run({bin + "/telefab-fab", "serve", "--listen", "0.0.0.0:0", "--data",
                               (folder() / "off").string(), "--machines", (folder() / "machines").string()});
  EXPECT_EQ(outcome.code, 4);
  EXPECT_THAT(outcome.errors, HasSubstr("--tls"));
  const Outcome page = run({bin + "/telefab-fab", "serve", "--listen", "127.0.0.1:0", "--web", "0.0.0.0:0", "--data",
                            (folder() / "off").string(), "--machines", (folder() / "machines").string()});
  EXPECT_EQ(page.code, 4);
  EXPECT_THAT(page.errors, HasSubstr("give --tls FOLDER"));
  const Outcome client = telefab({"jobs", "--site", "192.0.2.1:7410", "--timeout-s", "2"});
  EXPECT_EQ(client.code, 4);
}

TEST_F(Unauthenticated, ThePageOffLoopbackIsForOperatorsWhomTheAuditLogNames) {
  const std::string bin = ::getenv("TELEFAB_BIN");
  const auto data = folder() / "fab";
  const auto tokens = [&](std::vector<std::string> words) {
    words.insert(words.begin(), {bin + "/telefab-fab", "tokens", "--data", data.string()});
    return run(words);
  };
  start_fab({"--tls", own().string(), "--web", "0.0.0.0:0"});
  const auto port = static_cast<std::uint16_t>(std::stoi(text_of(data / "web-port")));
  const auto clear_as = [&](const std::string& certificate, const std::string& token) {
    return https_ask(HttpsClient{port, own(), certificate}, "POST", "/v1/machines/small/cleared",
                     token.empty() ? "" : "X-Api-Key: " + token + "\r\n")
        .substr(0, 12);
  };
  // There is no such machine (404), which is looked at once the giver is known and in the audit log.
  EXPECT_EQ(clear_as("", ""), "HTTP/1.1 401");
  EXPECT_EQ(clear_as("", text_of(data / "web-token").substr(0, 32)), "HTTP/1.1 401") << "it names nobody";
  EXPECT_EQ(clear_as("scan-site", ""), "HTTP/1.1 403");
  EXPECT_EQ(clear_as("operator", ""), "HTTP/1.1 404");
  const Outcome added = tokens({"add", "bob"});
  ASSERT_EQ(added.code, 0) << added.errors;
  const std::string bob = added.output.substr(0, 32);
  EXPECT_EQ(tokens({"add", "bob"}).code, 2) << "one has to be revoked first";
  EXPECT_THAT(tokens({"list"}).output, HasSubstr("bob "));
  EXPECT_EQ(clear_as("", bob), "HTTP/1.1 404") << "the daemon that runs knows it";
  ASSERT_EQ(tokens({"revoke", "bob"}).code, 0);
  EXPECT_EQ(clear_as("", bob), "HTTP/1.1 401");
  const std::string log = text_of(data / "audit.log");
  for (const char* line : {R"("who":"operator","what":"cleared small")", R"("who":"bob","what":"cleared small")"})
    EXPECT_THAT(log, HasSubstr(line));
}

}  // namespace
}  // namespace telefab::test
