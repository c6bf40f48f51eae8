// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

namespace telefab::test {

/// What main() of a campaign does: `run` with the words behind the program's name; what it throws is said, exit
/// code 70.
inline int campaign_main(int count, char** words, int (*run)(const std::vector<std::string>& words)) {
  try {
    return run({words + 1, words + count});
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 70;
  }
}

}  // namespace telefab::test
