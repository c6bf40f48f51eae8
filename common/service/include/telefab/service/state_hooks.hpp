// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <memory>
#include <string>
#include <telefab/job/job.hpp>

namespace telefab {

/// Who is told of state changes. Both may be empty.
struct HookOptions {
  std::string program;  ///< run with TELEFAB_JOB, TELEFAB_STATE, TELEFAB_MESSAGE, ... and the job's JSON as input
  std::string url;      ///< http:// or https://, takes a POST of the job's JSON
};

/// Tells a program and a web address of every change of a job's state, one at a time and in order, on a thread of its
/// own: a slow or dead listener never holds up a print. A program has 30 s, then it is killed; an address is tried
/// three times. What could not be told is logged and forgotten.
class StateHooks {
 public:
  /// InvalidInput: the program is none that may be run, or the address is neither http nor https.
  [[nodiscard]] static Result<std::unique_ptr<StateHooks>> start(const HookOptions& options);
  ~StateHooks();  ///< what is under way is cut off, what waits is dropped
  StateHooks(const StateHooks&) = delete;
  StateHooks& operator=(const StateHooks&) = delete;

  /// Returns at once; above 1,000 waiting changes the oldest is dropped.
  void notify(const Job& job);

 private:
  struct Impl;
  explicit StateHooks(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace telefab
