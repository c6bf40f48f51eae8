// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>
#include <stdlib.h>

#include <filesystem>
#include <string>
#include <telefab/base/file.hpp>
#include <vector>

namespace telefab::test {

/// A folder of its own for every test, gone afterwards.
class ScratchFolder : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "telefab-formats-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    folder = name;
  }
  void TearDown() override { std::filesystem::remove_all(folder); }

  [[nodiscard]] std::ptrdiff_t files() const { return std::distance(std::filesystem::directory_iterator{folder}, {}); }
  [[nodiscard]] std::vector<std::byte> bytes(const std::string& name) const {
    return read_file(folder / name, 64U << 20U).value();
  }
  [[nodiscard]] std::string text(const std::string& name) const {
    const auto all = bytes(name);
    return {reinterpret_cast<const char*>(all.data()), all.size()};
  }
  std::filesystem::path folder;
};

}  // namespace telefab::test
