// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <atomic>
#include <mutex>
#include <string>
#include <telefab/fab/drivers/grbl_model.hpp>
#include <thread>

namespace telefab::test {

/// A board's model behind a pseudo terminal, for any process; with its end the line is cut. The model is touched under
/// `mutex` only.
class PtyHost {
 public:
  PtyHost(fab::LineModel& model, std::mutex& mutex);
  ~PtyHost();
  [[nodiscard]] const std::string& path() const { return path_; }

 private:
  int master_ = -1;
  int slave_ = -1;
  std::string path_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

}  // namespace telefab::test
