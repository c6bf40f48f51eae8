// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <random>
#include <sstream>
#include <telefab/test/digest_client.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <telefab/web/digest_login.hpp>
#include <telefab/web/sign_in.hpp>

namespace telefab {
namespace {

using std::chrono::minutes;
using test::DigestClient;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;
using Verdict = DigestLogin::Verdict;

constexpr const char* kUri = "/api/v1/files/local/a%20part.sl1";

class DigestLoginTest : public testing::Test {
 protected:
  [[nodiscard]] std::string nonce() { return DigestClient::nonce_of(login.challenges(false).at(0)); }
  [[nodiscard]] Verdict judge(const std::string& header, bool is_whole = true, const std::string& method = "PUT",
                              const std::string& uri = kUri) {
    WebRequest request{method, uri, header};
    request.is_whole = is_whole;
    const auto shown = digest_answer_from(std::string_view{header}.substr(7));
    EXPECT_TRUE(shown) << header;
    return shown ? login.judge(request, *shown, &keys) : Verdict::Wrong;
  }

  VirtualClock clock;
  DigestLogin login{"0123456789abcdef", clock};
  DigestKeys keys = digest_keys_of("ada", "secret");
  DigestClient ada{"ada", "secret"};
};

TEST_F(DigestLoginTest, KeepsWhatItChecksByAndNotThePassword) {
  EXPECT_EQ(keys.md5, "f79cb4d38b81db7bea5952b04913c3e4");
  EXPECT_EQ(keys.sha256, "b302b2c0c7956bf34224693d42acfd9ef8e4c1a0e55e92757bd921df380d0043");
}

TEST_F(DigestLoginTest, OffersTheStrongerHashFirstAndBothWithOneNonce) {
  const auto list = login.challenges(false);
  ASSERT_THAT(list, SizeIs(2));
  EXPECT_THAT(list[0], HasSubstr("algorithm=SHA-256"));
  EXPECT_THAT(list[1], HasSubstr("algorithm=MD5"));
  EXPECT_EQ(DigestClient::nonce_of(list[0]), DigestClient::nonce_of(list[1]));
  EXPECT_THAT(list[0], Not(HasSubstr("stale")));
  EXPECT_THAT(login.challenges(true)[0], HasSubstr("stale=true"));
  EXPECT_NE(nonce(), nonce());
}

TEST_F(DigestLoginTest, TakesTheRightPasswordByEitherHash) {
  for (const char* algorithm : {"SHA-256", "MD5"}) {
    ada.algorithm = algorithm;
    EXPECT_EQ(judge(ada.answer("PUT", kUri, nonce())), Verdict::Right) << algorithm;
  }
}

TEST_F(DigestLoginTest, LetsAStreamGoOnForAsLongAsThePasswordHoldsAndOpensNoSecondOne) {
  const std::string header = ada.answer("GET", "/v1/stream", nonce());
  EXPECT_EQ(judge(header, true, "GET", "/v1/stream"), Verdict::Right);
  EXPECT_EQ(judge(header, true, "GET", "/v1/stream"), Verdict::Stale) << "was overheard";
  WebRequest watched{"GET", "/v1/stream", header};
  watched.goes_on = true;
  const auto shown = digest_answer_from(std::string_view{header}.substr(7)).value();
  clock.sleep_for(3 * DigestLogin::kNonceLasts);
  EXPECT_EQ(login.judge(watched, shown, &keys), Verdict::Right);
  const DigestKeys changed = digest_keys_of("ada", "another");
  EXPECT_EQ(login.judge(watched, shown, &changed), Verdict::Wrong);
  EXPECT_EQ(login.judge(watched, shown, nullptr), Verdict::Wrong);
}

TEST_F(DigestLoginTest, RefusesAnotherPasswordUserMethodAddressOrHash) {
  const std::string one = nonce();
  const std::string right = ada.answer("PUT", kUri, one);
  EXPECT_EQ(judge(DigestClient{"ada", "Secret"}.answer("PUT", kUri, one)), Verdict::Wrong);
  EXPECT_EQ(judge(DigestClient{"eve", "secret"}.answer("PUT", kUri, one)), Verdict::Wrong);
  EXPECT_EQ(judge(right, true, "DELETE"), Verdict::Wrong);
  EXPECT_EQ(judge(right, true, "PUT", "/api/v1/files/local/other.sl1"), Verdict::Wrong);
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"algorithm=SHA-256", "algorithm=MD5"},
           {"algorithm=SHA-256", "algorithm=SHA-256-sess"},
           {"algorithm=SHA-256", "algorithm=SHA-512-256"},
           {"qop=auth", "qop=auth-int"},
           {"qop=auth, ", ""},  // RFC 2069: without a count it could be sent again
           {"cnonce=\"0a4f113b\"", "cnonce=\"\""},
           {"nc=00000001", "nc=00000002"}}) {
    std::string changed = right;
    changed.replace(changed.find(from), from.size(), to);
    EXPECT_EQ(judge(changed), Verdict::Wrong) << changed;
  }
  EXPECT_EQ(judge(right), Verdict::Right) << "what was refused has used nothing up";
}

