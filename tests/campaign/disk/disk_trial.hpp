// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>

#include "disk_faults.hpp"

namespace telefab::test {

/// One fax of a small part over a disk that fails once, or from one operation on until somebody makes room.
struct DiskTrial {
  std::filesystem::path bin;     ///< of the programs
  std::filesystem::path folder;  ///< emptied first
  std::string site;              ///< "fab" or "scan": whose disk
  std::uint64_t at = 0;          ///< operation that fails; 0: none
  int error = 0;
  bool stays = false;
  DiskCalls calls = DiskCalls::Writes;
  std::string ending;  ///< of paths; only those are counted
};

/// What became of it. The worst word counts.
enum class DiskOutcome : std::uint8_t {
  Recovered,  ///< printed and proved, and nobody had to do anything
  Refused,    ///< a start or a submit was refused with a reason; done again, it went well
  Held,       ///< the job waited for an operator with a reason; after their word it went well
  Wrong,      ///< anything else
};
[[nodiscard]] std::string_view name_of(DiskOutcome outcome);

struct DiskVerdict {
  DiskOutcome outcome = DiskOutcome::Wrong;
  std::string what;                                    ///< why it was refused or held, or what was wrong
  std::string fault;                                   ///< the operation that failed first
  std::array<std::uint64_t, kDiskCalls> operations{};  ///< of the whole fax, by DiskCalls
  bool was_unhealthy = false;                          ///< /v1/health said so meanwhile
};

/// Both daemons in this process; the failing disk is its own too, so one trial a process.
[[nodiscard]] DiskVerdict run_trial(const DiskTrial& trial);

}  // namespace telefab::test
