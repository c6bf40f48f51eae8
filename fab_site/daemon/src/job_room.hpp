// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <telefab/base/result.hpp>

namespace telefab::fab {

/// Whether what failed is the disk, not the job: full, not writable, not readable. Nothing of the job is lost by it.
[[nodiscard]] inline bool is_storage_trouble(const Error& error) {
  return error.code == ErrorCode::StorageFailed || error.code == ErrorCode::NotPermitted;
}

}  // namespace telefab::fab