TEST_F(DigestLoginTest, TakesWhatWasOverheardNoSecondTime) {
  const std::string one = nonce();
  EXPECT_EQ(judge(ada.answer("PUT", kUri, one, "00000001")), Verdict::Right);
  EXPECT_EQ(judge(ada.answer("PUT", kUri, one, "00000001")), Verdict::Stale);
  EXPECT_EQ(judge(ada.answer("PUT", kUri, one, "00000003")), Verdict::Right);
  EXPECT_EQ(judge(ada.answer("PUT", kUri, one, "00000002")), Verdict::Stale);
  for (const char* count : {"00000000", "1", "0000000g", "-0000001", "000000004"})
    EXPECT_EQ(judge(ada.answer("PUT", kUri, one, count)), Verdict::Stale) << count;
}

TEST_F(DigestLoginTest, CountsARequestOnceThoughItsHeadIsJudgedToo) {
  const std::string header = ada.answer("PUT", kUri, nonce());
  for (int i = 0; i < 3; ++i) EXPECT_EQ(judge(header, false), Verdict::Right);
  EXPECT_EQ(judge(header, true), Verdict::Right);
  EXPECT_EQ(judge(header, false), Verdict::Stale);
}

TEST_F(DigestLoginTest, LetsANonceGrowOldButNoUploadThatBeganInTime) {
  const std::string one = nonce();
  clock.sleep_for(DigestLogin::kNonceLasts - DigestLogin::kLongestRequest);
  const std::string header = ada.answer("PUT", kUri, one);
  EXPECT_EQ(judge(header, false), Verdict::Right);
  clock.sleep_for(minutes{1});
  EXPECT_EQ(judge(header, false), Verdict::Stale) << "a head that comes now is too late";
  EXPECT_EQ(judge(header, true), Verdict::Right) << "the upload that began in time";
  clock.sleep_for(DigestLogin::kLongestRequest);
  EXPECT_EQ(judge(ada.answer("PUT", kUri, one, "00000002"), true), Verdict::Stale);
}

TEST_F(DigestLoginTest, TakesNoNonceThatItDidNotMake) {
  DigestLogin other{"fedcba9876543210", clock};
  const std::string foreign = DigestClient::nonce_of(other.challenges(false)[0]);
  std::string later = nonce();
  later[15] = later[15] == 'f' ? 'e' : 'f';  // of its time
  for (const std::string& bad : {foreign, later, std::string{"x"}, std::string(64, '0'), std::string(1000, 'f')})
    EXPECT_EQ(judge(ada.answer("PUT", kUri, bad)), Verdict::Stale) << bad;
}

TEST_F(DigestLoginTest, ForgettingOldCountsLetsNothingBeSentAgain) {
  const std::string first = nonce(), unused = nonce();
  EXPECT_EQ(judge(ada.answer("PUT", kUri, first)), Verdict::Right);
  for (std::size_t i = 0; i < DigestLogin::kMostNonces; ++i) {
    clock.sleep_for(std::chrono::milliseconds{1});
    ASSERT_EQ(judge(ada.answer("PUT", kUri, nonce())), Verdict::Right);
  }
  EXPECT_EQ(judge(ada.answer("PUT", kUri, first)), Verdict::Stale);
  EXPECT_EQ(judge(ada.answer("PUT", kUri, unused)), Verdict::Stale) << "as old, so it may have been used";
  EXPECT_EQ(judge(ada.answer("PUT", kUri, nonce())), Verdict::Right);
}

TEST_F(DigestLoginTest, WithoutASecretNobodyLogsIn) {
  DigestLogin none{"", clock};
  EXPECT_THAT(none.challenges(false), IsEmpty());
  const std::string header = ada.answer("PUT", kUri, nonce());
  EXPECT_EQ(none.judge({"PUT", kUri, header}, digest_answer_from(header.substr(7)).value(), &keys), Verdict::Wrong);
}

TEST(DigestAnswer, RefusesMalformedHeaders) {
  const std::string good = R"(username="a", nonce="b", uri="/", response="c")";
  EXPECT_TRUE(digest_answer_from(good));
  EXPECT_EQ(digest_answer_from(R"(Username = "a\"b" ,nonce=b,uri="/",response="c",nc=00000001 )").value().user, "a\"b");
  for (const std::string& bad :
       {std::string{}, std::string{","}, std::string{"username"}, std::string{"=x"}, good + ",", good + R"(, x="open)",
        good + R"(, x="open\)", good + R"(, uri="/again")", good + R"( realm="no comma")",
        good + ", x=", good.substr(0, good.size() - 14), good + ", x=" + std::string(2000, 'y')})
    EXPECT_EQ(digest_answer_from(bad).error().code, ErrorCode::InvalidInput) << bad;
}

