// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <telefab/net/authority.hpp>
#include <telefab/net/listener.hpp>
#include <telefab/net/trust.hpp>
#include <telefab/test/loopback.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <utility>

namespace telefab::net {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::HasSubstr;
namespace fs = std::filesystem;

/// A peer that connects and then says nothing.
class SilentSocket {
 public:
  explicit SilentSocket(std::uint16_t port) : fd_{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)} {
    const sockaddr_in address = test::loopback(port);
    ::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  }
  ~SilentSocket() {
    if (fd_ >= 0) ::close(fd_);
  }
  SilentSocket(SilentSocket&& other) noexcept : fd_{std::exchange(other.fd_, -1)} {}
  SilentSocket& operator=(SilentSocket&&) = delete;

 private:
  int fd_;
};

/// An authority with a fab, a scan site and two operators.
class Certificates : public testing::Test {
 protected:
  Certificates() {
    EXPECT_TRUE(make_authority(folder_, clock_));
    issue("fab", Role::FabSite, {"127.0.0.1", "fab.example.org", "::1"});
    issue("scan", Role::ScanSite);
    issue("ana", Role::Operator);
    issue("ben", Role::Operator);
  }
  void issue(const std::string& name, Role role, std::vector<std::string> hosts = {},
             Nanoseconds valid_for = hours{24}) {
    const auto made = issue_certificate(folder_, {name, role, std::move(hosts), valid_for}, clock_);
    ASSERT_TRUE(made) << made.error().what;
  }
  [[nodiscard]] Result<std::shared_ptr<Trust>> trust(const std::string& name) const {
    return Trust::load(tls_files_in(folder_, name));
  }
  [[nodiscard]] std::string pem(const std::string& name) const {
    std::ifstream in{folder_ / (name + ".crt")};
    return {std::istreambuf_iterator<char>{in}, {}};
  }

  /// Connects `name` to a listener of the fab; both ends are kept, and why either is lost.
  void connect(const std::string& name, std::optional<std::string> expected_name = {}) {
    ConnectionLimits limits;
    limits.judge_every = milliseconds{20};
    auto listening = Listener::open(loop_, {{"127.0.0.1", 0}, *trust("fab"), limits},
                                    {[this](ConnectionPtr made) {
                                       server_ = std::move(made);
                                       server_->start({{}, {}, [this](const Error& why) { server_lost_ = why; }});
                                       server_->set_ready();
                                     },
                                     [this](const std::string&, const Error& why) { refused_ = why; }});
    ASSERT_TRUE(listening) << listening.error().what;
    listener_ = std::move(*listening);
    ConnectOptions options{{"127.0.0.1", listener_->port()}, *trust(name), Role::FabSite, {}};
    options.expected_name = std::move(expected_name);
    connect_to(loop_, options, [this](Result<ConnectionPtr> made) {
      if (made) {
        client_ = *made;
        client_->start({{}, {}, [](const Error&) {}});
        client_->set_ready();
      }
      connected_ = made ? Result<void>{} : tl::unexpected{made.error()};
    });
    await([&] { return refused_ || (connected_.has_value() && (!*connected_ || server_)); });
  }
  template <class Condition>
  void await(Condition condition) {
    for (int tries = 0; tries < 2000 && !condition(); ++tries) loop_.run_for(milliseconds{5});
  }

  SystemClock clock_;
  test::ScratchFolder scratch_;
  fs::path folder_ = scratch_.path();
  Loop loop_;
  std::unique_ptr<Listener> listener_;
  ConnectionPtr server_, client_;
  std::optional<Result<void>> connected_;
  std::optional<Error> server_lost_, refused_;
};

TEST_F(Certificates, NameWhomTheyWereIssuedToAndWhereItIsReached) {
  connect("scan", "fab");
  ASSERT_TRUE(connected_ && *connected_) << connected_->error().what;
  EXPECT_EQ(client_->peer().name, "fab");
  EXPECT_EQ(client_->peer().role, Role::FabSite);
  EXPECT_THAT(client_->peer().names, ElementsAre("fab", "127.0.0.1", "fab.example.org", "::1"));
  EXPECT_EQ(server_->peer().name, "scan");
  EXPECT_EQ(server_->peer().role, Role::ScanSite);
}

