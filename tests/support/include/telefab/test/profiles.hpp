// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>

#include <string>
#include <telefab/machine/profile_catalogue.hpp>

namespace telefab::test {

/// A machine that the programs know by themselves; a failure of the test, and an empty profile, where there is none.
[[nodiscard]] inline MachineProfile known_machine(const std::string& name) {
  const auto catalogue = builtin_profiles();
  EXPECT_TRUE(catalogue) << catalogue.error().what;
  if (!catalogue) return {};
  const auto machine = catalogue->compose({name});
  EXPECT_TRUE(machine) << machine.error().what;
  return machine ? machine->profile : MachineProfile{};
}

}  // namespace telefab::test
