// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>

#include "seeds.hpp"

int main(int count, char** arguments) {
  if (count != 2) {
    fmt::print(stderr, "{} CORPUS: writes seeds into the folders of CORPUS\n", arguments[0]);
    return 1;
  }
  const auto done = telefab::write_seeds(arguments[1]);
  if (done) return 0;
  fmt::print(stderr, "{}\n", done.error().what);
  return 7;
}
