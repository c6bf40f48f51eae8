// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <string>

// A disk that fails: whatever this process writes, reads or removes beneath a folder, by whichever library, goes
// through the functions of disk_faults.cpp in place of the C library's own. Threads: any.
namespace telefab::test {

/// Calls that are operations, each kind counted by itself.
enum class DiskCalls : std::uint8_t {
  Writes,   ///< write, sync, make, resize, link or rename a file
  Reads,    ///< read from an open file
  Removes,  ///< remove a file or a folder
};
inline constexpr std::size_t kDiskCalls = 3;

struct DiskFaultPlan {
  std::string under;                    ///< folder; what lies elsewhere never fails
  DiskCalls calls = DiskCalls::Writes;  ///< of these
  std::uint64_t at = 0;                 ///< this operation fails, counted from 1; 0: none does
  int error = 0;                        ///< errno it fails with
  bool stays = false;                   ///< and every one behind it, until end_disk_faults()
  std::string ending;                   ///< only operations on paths that end so are counted; empty: all
};
void begin_disk_faults(const DiskFaultPlan& plan);
/// The disk is sound from now on; operations are still counted.
void end_disk_faults();
/// Operations of a kind since begin_disk_faults.
[[nodiscard]] std::uint64_t disk_operations(DiskCalls calls);
/// While one lives, nothing that its thread does with the disk is counted or fails: for the trial's own looks.
class SoundDisk {
 public:
  SoundDisk();
  ~SoundDisk();
  SoundDisk(const SoundDisk&) = delete;
  SoundDisk& operator=(const SoundDisk&) = delete;
};
/// The first that failed: its name and its file; empty: none has.
[[nodiscard]] std::string first_disk_fault();

}  // namespace telefab::test
