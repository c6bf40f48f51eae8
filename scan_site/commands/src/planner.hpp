// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>
#include <telefab/base/result.hpp>
#include <utility>

namespace telefab::scan {

/// What the fab's planner says of a stack.
struct PlannedSupports {
  double support_mm3 = 0;
  double part_mm3 = 0;
  std::uint32_t anchors = 0;
  double lifted_mm = 0;
};

/// The program `telefab-fab` of this computer: the fab's own figures, asked of a process, as the sites share no code.
class Planner {
 public:
  /// "none": none. A program by its path or, without a slash, by its name in PATH: fails with NotFound where it is not
  /// there. Empty: telefab-fab beside this program or in PATH, or none.
  [[nodiscard]] static Result<std::optional<Planner>> find(const std::string& asked);

  [[nodiscard]] const std::string& program() const { return program_; }
  /// Plans the supports of a .tfc file for a machine, whose profile the planner reads from `machines`, a folder.
  /// Fails: NotFound (cannot be started), InvalidInput (it refused; with its own words), Cancelled.
  [[nodiscard]] Result<PlannedSupports> supports(const std::filesystem::path& stack, const std::string& machine,
                                                 const std::filesystem::path& machines, unsigned threads,
                                                 std::stop_token stop) const;

 private:
  explicit Planner(std::string program) : program_{std::move(program)} {}
  std::string program_;
};

/// A folder of this process alone below the one for temporary files; removed with all that is in it.
class WorkFolder {
 public:
  /// Fails: StorageFailed.
  [[nodiscard]] static Result<WorkFolder> make();
  ~WorkFolder();
  WorkFolder(WorkFolder&& other) noexcept : path_{std::exchange(other.path_, {})} {}
  WorkFolder& operator=(WorkFolder&&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }

 private:
  explicit WorkFolder(std::filesystem::path path) : path_{std::move(path)} {}
  std::filesystem::path path_;
};

}  // namespace telefab::scan
