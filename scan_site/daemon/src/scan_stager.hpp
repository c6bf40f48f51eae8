// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once
#include <algorithm>
#include <array>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <telefab/machine/profile_part.hpp>
#include <telefab/scan/slicing/slice_scan.hpp>
#include <telefab/scan/staging/staged_scan.hpp>
#include <telefab/service/work_queue.hpp>
#include <telefab/transfer/upload_store.hpp>

namespace telefab::scan {

/// Reads, prepares, estimates and turns uploaded scans, one task after the other, on a thread of its own, named
/// "stager". A question takes the place of one of its kind that is not answered yet. A file that is no scan, or too
/// large for the memory, fails its own tasks alone. Scans nobody asked about lately are forgotten, and read again when
/// somebody does. Threads: any.
class ScanStager {
 public:
  /// The store must outlive it.
  /// `room`: whether so many bytes may be written now; from any thread.
  ScanStager(UploadStore& uploads, std::function<Result<void>(std::uint64_t)> room);

  /// All bytes are there: compare the digest, then read. Once, however often it is asked for.
  void read(const std::string& id);
  /// Prepare as the request says; `asked`: its parameters in one text, by which answers are found again.
  void look(const std::string& id, SliceRequest request, std::string asked);
  void estimate(const std::string& id, SliceRequest request, std::optional<ResinPrice> price, std::string asked);
  void orient(const std::string& id, SliceRequest request, StandFor goal, std::string asked);
  /// Joins it with others to one scan, which becomes an upload of its own; its id is the answer. Under `owner`.
  void join(const std::string& id, std::vector<std::string> with, std::string owner);
  /// The upload is gone: what was asked of it too.
  void forget(const std::string& id);
  /// Adds what is known of the scan: stage, facts, look, estimate, orientation, picture.
  void describe(const std::string& id, nlohmann::ordered_json& view) const;
  /// Fails: NotFound (no picture, no such level), Conflict (another revision).
  [[nodiscard]] Result<std::vector<std::byte>> level(const std::string& id, std::uint64_t revision,
                                                     std::uint32_t level) const;

 private:
  /// One kind of question about a scan, and the answer to the last one.
  struct Question {
    enum class State : std::uint8_t { None, Working, Done, Failed };
    State state = State::None;
    std::uint64_t number = 0;  ///< of the question asked last
    SliceRequest request;
    StandFor goal = StandFor::Supports;
    std::optional<ResinPrice> price;  ///< of estimating
    std::vector<std::string> with;    ///< of joining: the other views
    std::string owner;                ///< likewise: of what comes out
    std::string asked;
    std::string stage;  ///< what is being done, for people
    double share = 0;
    Error why;
    std::string answer_json;
  };
  struct Scan {
    Question reading, look, estimate, orientation, joining;
    std::shared_ptr<const StagedScan> staged;
    std::string staged_as;  ///< the intake that it was prepared with
    CloudPicture picture;
    std::uint64_t revision = 0;  ///< of the picture
    std::uint64_t used = 0;
  };
  using Kind = Question Scan::*;
  /// A task is the upload's id and the letter of what is asked.
  static constexpr std::array<std::pair<Kind, char>, 5> kKinds{{{&Scan::reading, 'r'},
                                                                {&Scan::look, 'l'},
                                                                {&Scan::estimate, 'e'},
                                                                {&Scan::orientation, 'o'},
                                                                {&Scan::joining, 'j'}}};
  [[nodiscard]] static char letter_of(Kind kind) {
    return std::ranges::find(kKinds, kind, &std::pair<Kind, char>::first)->second;
  }

  void ask(const std::string& id, Kind kind, Question question);
  /// Whether an answer of that kind is still what would be found.
  [[nodiscard]] bool holds(const std::string& id, const Scan& scan, Kind kind) const;
  void run(const std::string& task, const std::stop_token& stop);
  [[nodiscard]] Result<std::string> answer(const std::string& id, Kind kind, const Question& question,
                                           const std::stop_token& stop);
  [[nodiscard]] Result<std::string> joined(const std::string& id, const Question& question,
                                           const std::stop_token& stop);
  [[nodiscard]] Result<std::string> read_file_of(const std::string& id, const std::stop_token& stop);
  [[nodiscard]] Result<std::shared_ptr<const StagedScan>> staged(const std::string& id, Kind kind,
                                                                 const Question& question, const std::stop_token& stop);
  [[nodiscard]] Result<std::vector<std::byte>> bytes_of(const std::string& id, std::string& name) const;
  void set_progress(const std::string& id, Kind kind, std::uint64_t number, std::string_view stage, double share);
  /// mutex_ is held.
  void forget_others(const std::string& id);

  UploadStore& uploads_;
  std::function<Result<void>(std::uint64_t)> room_;
  mutable std::mutex mutex_;
  std::map<std::string, Scan> scans_;  ///< by id; guarded by mutex_
  std::uint64_t next_ = 0;             ///< guarded by mutex_
  WorkQueue queue_;                    ///< last: its end stops what is under way
};

}  // namespace telefab::scan
