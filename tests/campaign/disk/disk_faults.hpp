// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>

// A disk that fails: whatever this process writes beneath a folder, by whichever library, goes through the functions of
// disk_faults.cpp in place of the C library's own. Threads: any.
namespace telefab::test {

struct DiskFaultPlan {
  std::string under;     ///< folder; what lies elsewhere never fails
  std::uint64_t at = 0;  ///< this operation fails, counted from 1; 0: none does
  int error = 0;         ///< errno it fails with
  bool stays = false;    ///< and every one behind it, until end_disk_faults()
};
/// An operation is one call that writes, syncs, makes, resizes or renames a file.
void begin_disk_faults(const DiskFaultPlan& plan);
/// The disk is sound from now on; operations are still counted.
void end_disk_faults();
/// Operations since begin_disk_faults.
[[nodiscard]] std::uint64_t disk_operations();
/// The first that failed: its name and its file; empty: none has.
[[nodiscard]] std::string first_disk_fault();

}  // namespace telefab::test
