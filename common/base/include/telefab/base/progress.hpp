// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <functional>
#include <string_view>

namespace telefab {

/// How far a piece of long work is.
struct Progress {
  std::string_view stage;  ///< a label from the owner's step table, static storage
  double fraction = 0;     ///< 0 to 1 of this stage
};

/// Called from the thread that does the work, at most once a layer or block. May be empty.
using ProgressSink = std::function<void(const Progress&)>;

inline void report(const ProgressSink& sink, std::string_view stage, double fraction) {
  if (sink) sink(Progress{stage, fraction});
}

}  // namespace telefab
