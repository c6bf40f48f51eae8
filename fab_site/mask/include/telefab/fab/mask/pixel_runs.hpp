// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstdint>
#include <span>
#include <vector>

namespace telefab::fab {

/// Pixels side by side in one row, from the column `first` to the one before `behind`.
struct PixelRun {
  std::int32_t first = 0;
  std::int32_t behind = 0;
  [[nodiscard]] std::int32_t width() const { return behind - first; }
  /// Whether they share a column.
  [[nodiscard]] bool meets(const PixelRun& other) const { return first < other.behind && other.first < behind; }
  friend bool operator==(const PixelRun&, const PixelRun&) = default;
};

/// A set of pixels of one layer as runs, row by row from the front of the platform. Built row by row.
/// Invariant: the runs of a row are sorted and do not touch.
class PixelRuns {
 public:
  /// The next row, empty so far.
  void begin_row() { starts_.push_back(static_cast<std::uint32_t>(runs_.size())); }
  /// To the last row, behind its other runs.
  void add(PixelRun run) { runs_.push_back(run); }

  [[nodiscard]] std::uint32_t rows() const { return static_cast<std::uint32_t>(starts_.size()); }
  [[nodiscard]] std::span<const PixelRun> row(std::uint32_t y) const {
    const std::size_t end = y + 1 < starts_.size() ? starts_[y + 1] : runs_.size();
    return {runs_.data() + starts_[y], end - starts_[y]};
  }
  [[nodiscard]] bool empty() const { return runs_.empty(); }
  friend bool operator==(const PixelRuns&, const PixelRuns&) = default;

 private:
  std::vector<PixelRun> runs_;
  std::vector<std::uint32_t> starts_;
};

/// Pixels of `a` whose counterpart `rows_up` rows behind is in `b`. Both have the same rows.
[[nodiscard]] PixelRuns common(const PixelRuns& a, const PixelRuns& b, std::uint32_t rows_up = 0);
/// Pixels of `a` that are not in `b`.
[[nodiscard]] PixelRuns without(const PixelRuns& a, const PixelRuns& b);
/// Pixels of either. Both have the same rows.
[[nodiscard]] PixelRuns united(const PixelRuns& a, const PixelRuns& b);
/// Pixels whose square of 2 `by` + 1 pixels lies in the set: what is left is at least `by` pixels inside, in any
/// direction. What lies beyond the first and last row is not in the set.
[[nodiscard]] PixelRuns shrunk(const PixelRuns& set, std::uint32_t by);

}  // namespace telefab::fab