TEST(DigestAnswer, OutlivesDamagedHeaders) {
  const std::string whole = DigestClient{"ada", "secret"}.answer("PUT", kUri, "n").substr(7);
  std::mt19937_64 rng{5};
  for (int i = 0; i < 20'000; ++i) {
    std::string damaged = whole.substr(0, rng() % (whole.size() + 1));
    for (auto n = rng() % 4; n > 0 && !damaged.empty(); --n) damaged[rng() % damaged.size()] = static_cast<char>(rng());
    const auto read = digest_answer_from(damaged);
    EXPECT_LE(read ? read->user.size() : 0, damaged.size());
  }
}

class DigestSignIn : public testing::Test {
 protected:
  [[nodiscard]] tl::expected<Visitor, SignIn::Refusal> admit(SignIn& page, const DigestClient& client,
                                                             const std::string& method = "GET",
                                                             const std::string& origin = {}) const {
    WebRequest request{method, "/api/version"};
    request.address = "192.0.2.7:5000";
    request.host = "localhost:7480";
    request.origin = origin;
    request.authorization = client.answer(method, "/api/version", DigestClient::nonce_of(page.challenges({}).at(0)));
    return page.admit(request, Access::Readers);
  }
  [[nodiscard]] std::string add(const std::string& name, DigestUse use, Access may = Access::Operators) const {
    return add_operator_token(file, name, may, std::chrono::seconds{1}, use).value();
  }
  VirtualClock clock;
  test::ScratchFolder folder;
  std::filesystem::path file = folder.path() / "operator-tokens";
};

TEST_F(DigestSignIn, OnlyATokenThatWasMadeForItIsAPassword) {
  const std::string ada = add("ada", DigestUse::Yes), bob = add("bob", DigestUse::No);
  SignIn page{{file, "the-shared-token", false}, clock};
  EXPECT_EQ(admit(page, {"ada", ada}).value(), (Visitor{"ada", Access::Operators}));
  EXPECT_FALSE(admit(page, {"bob", bob}));
  EXPECT_FALSE(admit(page, {"ada", bob}));
  EXPECT_FALSE(admit(page, {"web", "the-shared-token"})) << "it names nobody, and everybody signs in";
  ASSERT_TRUE(revoke_operator_token(file, "ada"));
  EXPECT_FALSE(admit(page, {"ada", ada}));
}

TEST_F(DigestSignIn, TheSharedTokenIsThePasswordOfTheUserWebWhileNobodySignsIn) {
  SignIn page{{file, "the-shared-token", false}, clock};
  EXPECT_EQ(admit(page, {"web", "the-shared-token"}).value(), (Visitor{"web", Access::Operators}));
  EXPECT_FALSE(admit(page, {"web", "the-Shared-token"}));
  EXPECT_FALSE(admit(page, {"", "the-shared-token"}));
  SignIn beyond{{file, "the-shared-token", true}, clock};
  EXPECT_FALSE(admit(beyond, {"web", "the-shared-token"}));
}

TEST_F(DigestSignIn, AReaderMayChangeNothing) {
  const std::string eve = add("eve", DigestUse::Yes, Access::Readers);
  SignIn page{{file, {}, false}, clock};
  EXPECT_EQ(admit(page, {"eve", eve}).value().may, Access::Readers);
}

TEST_F(DigestSignIn, CarriesNothingOutThatAForeignPageMadeABrowserSend) {
  const std::string ada = add("ada", DigestUse::Yes);
  SignIn page{{file, {}, false}, clock};
  EXPECT_EQ(admit(page, {"ada", ada}, "PUT", "http://evil.example").error().status, 403U);
  EXPECT_TRUE(admit(page, {"ada", ada}, "PUT", "http://localhost:7480"));
}

TEST_F(DigestSignIn, LeavesALoginOfAProxyToTheProxy) {
  SignIn page{{file, "the-shared-token", false}, clock};
  DigestClient proxy{"ada", "x"};
  proxy.realm = "somebody's proxy";
  EXPECT_EQ(admit(page, proxy).value().name, "");
}

TEST_F(DigestSignIn, CountsAWrongLoginAmongTheRefusals) {
  std::vector<std::string> refused;
  SignIn page{{file, "the-shared-token", false}, clock, {{}, [&](const std::string& address, const Error& why) {
                                                           refused.push_back(address + " " + why.what);
                                                         }}};
  EXPECT_FALSE(admit(page, {"web", "wrong"}));
  ASSERT_THAT(refused, SizeIs(1));
  EXPECT_THAT(refused[0], HasSubstr("192.0.2.7:5000"));
}

TEST_F(DigestSignIn, FilesOfBeforeAreReadAndAFileNamesNoToken) {
  const std::string bob = add("bob", DigestUse::No), ada = add("ada", DigestUse::Yes);
  std::stringstream text;
  text << std::ifstream{file}.rdbuf();
  EXPECT_THAT(text.str(), Not(HasSubstr(ada)));
  const auto read = read_operator_tokens(file).value();
  ASSERT_THAT(read, SizeIs(2));
  EXPECT_FALSE(read[0].digest_login) << "a line of five fields, as before";
  EXPECT_EQ(read[1].digest_login, digest_keys_of("ada", ada));
  EXPECT_EQ(owner_of(read, ada)->name, "ada") << "it is a token as any other too";
}

}  // namespace
}  // namespace telefab
