// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <telefab/base/file.hpp>
#include <telefab/test/scratch_folder.hpp>
#include <vector>

namespace telefab::test {

/// A folder of its own for every test, and what the test wrote there.
class ScratchFiles : public testing::Test {
 protected:
  [[nodiscard]] std::ptrdiff_t files() const { return std::distance(std::filesystem::directory_iterator{folder}, {}); }
  [[nodiscard]] std::vector<std::byte> bytes(const std::string& name) const {
    return read_file(folder / name, 64U << 20U).value();
  }
  [[nodiscard]] std::string text(const std::string& name) const {
    const auto all = bytes(name);
    return {reinterpret_cast<const char*>(all.data()), all.size()};
  }
  ScratchFolder scratch;
  std::filesystem::path folder = scratch.path();
};

}  // namespace telefab::test
