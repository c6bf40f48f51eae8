// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <unistd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace telefab::test {

/// A folder of this process in memory where there is such a place, with one file of the given bytes in it. Two at once
/// have names of their own.
class ScratchFile {
 public:
  ScratchFile(const std::uint8_t* data, std::size_t size, const std::string& name = "fuzz") {
    std::error_code error;
    const std::filesystem::path memory{"/dev/shm"};
    folder_ = (std::filesystem::is_directory(memory, error) ? memory : std::filesystem::temp_directory_path()) /
              ("telefab-" + name + "-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
    std::ofstream{path(), std::ios::binary}.write(reinterpret_cast<const char*>(data),
                                                  static_cast<std::streamsize>(size));
  }
  ~ScratchFile() {
    std::error_code error;
    std::filesystem::remove_all(folder_, error);
  }
  ScratchFile(const ScratchFile&) = delete;
  ScratchFile& operator=(const ScratchFile&) = delete;

  [[nodiscard]] std::filesystem::path path() const { return folder_ / "file"; }
  [[nodiscard]] std::string bytes() const {
    std::ifstream in{path(), std::ios::binary};
    return {std::istreambuf_iterator<char>{in}, {}};
  }

 private:
  std::filesystem::path folder_;
};

}  // namespace telefab::test