// Any member of the authority with the right role could once stand in for a site.
TEST_F(Certificates, OfAnotherSiteAreRefusedWhereANameIsExpected) {
  for (const std::string expected : {"127.0.0.1", "fab.example.org"}) {
    connect("ana", expected);
    EXPECT_TRUE(*connected_) << expected;
    connected_.reset();
  }
  for (const std::string expected : {"other-fab", "example.org", "127.0.0.2", "scan", ""}) {
    connect("ana", expected);
    ASSERT_FALSE(*connected_) << expected;
    EXPECT_EQ(connected_->error().code, ErrorCode::NotTrusted);
    EXPECT_THAT(connected_->error().what, HasSubstr("fab.example.org"));
    connected_.reset();
  }
}

// A revoked operator once approved a print over a connection that was open before.
TEST_F(Certificates, ThatAreRevokedEndTheConnectionsThatAreOpen) {
  connect("ana");
  ASSERT_TRUE(*connected_) << connected_->error().what;
  loop_.run_for(milliseconds{100});
  EXPECT_FALSE(server_lost_) << "judged again and again, and found good";
  ASSERT_TRUE(revoke_certificate(folder_, "ben", clock_));
  loop_.run_for(milliseconds{100});
  EXPECT_FALSE(server_lost_) << "it was another's";
  ASSERT_TRUE(revoke_certificate(folder_, "ana", clock_));
  await([&] { return server_lost_.has_value(); });
  ASSERT_TRUE(server_lost_);
  EXPECT_EQ(server_lost_->code, ErrorCode::NotTrusted);
  EXPECT_THAT(server_lost_->what, HasSubstr("revoked"));
  connected_.reset();
  server_.reset();
  connect("ana");
  EXPECT_TRUE(refused_) << "nor does it come in again";
}

// 70 silent sockets a second once shut out every operator.
TEST_F(Certificates, GetTheirHoldersInWhileAnAddressFloods) {
  constexpr int kRounds = 15;
  int in = 0, reports = 0;
  auto listening = Listener::open(loop_, {{"127.0.0.1", 0}, *trust("fab"), {}},
                                  {[&](ConnectionPtr made) {
                                     server_ = std::move(made);
                                     server_->start({});
                                     server_->set_ready();
                                     ++in;
                                   },
                                   [&](const std::string&, const Error&) { ++reports; }});
  ASSERT_TRUE(listening) << listening.error().what;
  std::vector<SilentSocket> flood;
  for (int round = 0; round < kRounds; ++round) {
    for (int i = 0; i < 40; ++i) flood.emplace_back((*listening)->port());
    std::optional<bool> is_connected;
    connect_to(loop_, {{"127.0.0.1", (*listening)->port()}, *trust("ana"), Role::FabSite, {}},
               [&](Result<ConnectionPtr> made) { is_connected = made.has_value(); });
    const int before = in;
    await([&] { return in > before || (is_connected && !*is_connected); });
    EXPECT_EQ(in, before + 1) << "round " << round;
    server_.reset();
  }
  EXPECT_LE(reports, 1) << "counted, not reported one by one";
}

TEST_F(Certificates, OfOperatorsHavePlacesThatNobodyElseCanTake) {
  ListenOptions options{{"127.0.0.1", 0}, *trust("fab"), {}};
  options.max_connections = 5;
  options.operator_places = 2;
  options.max_of_others = 4;
  std::vector<ConnectionPtr> inside, outside;
  std::vector<std::string> why;
  auto listening = Listener::open(loop_, options,
                                  {[&](ConnectionPtr made) {
                                     made->start({});
                                     made->set_ready();
                                     inside.push_back(std::move(made));
                                   },
                                   [&](const std::string&, const Error& error) { why.push_back(error.what); }});
  ASSERT_TRUE(listening) << listening.error().what;
  const auto come = [&](const std::string& name) {
    std::optional<Frame> fault;
    bool is_over = false;
    connect_to(loop_, {{"127.0.0.1", (*listening)->port()}, *trust(name), Role::FabSite, {}},
               [&](Result<ConnectionPtr> made) {
                 ASSERT_TRUE(made) << made.error().what;
                 outside.push_back(*made);
                 outside.back()->start(
                     {[&](Frame frame) { fault = std::move(frame); }, {}, [&](const Error&) { is_over = true; }});
               });
    const std::size_t before = inside.size();
    await([&] { return inside.size() > before || is_over; });
    outside.back()->set_events({});
    return inside.size() > before ? std::string{"in"} : fault ? std::string{"told why"} : std::string{"out"};
  };
  for (int i = 0; i < 3; ++i) EXPECT_EQ(come("scan"), "in") << i;
  EXPECT_EQ(come("scan"), "told why");
  EXPECT_THAT(why, ElementsAre(HasSubstr("connection-limit")));
  EXPECT_EQ(come("ana"), "in");
  EXPECT_EQ(come("ben"), "in");
  EXPECT_EQ(come("ben"), "told why") << "operators do not come without end either";
}

