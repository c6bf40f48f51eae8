// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace telefab::test {

/// A fab without daemon, masks and devices: what remains is what it asks of the queue, and a journal of what it lit.
struct LightFab {
  std::string queue;  ///< as open_fleet has it
  std::string name;
  std::filesystem::path journal;  ///< lines "lit JOB ATTEMPT LAYER", "started JOB MICROSECONDS", "ended JOB ATTEMPT"
  int machines = 1;
  int print_ms = 1000;
  int layers = 3;
  int lease_ms = 30'000;
};

/// Announces its machines and prints on them whatever the fleet gives, until it is killed; what an earlier life lit it
/// finds in its journal. Each layer is written there before it is lit, as a print's own journal has it, and is lit
/// under the fence of decision 1002. Never returns.
[[noreturn]] void print_for_ever(const LightFab& fab);

/// The words by which a program becomes that fab, and back.
[[nodiscard]] std::vector<std::string> words_of(const LightFab& fab);
[[nodiscard]] LightFab light_fab_from(const std::vector<std::string>& words);

}  // namespace telefab::test
