// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <string>
#include <string_view>

namespace telefab::fab {

/// A board model as bytes on its line, for whoever carries them. Threads: one caller at a time.
class LineModel {
 public:
  virtual ~LineModel() = default;
  LineModel(const LineModel&) = delete;
  LineModel& operator=(const LineModel&) = delete;

  /// Bytes from the host. False: the line is gone.
  [[nodiscard]] virtual bool receive(std::string_view bytes) = 0;
  /// Bytes for the host up to now.
  [[nodiscard]] virtual std::string transmit() = 0;
  /// Port opened: boards of this kind restart.
  virtual void reopened() = 0;
  [[nodiscard]] virtual bool present() const = 0;

 protected:
  LineModel() = default;
};

}  // namespace telefab::fab
