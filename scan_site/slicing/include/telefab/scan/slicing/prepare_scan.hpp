// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <telefab/base/clock.hpp>
#include <telefab/base/progress.hpp>
#include <telefab/base/result.hpp>
#include <telefab/scan/cloud/normals.hpp>
#include <telefab/scan/cloud/pick_object.hpp>
#include <telefab/scan/cloud/point_cloud.hpp>
#include <vector>

namespace telefab::scan {

/// Where time went, seconds of wall clock.
struct StageTime {
  std::string stage;
  double seconds = 0;
};

/// Laps of a stopwatch, into a list that must outlive it.
class StageClock {
 public:
  explicit StageClock(std::vector<StageTime>& times) : times_{times}, since_{clock_.now()} {}
  void lap(std::string stage);

 private:
  SystemClock clock_;
  std::vector<StageTime>& times_;
  Nanoseconds since_;
};

/// What of a file is the object.
struct IntakeOptions {
  PickOptions pick;
  bool sample_faces = false;                           ///< points on the faces of a mesh file in place of its corners
  bool about_origin = false;                           ///< placed with its middle at x = y = 0, not on the platform's
  std::optional<std::size_t> most_points = 8'000'000;  ///< as in ReadOptions; not of faces that are sampled
  std::function<void()> let_go = {};  ///< called while the file's bytes are read, and behind: they may leave memory
};

/// A scan that is ready to be placed: what does not belong to the object is gone, normals point outward.
struct PreparedScan {
  PointCloud cloud;        ///< frame and unit of the file
  std::size_t points = 0;  ///< read
  PickReport pick;
  NormalReport normals;
  bool sheets_are_guessed =
      false;                     ///< PointCloud::sheets_apart is known from the points alone, not by the scan's views
  bool has_empty_faces = false;  ///< a mesh whose faces carry no points, not sampled
  bool is_thinned = false;       ///< the file holds more points than were taken
  std::vector<std::string> warnings;  ///< of reading, picking and orienting, for people
};

/// Reads, picks the object and orients: what slicing and inspection begin with. Fails as read_cloud, pick_object and
/// with_normals do.
[[nodiscard]] Result<PreparedScan> prepare_scan(std::span<const std::byte> scan, std::string_view name,
                                                const IntakeOptions& options, const ProgressSink& progress,
                                                StageClock& clock, std::stop_token stop);

}  // namespace telefab::scan
