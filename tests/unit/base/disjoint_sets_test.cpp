// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <telefab/base/disjoint_sets.hpp>

namespace telefab {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

TEST(DisjointSets, AreCountedByTheirLowestMembersInWhateverOrderTheyWereJoined) {
  DisjointSets one{6}, other{6};
  one.join(4, 1), one.join(5, 3), one.join(1, 5);
  other.join(3, 5), other.join(5, 1), other.join(1, 4), other.join(4, 3);
  EXPECT_THAT(one.numbers(), ElementsAre(0, 1, 2, 1, 1, 1));
  EXPECT_EQ(other.numbers(), one.numbers());
  EXPECT_EQ(one.root(5), 1U);
}

TEST(DisjointSets, HoldEachMemberAloneAtFirst) {
  EXPECT_THAT(DisjointSets{3}.numbers(), ElementsAre(0, 1, 2));
  EXPECT_THAT(DisjointSets{0}.numbers(), IsEmpty());
}

}  // namespace
}  // namespace telefab
