// SPDX-License-Identifier: GPL-3.0-or-later
#include <gmock/gmock.h>

#include <string_view>

// A fab in this process computes its accuracy pictures by running its own program again, which is this one.
int main(int count, char** words) {
  if (count > 1 && std::string_view{words[1]} == "predict") return 1;
  testing::InitGoogleMock(&count, words);
  return RUN_ALL_TESTS();
}
