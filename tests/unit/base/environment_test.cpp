// SPDX-License-Identifier: GPL-3.0-or-later
#include <gtest/gtest.h>
#include <stdlib.h>

#include <telefab/base/environment.hpp>

namespace telefab {
namespace {

class Environment : public testing::Test {
 protected:
  void TearDown() override {
    unsetenv("XDG_CONFIG_HOME");
    setenv("HOME", home_.c_str(), 1);
  }
  std::string home_ = environment_variable("HOME");
};

TEST_F(Environment, KeepsSettingsWhereTheUserSaysElseAtHome) {
  setenv("HOME", "/home/someone", 1);
  unsetenv("XDG_CONFIG_HOME");
  EXPECT_EQ(config_folder(), "/home/someone/.config");
  setenv("XDG_CONFIG_HOME", "/cfg", 1);
  EXPECT_EQ(config_folder(), "/cfg");
}

TEST_F(Environment, KnowsAHomeWhereNoVariableNamesOne) {
  unsetenv("HOME");
  unsetenv("XDG_CONFIG_HOME");
  // Whoever runs this is on the system's list; a folder below the present one would be nobody's home.
  EXPECT_TRUE(home_folder().empty() || home_folder().is_absolute()) << home_folder();
  EXPECT_TRUE(config_folder().empty() || config_folder().is_absolute()) << config_folder();
}

}  // namespace
}  // namespace telefab