TEST_F(Certificates, HoldUntilTheyExpireOrAreRevokedAndNoLonger) {
  const auto fab = trust("fab");
  ASSERT_TRUE(fab) << fab.error().what;
  const Nanoseconds now = clock_.wall();
  EXPECT_TRUE((*fab)->judge(pem("ana"), now));
  EXPECT_TRUE((*fab)->judge(pem("ana"), now + hours{23}));
  EXPECT_THAT((*fab)->judge(pem("ana"), now + hours{25}).error().what, HasSubstr("expired"));
  EXPECT_FALSE((*fab)->judge(pem("ana"), now - hours{72})) << "not valid yet";
  issue("old", Role::Operator, {}, hours{-1});
  EXPECT_FALSE((*fab)->judge(pem("old"), now));
  EXPECT_FALSE((*fab)->judge("no certificate", now));
  for (const std::string name : {"ana", "ben", "ana"}) ASSERT_TRUE(revoke_certificate(folder_, name, clock_));
  EXPECT_FALSE((*fab)->judge(pem("ana"), now));
  EXPECT_FALSE((*fab)->judge(pem("ben"), now));
  EXPECT_TRUE((*fab)->judge(pem("scan"), now));
}

TEST_F(Certificates, AreNotUsedWithoutTheListOfRevokedOnesUnlessThatIsStated) {
  fs::remove(folder_ / "revoked.crl");
  const auto refused = trust("fab");
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::NotFound);
  EXPECT_THAT(refused.error().what, HasSubstr("no-revocation-list"));
  std::ofstream{folder_ / "no-revocation-list"};
  EXPECT_TRUE(trust("fab"));
}

TEST_F(Certificates, AreNotUsedWithAKeyThatOthersCanRead) {
  const auto key = folder_ / "fab.key";
  struct stat status {};
  ASSERT_EQ(::stat(key.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
  ASSERT_EQ(::chmod(key.c_str(), 0644), 0);
  EXPECT_EQ(trust("fab").error().code, ErrorCode::NotTrusted);
  ASSERT_EQ(::chmod((folder_ / "authority.key").c_str(), 0644), 0);
  EXPECT_EQ(issue_certificate(folder_, {"eve", Role::Operator, {}, hours{1}}, clock_).error().code,
            ErrorCode::NotTrusted);
}

TEST_F(Certificates, NamePeopleInLettersOfAnyScript) {
  for (const std::string name : {"Gr\u00F6\u00DFe", "\u0410\u043D\u043D\u0430", "\u674E\u96F7"}) {
    ASSERT_TRUE(issue_certificate(folder_, {name, Role::Operator, {}, hours{1}}, clock_)) << name;
    EXPECT_TRUE(trust(name)) << name;
  }
}

TEST_F(Certificates, AreIssuedForNamesAndHostsThatCanBeChecked) {
  for (const std::string name :
       {"", "a b", "../x", "authority", "n\xC3", "n\u00A0me", "n\u202Eme", "n\u200Bme", "n,DNS:x"})
    EXPECT_EQ(issue_certificate(folder_, {name, Role::Operator, {}, hours{1}}, clock_).error().code,
              ErrorCode::InvalidInput)
        << name;
  for (const std::string host : {"", "a b", "x,DNS:other", "*"})
    EXPECT_EQ(issue_certificate(folder_, {"x", Role::FabSite, {host}, hours{1}}, clock_).error().code,
              ErrorCode::InvalidInput)
        << host;
  EXPECT_EQ(make_authority(folder_, clock_).error().code, ErrorCode::Conflict);
  EXPECT_EQ(issue_certificate(folder_ / "none", {"x", Role::Operator, {}, hours{1}}, clock_).error().code,
            ErrorCode::NotFound);
  EXPECT_EQ(revoke_certificate(folder_, "nobody", clock_).error().code, ErrorCode::NotFound);
  EXPECT_TRUE(fs::exists(folder_ / "scan.sign.key"));
  EXPECT_FALSE(fs::exists(folder_ / "ana.sign.key"));
}

}  // namespace
}  // namespace telefab::net
