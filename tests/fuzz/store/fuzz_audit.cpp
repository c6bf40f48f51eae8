// SPDX-License-Identifier: GPL-3.0-or-later
#include <cstdint>
#include <cstdlib>
#include <telefab/store/audit_log.hpp>

#include "../scratch_file.hpp"

// An audit log of any bytes: refused as it is, or opened with nothing lost but a torn tail, and sound with one entry
// more.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace telefab;
  const test::ScratchFile file{data, size};
  const VirtualClock clock;
  const std::string before = file.bytes();
  {
    const auto log = AuditLog::open(file.path(), clock);
    if (!log) {
      if (log.error().what.empty() || file.bytes() != before) std::abort();
      return 0;
    }
    if (!before.starts_with(file.bytes())) std::abort();
    if (!(*log)->add("operator", "opened")) std::abort();
  }
  if (!AuditLog::open(file.path(), clock)) std::abort();
  return 0;
}
