// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <telefab/base/signature.hpp>
#include <telefab/wire/job_signature.hpp>

namespace telefab {
namespace {

using testing::HasSubstr;

class JobSignature : public testing::Test {
 protected:
  JobSignature() {
    offer.job = "j1";
    offer.name = "vase.ply";
    offer.machine = "machine-a";
    offer.parameters = "{}";
    offer.owner = "ana";
    offer.coding = 2;
    offer.header.machine = "machine-a";
    offer.scan = digest_of(std::vector<std::byte>(3));
    offer.registration_rms_mm = 0.05;
    offer.header.layer_count = 500;
    end = {"j1", 8, digest_of(std::vector<std::byte>(1)), digest_of(std::vector<std::byte>(2)), {}};
  }
  KeyPair key = new_ed25519_key().value();
  Offer offer;
  StackEnd end;
};

TEST_F(JobSignature, HoldsForTheOfferAndTheStackThatWereSigned) {
  ASSERT_TRUE(sign_offer(offer, key.private_pem));
  ASSERT_TRUE(sign_end(offer, end, key.private_pem));
  EXPECT_TRUE(check_offer(offer, {}));
  EXPECT_TRUE(check_offer(offer, key.public_pem));
  EXPECT_TRUE(check_end(offer, end));
}

TEST_F(JobSignature, OfAnyOtherOfferOrStackDoesNotHold) {
  ASSERT_TRUE(sign_offer(offer, key.private_pem));
  ASSERT_TRUE(sign_end(offer, end, key.private_pem));
  const std::function<void(Offer&)> changes[]{[](Offer& o) { o.job = "j2"; },
                                              [](Offer& o) { o.name += "x"; },
                                              [](Offer& o) { o.machine = "machine-b"; },
                                              [](Offer& o) { o.parameters = "{ }"; },
                                              [](Offer& o) { o.profile.bytes[5] ^= std::byte{1}; },
                                              [](Offer& o) { o.header.layer_count = 501; },
                                              [](Offer& o) { o.coding = 1; },
                                              [](Offer& o) { o.scan.bytes[9] ^= std::byte{1}; },
                                              [](Offer& o) { o.scan = {}; },
                                              [](Offer& o) { o.registration_rms_mm = 0.06; },
                                              [](Offer& o) { o.attempt = 1; },
                                              [](Offer& o) { o.owner = "bob"; },
                                              [](Offer& o) { o.signature[7] ^= std::byte{4}; },
                                              [](Offer& o) { o.public_key[0] ^= std::byte{1}; }};
  for (const auto& change : changes) {
    Offer changed = offer;
    change(changed);
    const auto held = check_offer(changed, {});
    ASSERT_FALSE(held);
    EXPECT_EQ(held.error().code, ErrorCode::NotTrusted);
    EXPECT_THAT(held.error().what, HasSubstr("job-signature"));
  }
  const std::function<void(StackEnd&)> ends[]{
      [](StackEnd& e) { e.chunk_count = 9; }, [](StackEnd& e) { e.chain.bytes[0] ^= std::byte{1}; },
      [](StackEnd& e) { e.stack.bytes[31] ^= std::byte{1}; }, [](StackEnd& e) { e.signature.clear(); }};
  for (const auto& change : ends) {
    StackEnd changed = end;
    change(changed);
    EXPECT_FALSE(check_end(offer, changed));
  }
}

TEST_F(JobSignature, OfAnotherKeyIsNotTheKnownOne) {
  ASSERT_TRUE(sign_offer(offer, new_ed25519_key().value().private_pem));
  EXPECT_TRUE(check_offer(offer, {}));
  EXPECT_FALSE(check_offer(offer, key.public_pem));
  ASSERT_TRUE(sign_end(offer, end, key.private_pem));
  EXPECT_FALSE(check_end(offer, end)) << "the end must be signed with the key of the offer";
}

TEST_F(JobSignature, MissingIsRefusedByName) {
  const auto held = check_offer(offer, {});
  ASSERT_FALSE(held);
  EXPECT_THAT(held.error().what, HasSubstr("not signed"));
}

}  // namespace
}  // namespace telefab
